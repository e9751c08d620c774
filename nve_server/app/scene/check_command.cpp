#include "telenano/nve_server/app/scene/check_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <memory>
#include <vector>

#include "telenano/common/config/completion.h"
#include "telenano/common/config/program.h"
#include "telenano/common/config/slave_limits_file.h"
#include "telenano/nve_server/app/scene/scene_loading.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/scene/scene_summary.h"
#include "telenano/nve_server/scene/scene_terms.h"
#include "telenano/nve_server/scene/tiles_ahead.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::app {
namespace {

void print_material(const char* what, const scene::Material& m) {
  std::printf("%-14s %s E = %g GPa, nu = %g, gamma = %g J/m2", what, m.name.empty() ? "-" : m.name.c_str(),
              m.youngs_modulus_gpa, m.poisson_ratio, m.surface_energy_j_m2);
  if (m.hardness_gpa > 0) std::printf(", H = %g GPa", m.hardness_gpa);
  std::printf("\n");
}

struct Timing {
  double p50_ns = 0;
  double p99_ns = 0;
};

// A session's typical motion at 1 kHz and 1 µm/s: sideways at a constant commanded height.
class TimedSlave {
 public:
  TimedSlave(const std::shared_ptr<const scene::Scene>& scene, double height_nm) : slave_(scene) {
    target_ = scene->start_apex_w_nm;
    const double bottom = scene->start_touch_w_nm + height_nm;
    while (target_.z() != bottom) {
      target_.z() = target_.z() - bottom > 1.0 ? target_.z() - 1.0 : bottom;
      input_.tip_target_pos_w_nm = target_;
      slave_.step(input_, 1e-3, output_);
    }
  }

  void run_block() {
    constexpr int kStepsPerBlock = 25;  // averages the clock's own cost away
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kStepsPerBlock; ++i) {
      x_ += direction_;
      if (std::abs(x_) > 100.0) direction_ = -direction_;
      input_.tip_target_pos_w_nm = target_ + Vec3(x_, 0.37 * x_, 0.0);
      slave_.step(input_, 1e-3, output_);
    }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
    ns_.push_back(spent.count() / kStepsPerBlock);
  }

  Timing timing() const {
    std::vector<double> ns = ns_;
    std::sort(ns.begin(), ns.end());
    return {ns[ns.size() / 2], ns[ns.size() * 99 / 100]};
  }

 private:
  slave::NveSlave slave_;
  slave::SlaveInput input_;
  slave::SlaveOutput output_;
  Vec3 target_ = Vec3::Zero();
  double x_ = 0;
  double direction_ = 1;
  std::vector<double> ns_;
};

constexpr double kAbove_nm = 10;
constexpr double kPressed_nm = -5;

Timing time_step(const std::shared_ptr<const scene::Scene>& scene, double height_nm) {
  constexpr int kBlocks = 400;
  TimedSlave slave(scene, height_nm);
  for (int i = 0; i < kBlocks; ++i) slave.run_block();
  return slave.timing();
}

// How much longer a step takes with a term than without. The two take turns, so that what else the machine
// does falls on both.
double cost_ns(const std::shared_ptr<const scene::Scene>& with,
               const std::shared_ptr<const scene::Scene>& without, double height_nm) {
  constexpr int kBlocks = 200;
  TimedSlave a(with, height_nm);
  TimedSlave b(without, height_nm);
  for (int i = 0; i < kBlocks; ++i) {
    a.run_block();
    b.run_block();
  }
  return a.timing().p50_ns - b.timing().p50_ns;
}

void print_costs(const std::shared_ptr<const scene::Scene>& scene) {
  const char* head = "cost of a term";
  for (const scene::WithoutTerm& without : scene::without_each_term(*scene)) {
    const double above = cost_ns(scene, without.scene, kAbove_nm);
    const double pressed = cost_ns(scene, without.scene, kPressed_nm);
    std::printf("%-14s %s: %+.0f ns above, %+.0f ns pressed\n", head, without.term.c_str(), above, pressed);
    head = "";
  }
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text.empty() ? "nothing" : text;
}

void print_probe(const scene::Scene& scene) {
  const physics::Probe& lever = scene.cantilever;
  std::printf("%-14s %g nm radius, ", "probe", scene.probe.tip_radius_nm);
  if (lever.rigid()) {
    std::printf("rigid\n");
    return;
  }
  std::printf("k = %g N/m (%s)", lever.stiffness_n_m(), scene.probe.origin.c_str());
  const physics::Compliance& c = lever.compliance_nm_nn();
  if (c(0, 0) > 0) std::printf(", sideways %.4g N/m", 1.0 / c(0, 0));
  if (c(1, 1) > 0) std::printf(", lengthways %.4g N/m", 1.0 / c(1, 1));
  if (lever.mode())
    std::printf(", first mode %g kHz, Q %g", 1e-3 * lever.mode()->frequency_hz(), lever.mode()->quality());
  std::printf("\n");
}

double processor_s() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// As a Welcome would say it, for a station that plans without a server.
void write_limits(const std::shared_ptr<const scene::Scene>& scene, const std::string& path) {
  const slave::NveSlave slave(scene);
  const slave::SlaveLimits& from = slave.limits();
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016" PRIx64, scene->hash);
  config::SlaveLimits limits;
  limits.scene_name = scene->name;
  limits.scene_hash = hash;
  limits.workspace_min_w_nm = from.workspace_min_w_nm;
  limits.workspace_max_w_nm = from.workspace_max_w_nm;
  limits.start_pos_w_nm = from.start_pos_w_nm;
  limits.surface_z_w_nm = from.surface_z_w_nm;
  limits.force_max_nn = from.force_max_nn;
  limits.coupling_stiffness_n_m = from.coupling_stiffness_n_m;
  limits.coupling_damping_n_s_m = from.coupling_damping_n_s_m;
  limits.well_aj = from.well_aj;
  limits.rate_max_hz = from.rate_max_hz;
  config::write_slave_limits(limits, path);
}

void run(const std::string& path, const std::string& limits_path) {
  const auto begin = std::chrono::steady_clock::now();
  const double processor_before_s = processor_s();
  const auto scene = load_scene(path);
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
  const double processor_spent_s = processor_s() - processor_before_s;
  if (!limits_path.empty()) write_limits(scene, limits_path);
  const scene::Limits& limits = scene->limits;
  const scene::SceneSummary summary = scene::summarise(*scene);
  const double radius = scene->probe.tip_radius_nm;

  std::printf("%-14s %s (%s), hash %016" PRIx64 "\n", "scene", scene->name.c_str(), path.c_str(),
              scene->hash);
  print_material("sample", scene->sample);
  print_material("tip", scene->probe.tip);
  print_probe(*scene);
  std::printf("%-14s %s\n", "surface", scene->ground.text.c_str());
  if (scene->particle) {
    print_material("particle", scene->particle->material);
    std::printf("%-14s radius %g nm at (%g, %g) nm\n", "", scene->particle->parameters.particle_radius_nm,
                scene->particle->x_nm, scene->particle->y_nm);
  }

  std::printf("\n%-14s %s\n", "in", joined(summary.terms_in).c_str());
  std::printf("%-14s %s\n\n", "left out", joined(summary.terms_out).c_str());

  std::printf("%-14s %.6g (w = %g J/m2, K = %.6g GPa)\n", "lambda", summary.lambda,
              scene->law_parameters.work_of_adhesion_n_m, scene->law_parameters.contact_modulus_gpa);
  std::printf("%-14s %.6g nN on a flat, load control, all terms", "pull-off", summary.pull_off_nn);
  if (scene->law().long_range().active()) {
    std::printf(" (the dry contact alone: %.6g nN)", summary.dry_contact_pull_off_nn);
  }
  std::printf("\n");
  if (summary.pull_off_places > 0) {
    std::printf("%-14s %.4g to %.4g nN over the sample, half below %.4g (5 to 95 %% of %d places)\n", "",
                summary.pull_off_low_nn, summary.pull_off_high_nn, summary.pull_off_median_nn,
                summary.pull_off_places);
    std::printf("%-14s %.4g to %.4g nm over the sample, half below %.4g, the tip's own %g\n", "radius felt",
                summary.radius_low_nm, summary.radius_high_nm, summary.radius_median_nm, radius);
  }
  const char* head = "model error";
  for (const std::string& line : summary.model_errors) {
    std::printf("%-14s %s\n", head, line.c_str());
    head = "";
  }
  if (!scene->tiles_ahead.empty()) {
    std::size_t bytes = 0;
    for (const auto& ahead : scene->tiles_ahead) bytes += ahead->fields().bytes();
    std::printf(
        "%-14s made tile by tile where the tip comes: the scene with the first in %.3g s (%.3g s of "
        "processor time), %.3g MB with the places looked at above\n",
        "fields", spent.count(), processor_spent_s, 1e-6 * static_cast<double>(bytes));
  } else if (scene->potential) {
    std::printf("%-14s %s with the scene in %.3g s (%.3g s of processor time), %.3g MB for all sessions%s\n",
                "fields", scene->ground.fields_from_cache ? "taken from the cache" : "made", spent.count(),
                processor_spent_s, 1e-6 * static_cast<double>(scene->ground.fields_bytes),
                scene->marks ? ", and in each what its marks touch" : "");
  }
  const slave::PortGround port_ground(*scene);
  std::printf("%-14s at most %.4g aJ, at a radius of %.4g nm, %s\n", "adhesive well", port_ground.well_aj(),
              port_ground.well_radius_nm(),
              scene->surface->is_flat() ? "the tip's"
              : scene->potential        ? "the largest of the fields"
                                        : "ten times the tip's, the most that a pit may have");
  if (summary.jump_to_contact_nm > 0) {
    std::printf("%-14s jumps in from a gap of %.3g nm\n", "approach", summary.jump_to_contact_nm);
  }
  const physics::Compliance port = scene->port_compliance_nm_nn();
  std::printf("%-14s coupling %g N/m, along z with the probe %.4g N/m, damper %g N s/m\n", "stiffness",
              scene->coupling.stiffness_n_m, 1.0 / port(2, 2), scene->coupling.damping_n_s_m);
  std::printf("%-14s force %g nN, speed %g nm/s, rate %u Hz, time-out %u ms\n", "limits", limits.force_max_nn,
              limits.speed_max_nm_s, limits.rate_max_hz, scene->session_timeout_ms);
  std::printf(
      "%-14s overlap %.3g nm, contact %.4g N/m, shown %.4g N/m, mean pressure %.3g GPa, deflection %.4g nm\n",
      "at the limit", summary.overlap_at_limit_nm, summary.stiffness_at_limit_n_m,
      summary.shown_stiffness_n_m, summary.pressure_at_limit_gpa, summary.deflection_at_limit_nm);
  std::printf("%-14s a/R = %.3g unloaded, %.3g at the force limit\n", "contact",
              summary.unloaded_radius_nm / radius, summary.radius_at_limit_nm / radius);
  std::printf("%-14s [%.6g, %.6g] x [%.6g, %.6g] x [%.6g, %.6g] nm\n", "workspace",
              limits.workspace_min_w_nm.x(), limits.workspace_max_w_nm.x(), limits.workspace_min_w_nm.y(),
              limits.workspace_max_w_nm.y(), limits.workspace_min_w_nm.z(), limits.workspace_max_w_nm.z());
  std::printf("%-14s (%.6g, %.6g, %.6g) nm, touching at z = %.6g nm\n", "start", scene->start_apex_w_nm.x(),
              scene->start_apex_w_nm.y(), scene->start_apex_w_nm.z(), scene->start_touch_w_nm);
  std::fflush(stdout);
  config::require_stdout();
  for (const std::string& warning : summary.warnings) {
    std::fprintf(stderr, "telenano-nve: warning: %s: %s\n", path.c_str(), warning.c_str());
  }

  const Timing free = time_step(scene, kAbove_nm);
  const Timing touching = time_step(scene, kPressed_nm);
  std::printf("%-14s 10 nm above: p50 %.0f ns, p99 %.0f ns; pressed 5 nm: p50 %.0f ns, p99 %.0f ns\n",
              "time a step", free.p50_ns, free.p99_ns, touching.p50_ns, touching.p99_ns);
  print_costs(scene);
}

}  // namespace

void add_check_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "check", "Show what a scene computes, what it leaves out, and how long a step takes");
  auto path = std::make_shared<std::string>();
  command->add_option("--scene", *path, "Scene: a file (TOML) or the name of a supplied scene, e.g. flakes")
      ->required()
      ->type_name(config::kSceneOrFile);
  auto limits = std::make_shared<std::string>();
  command
      ->add_option("--limits", *limits,
                   "Also write the limits of this scene's slave, from which a station can plan its scaling "
                   "(TOML)")
      ->type_name("FILE");
  command->callback([path, limits] { run(*path, *limits); });
}

}  // namespace telenano::app
