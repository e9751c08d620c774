#include <fmt/format.h>

#include <cmath>

#include "tests/studies/coupling/mode_table.h"
#include "tests/studies/precision/studies.h"

namespace telenano::studies {
namespace {

const char* method_name(physics::ModeIntegrator method) {
  switch (method) {
    case physics::ModeIntegrator::kBackwardEuler:
      return "backward Euler";
    case physics::ModeIntegrator::kHeldForce:
      return "exact, force held";
    case physics::ModeIntegrator::kMeanForce:
      break;
  }
  return "exact, mean force";
}

}  // namespace

Section probe_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "probe";
  section.title = "The probe's own oscillation";
  section.lead =
      "A cantilever's first mode (Q = 50) released 1 nm inside a spring contact: largest deviation of the "
      "deflection over two periods, of the largest deflection, against the closed form of the oscillator "
      "with both springs.";
  section.choice =
      "Default: exact propagation with the mean of the forces before and after the step while ω₀ dt is below "
      "1. It is of second order and exact for the free lever, so that the pitch and decay of a ring-down are "
      "right; where the samples are too far apart to show the oscillation at all, backward Euler takes over, "
      "which goes to the static balance at once.";
  std::vector<Line> lines;
  for (const ModeRow& mode : mode_table(!effort.quick)) {
    const std::string condition =
        mode.stiffness_ratio == 0
            ? std::string("free lever")
            : fmt::format("contact {:g} times as stiff as the lever", mode.stiffness_ratio);
    Row row{condition,
            method_name(mode.method),
            fmt::format("ω₀ dt = {:.3g}", mode.omega_dt),
            mode.method == physics::ModeIntegrator::kMeanForce,
            {},
            {}};
    row.errors.largest = row.errors.p99 = row.errors.median = mode.error;
    row.errors.points = 1;
    row.cost = {mode.ns_a_step, mode.ns_a_step};
    section.rows.push_back(row);
    if (lines.empty() || lines.back().panel != condition || lines.back().name != row.family)
      lines.push_back({condition, row.family, {}, {}});
    lines.back().x.push_back(mode.omega_dt);
    lines.back().y.push_back(mode.error);
  }
  section.figures.push_back(log_line_figure(
      {"probe", "Error against the step",
       "A line for each integrator; the free lever is exact, to rounding, with both exact ones.", ""},
      lines, {"step times the lever's angular frequency", "largest relative error", ""}, folder));
  return section;
}

}  // namespace telenano::studies
