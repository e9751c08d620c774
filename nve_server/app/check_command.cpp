#include "nve_server/app/check_command.h"

#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "nve_server/scene/scene.h"
#include "nve_server/slave/nve_slave.h"

namespace telenano::app {
namespace {

constexpr double kHalfSpaceRatio = 0.5;  // a/R beyond which contact on a half-space is formal

void print_material(const char* what, const scene::Material& m) {
  std::printf("%-14s %s E = %g GPa, nu = %g, gamma = %g J/m2\n", what, m.name.empty() ? "-" : m.name.c_str(),
              m.youngs_modulus_gpa, m.poisson_ratio, m.surface_energy_j_m2);
}

struct ContactSizes {
  double unloaded_nm = 0;  // at zero load, coming out of contact
  double at_limit_nm = 0;  // at the force limit
  double overlap_at_limit_nm = 0;
};

// Contact radii by pressing a soft spring (load control, nearly) to the force limit and letting go again.
ContactSizes contact_sizes(const scene::Scene& scene) {
  const physics::TipSampleLaw law(scene.law_parameters);
  const double radius = scene.probe.tip_radius_nm;
  const double compliance = 1e4 * radius / scene.limits.force_max_nn;
  physics::TipSampleState state;
  ContactSizes sizes;
  // F = (base − delta)/c: this base gives the limit but for delta, which is small beside it.
  auto eq = law.advance(compliance * scene.limits.force_max_nn, compliance, radius, state);
  sizes.at_limit_nm = eq.contact_radius_nm;
  sizes.overlap_at_limit_nm = eq.overlap_nm;
  eq = law.advance(0.0, compliance, radius, state);
  if (eq.branch == physics::Branch::kContact) sizes.unloaded_nm = eq.contact_radius_nm;
  return sizes;
}

struct Timing {
  double p50_ns = 0;
  double p99_ns = 0;
};

// A session's typical motion at 1 kHz and 1 µm/s: sideways at a constant commanded height.
Timing time_step(const std::shared_ptr<const scene::Scene>& scene, double height_nm) {
  constexpr int kBlocks = 400;
  constexpr int kStepsPerBlock = 25;  // averages the clock's own cost away
  slave::NveSlave slave(scene);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  const Vec3 start = scene->start_apex_w_nm;
  std::vector<double> ns;
  ns.reserve(kBlocks);
  Vec3 target = start;
  const double bottom = scene->start_touch_w_nm + height_nm;
  while (target.z() != bottom) {
    target.z() = target.z() - bottom > 1.0 ? target.z() - 1.0 : bottom;
    input.tip_target_pos_w_nm = target;
    slave.step(input, 1e-3, output);
  }
  double x = 0;
  double direction = 1;
  for (int block = 0; block < kBlocks; ++block) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kStepsPerBlock; ++i) {
      x += direction;
      if (std::abs(x) > 100.0) direction = -direction;
      input.tip_target_pos_w_nm = target + Vec3(x, 0.37 * x, 0.0);
      slave.step(input, 1e-3, output);
    }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
    ns.push_back(spent.count() / kStepsPerBlock);
  }
  std::sort(ns.begin(), ns.end());
  return {ns[ns.size() / 2], ns[ns.size() * 99 / 100]};
}

void run(const std::string& path) {
  const auto scene = scene::load_scene(path);
  const scene::Probe& probe = scene->probe;
  const scene::Limits& limits = scene->limits;
  const physics::TipSampleLaw law(scene->law_parameters);
  const double radius = probe.tip_radius_nm;
  const bool flat = scene->surface->is_flat();

  std::printf("%-14s %s (%s), hash %016" PRIx64 "\n", "scene", scene->name.c_str(), path.c_str(),
              scene->hash);
  print_material("sample", scene->sample);
  print_material("tip", probe.tip);
  std::printf("%-14s %g nm radius, ", "probe", radius);
  if (probe.rigid) {
    std::printf("rigid\n");
  } else {
    std::printf("k_z = %g N/m (%s)\n", probe.stiffness_n_m, probe.origin.c_str());
  }
  if (flat) {
    std::printf("%-14s the plane z = 0\n", "surface");
  } else {
    std::printf("%-14s %s, heights %.4g to %.4g nm\n", "surface", scene->scan_path.c_str(),
                scene->surface->lowest_nm(), scene->surface->highest_nm());
  }

  std::printf("\n%-14s Maugis-Dugdale contact%s%s%s\n", "in", scene->van_der_waals ? ", van der Waals" : "",
              probe.rigid ? "" : ", cantilever",
              flat ? "" : ", bicubic spline, nearest point, local curvature");
  if (scene->coupling.damping_n_s_m > 0) std::printf("%-14s coupling damper\n", "");
  std::printf("%-14s", "left out");
  if (flat) std::printf(" spline, nearest-point search,");
  if (!scene->van_der_waals) std::printf(" van der Waals,");
  if (probe.rigid) std::printf(" cantilever,");
  if (!(scene->coupling.damping_n_s_m > 0)) std::printf(" coupling damper,");
  std::printf(" capillary, friction, plasticity, lateral bending, second contacts\n\n");

  std::printf("%-14s %.6g (w = %g J/m2, K = %.6g GPa)\n", "lambda", law.lambda(radius),
              scene->law_parameters.work_of_adhesion_n_m, scene->law_parameters.contact_modulus_gpa);
  std::printf("%-14s %.6g nN on a flat, load control\n", "pull-off", law.pull_off_nn(radius));
  const physics::Compliance port = scene->port_compliance_nm_nn();
  std::printf("%-14s coupling %g N/m, along z with the probe %.4g N/m, damper %g N s/m\n", "stiffness",
              scene->coupling.stiffness_n_m, 1.0 / port(2, 2), scene->coupling.damping_n_s_m);
  std::printf("%-14s force %g nN, speed %g nm/s, rate %u Hz, time-out %u ms\n", "limits", limits.force_max_nn,
              limits.speed_max_nm_s, limits.rate_max_hz, scene->session_timeout_ms);
  std::printf("%-14s [%.6g, %.6g] x [%.6g, %.6g] x [%.6g, %.6g] nm\n", "workspace",
              limits.workspace_min_w_nm.x(), limits.workspace_max_w_nm.x(), limits.workspace_min_w_nm.y(),
              limits.workspace_max_w_nm.y(), limits.workspace_min_w_nm.z(), limits.workspace_max_w_nm.z());
  std::printf("%-14s (%.6g, %.6g, %.6g) nm, touching at z = %.6g nm\n", "start", scene->start_apex_w_nm.x(),
              scene->start_apex_w_nm.y(), scene->start_apex_w_nm.z(), scene->start_touch_w_nm);

  const ContactSizes sizes = contact_sizes(*scene);
  std::printf("%-14s a/R = %.3g unloaded, %.3g at the force limit (overlap %.3g nm)\n", "contact",
              sizes.unloaded_nm / radius, sizes.at_limit_nm / radius, sizes.overlap_at_limit_nm);
  std::fflush(stdout);
  if (std::max(sizes.unloaded_nm, sizes.at_limit_nm) > kHalfSpaceRatio * radius) {
    std::fprintf(stderr,
                 "telenano-nve: warning: %s: contact radius over tip radius reaches %.3g > 0.5: half-space "
                 "contact theory "
                 "is formal there\n",
                 path.c_str(), std::max(sizes.unloaded_nm, sizes.at_limit_nm) / radius);
  }

  const Timing free = time_step(scene, 10.0);
  const Timing touching = time_step(scene, -5.0);
  std::printf("%-14s 10 nm above: p50 %.0f ns, p99 %.0f ns; pressed 5 nm: p50 %.0f ns, p99 %.0f ns\n",
              "time a step", free.p50_ns, free.p99_ns, touching.p50_ns, touching.p99_ns);
}

}  // namespace

void add_check_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("check", "what a scene computes, what it leaves out, what a step costs");
  auto path = std::make_shared<std::string>();
  command->add_option("--scene", *path, "scene description (TOML)")->required()->type_name("FILE");
  command->callback([path] { run(*path); });
}

}  // namespace telenano::app
