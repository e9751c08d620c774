#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/control/scaling.h"
#include "tests/studies/parse_list.h"
#include "tests/studies/zwidth/scaling_study.h"
#include "tests/studies/zwidth/zwidth_command.h"
#include "tests/studies/zwidth/zwidth_figures.h"

namespace telenano::studies {
namespace {

struct Arguments {
  control::ScalingPlant plant;
  std::string velocity_scale = "1e-7,1e-6,1e-5";
  double force_limit_n = 12.0;
  double safety = 0.8;
  double nve_force_nn = 100.0;
  double mass_kg = 0.25;
  std::string plot;
};

void require(bool good, const char* flag, double value, const char* expected) {
  if (!good)
    throw UserError(fmt::format("scaling: {}: {:g} is out of range; expected {}", flag, value, expected));
}

void run(const Arguments& a) {
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  const auto not_negative = [](double x) { return std::isfinite(x) && x >= 0; };
  const control::ScalingPlant& p = a.plant;
  require(positive(p.device_damping_n_s_m), "--damping", p.device_damping_n_s_m, "> 0 N s/m");
  require(positive(p.period_s) && p.period_s <= 1, "--period-s", p.period_s, "(0, 1] s");
  require(positive(p.coupling_stiffness_n_m), "--coupling-stiffness", p.coupling_stiffness_n_m, "> 0 N/m");
  require(not_negative(p.coupling_damping_n_s_m), "--coupling-damping", p.coupling_damping_n_s_m,
          ">= 0 N s/m");
  require(not_negative(p.adaptive_damping_n_s_m), "--adaptive-damping", p.adaptive_damping_n_s_m,
          ">= 0 N s/m");
  require(positive(a.force_limit_n), "--force-limit-n", a.force_limit_n, "> 0 N");
  require(a.safety > 0 && a.safety < 1, "--safety", a.safety, "(0, 1)");
  require(positive(a.nve_force_nn), "--nve-force-nn", a.nve_force_nn, "> 0 nN");
  require(positive(a.mass_kg), "--mass", a.mass_kg, "> 0 kg");
  require(p.delay_samples >= 0 && p.delay_samples <= 10000, "--delay-samples", p.delay_samples, "0 to 10000");
  const std::vector<double> list = parse_list(a.velocity_scale, "scaling: --velocity-scale");
  for (const double scale : list) require(positive(scale), "--velocity-scale", scale, "> 0");

  const double published = control::llewellyn_impedance_bound(p);
  const double exact = control::exact_impedance_bound(p);
  const double device = control::device_force_scale_bound(a.safety, a.force_limit_n, a.nve_force_nn);
  std::puts(
      "velocity_scale,force_scale_llewellyn,force_scale_sampled,force_scale_device,recommended,binding");
  for (const double scale : list) {
    const double sampled = std::max(0.0, exact / scale);  // γ beyond b leaves nothing that is safe
    fmt::print("{:.10g},{:.10g},{:.10g},{:.10g},{:.10g},{}\n", scale, published / scale, sampled, device,
               std::min(sampled, device), sampled < device ? "sampled" : "device");
  }
  if (a.plot.empty()) return;
  const PlotTarget target = plot_target(a.plot, "scaling");
  const Figure figure = draw_scaling_region(scaling_region(p, a.mass_kg, device), target.id, target.folder);
  fmt::print(stderr, "scaling: {}\n", figure.caption);
}

}  // namespace

void add_scaling_command(CLI::App& app) {
  auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "scaling", "Allowed region of the force scale (Kim & Sitti, fig. 12), as published and exact, as CSV");
  command->add_option("--damping", a->plant.device_damping_n_s_m, "b of the device, N s/m")
      ->capture_default_str();
  command->add_option("--period-s", a->plant.period_s, "Sample period T, s")->capture_default_str();
  a->plant.coupling_stiffness_n_m = 20.0;
  command->add_option("--coupling-stiffness", a->plant.coupling_stiffness_n_m, "k_c at the tip, N/m")
      ->capture_default_str();
  command->add_option("--coupling-damping", a->plant.coupling_damping_n_s_m, "b_c at the tip, N s/m")
      ->capture_default_str();
  command
      ->add_option("--adaptive-damping", a->plant.adaptive_damping_n_s_m,
                   "gamma of the passivity controller, N s/m at the hand")
      ->capture_default_str();
  command
      ->add_option("--velocity-scale", a->velocity_scale,
                   "Velocity scales alpha_v, separated by commas; one row each")
      ->capture_default_str();
  command->add_option("--force-limit-n", a->force_limit_n, "Largest force of the haptic device")
      ->capture_default_str();
  command->add_option("--safety", a->safety, "Safety factor epsilon: the usable fraction of --force-limit-n")
      ->capture_default_str();
  command->add_option("--nve-force-nn", a->nve_force_nn, "Largest force at the tip")->capture_default_str();
  command->add_option("--mass", a->mass_kg, "m of the device, kg; does not enter any bound")
      ->capture_default_str();
  command->add_option("--delay-samples", a->plant.delay_samples, "d of the whole loop, samples")
      ->capture_default_str();
  command->add_option("--plot", a->plot,
                      "FILE.svg: also plot the region with simulated instability points, with gnuplot");
  command->footer(
      "force_scale_* is the largest alpha_F at that alpha_v. llewellyn: as published. sampled: the exact "
      "bound for any\ndiscrete-passive environment behind the coupling, with delay. device: safety x force "
      "limit / NVE force.\nrecommended: the smaller of sampled and device; binding: which of the two it is.");
  command->callback([a] { run(*a); });
}

}  // namespace telenano::studies
