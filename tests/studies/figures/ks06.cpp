#include "tests/studies/figures/ks06.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/error.h"
#include "tests/studies/report/gnuplot.h"

namespace telenano::studies {
namespace {

constexpr double kTipRadius_nm = 20;
constexpr double kTipModulus_gpa = 160;
constexpr double kTipPoisson = 0.27;
constexpr double kTipEnergy_j_m2 = 0.2;
constexpr double kTipContactAngle_deg = 20;  // of water on silicon with its native oxide
constexpr double kHumidity_percent = 50;
constexpr int kSteps = 8000;

physics::TipSampleLaw law_of(const Ks06Sample& s, double humidity_percent) {
  physics::TipSampleParameters p;
  p.contact_modulus_gpa =
      4.0 / 3.0 / ((1 - kTipPoisson * kTipPoisson) / kTipModulus_gpa + (1 - s.nu * s.nu) / s.e_gpa);
  p.work_of_adhesion_n_m = 2 * std::sqrt(kTipEnergy_j_m2 * s.gamma);
  p.long_range.capillary.humidity_percent = humidity_percent;
  p.long_range.capillary.contact_angle_tip_deg = kTipContactAngle_deg;
  p.long_range.capillary.contact_angle_sample_deg = s.contact_angle_deg;
  return physics::TipSampleLaw(p);
}

}  // namespace

const std::vector<Ks06Sample>& ks06_samples() {
  // Table I of the paper; contact angles of water are textbook values.
  static const std::vector<Ks06Sample> samples{{"silicon oxide", 70, 0.2, 0.27, 20, 3, 0.6},
                                               {"polystyrene", 2, 0.066, 0.4, 90, 4, 2.5},
                                               {"PDMS", 0.001, 0.022, 0.5, 105, 220, 120}};
  return samples;
}

ForceDistance ks06_curve(const Ks06Sample& sample, double humidity_percent) {
  const physics::TipSampleLaw law = law_of(sample, humidity_percent);
  ForceDistance curve;
  curve.sample = sample.name;
  curve.lambda = law.lambda(kTipRadius_nm);
  curve.snap_in_nm = std::nan("");
  physics::TipSampleState state;
  const double step = (sample.far_nm + sample.deep_nm) / kSteps;
  double last = 0;
  const auto go = [&](int i) {
    const double distance = sample.far_nm - step * i;
    const physics::Equilibrium e = law.advance(-distance, 0.0, kTipRadius_nm, state);
    if (e.status != physics::SolveStatus::kOk)
      throw RunError(fmt::format("ks06: no state at {} nm", distance));
    return std::pair{ForceDistance::Row{distance, e.force_nn}, e};
  };
  const auto inside = [](physics::Branch b) {
    return b == physics::Branch::kContact || b == physics::Branch::kNonContact;
  };
  bool was_inside = false;
  for (int i = 0; i <= kSteps; ++i) {
    const auto [row, e] = go(i);
    if (inside(e.branch) && !was_inside && e.jumps > 0) {
      curve.snap_in_nm = row.distance_nm;
      curve.snap_in_nn = row.force_nn - last;
    }
    was_inside = inside(e.branch);
    last = row.force_nn;
    curve.approach.push_back(row);
  }
  for (int i = kSteps; i >= 0; --i) {
    const auto [row, e] = go(i);
    curve.pull_off_nn = std::max(curve.pull_off_nn, -row.force_nn);
    if (inside(e.branch) || e.bridge) curve.let_go_nm = row.distance_nm;
    curve.retract.push_back(row);
  }
  // Area by the trapezium rule; a jump is smeared over one step.
  const auto area = [&](const std::vector<ForceDistance::Row>& rows) {
    double sum = 0;
    for (std::size_t i = 1; i < rows.size(); ++i)
      sum -=
          0.5 * (rows[i].force_nn + rows[i - 1].force_nn) * (rows[i].distance_nm - rows[i - 1].distance_nm);
    return sum;
  };
  curve.loop_aj = area(curve.approach) + area(curve.retract);
  return curve;
}

Figure draw_ks06(const FigureFolder& folder) {
  std::string csv =
      "# distance_nm,force_nn; blocks: sample by sample dry approach, dry retract, humid approach, humid "
      "retract\n";
  std::string script = "set multiplot layout 1,3\n";
  std::string found;
  int block = 0;
  int panel = 0;
  for (const Ks06Sample& sample : ks06_samples()) {
    const ForceDistance dry = ks06_curve(sample, 0);
    const ForceDistance humid = ks06_curve(sample, kHumidity_percent);
    double low = 0;
    for (const ForceDistance* curve : {&dry, &humid}) {
      for (const auto* rows : {&curve->approach, &curve->retract}) {
        for (std::size_t i = 0; i < rows->size(); ++i) {
          const ForceDistance::Row& row = (*rows)[i];
          // Every fifth point, and all about a jump, so that its edge is upright in the picture.
          const bool edge =
              (i > 0 && std::fabs(row.force_nn - (*rows)[i - 1].force_nn) > 0.02 * curve->pull_off_nn) ||
              (i + 1 < rows->size() &&
               std::fabs(row.force_nn - (*rows)[i + 1].force_nn) > 0.02 * curve->pull_off_nn);
          if (i % 5 == 0 || edge) csv += fmt::format("{:.7g},{:.7g}\n", row.distance_nm, row.force_nn);
          low = std::min(low, row.force_nn);
        }
        csv += "\n\n";
      }
    }
    const double left = 0.07 + 0.315 * panel;
    script += fmt::format(
        "set lmargin at screen {:.3f}\nset rmargin at screen {:.3f}\nset tmargin at screen 0.90\nset bmargin "
        "at screen "
        "0.14\nset title {} noenhanced offset 0,-0.4\nset xlabel 'distance of the tip (nm)' offset "
        "0,0.3\n{}set xrange "
        "[{}:{}]\nset xtics autofreq\n{}\nset key bottom right\n",
        left, left + 0.26, quoted(fmt::format("{}, λ = {:.3g}", sample.name, dry.lambda)),
        panel == 0 ? "set ylabel 'force on the tip (nN)' offset 1,0\n" : "unset ylabel\n", -sample.deep_nm,
        sample.far_nm, y_range(1.05 * low, -0.6 * low));
    script += fmt::format(
        "plot 'ks06.csv' index {} lc rgb '{}' lw 1 dt (4,3) title 'approach, dry', '' index {} lc rgb '{}' "
        "lw 1 dt (4,3) "
        "title 'retract, dry', '' index {} lc rgb '{}' lw 1.8 title 'approach, {:g} % RH', '' index {} lc "
        "rgb '{}' lw "
        "1.8 title 'retract, {:g} % RH'\n",
        block, kBlue, block + 1, kRed, block + 2, kBlue, kHumidity_percent, block + 3, kRed,
        kHumidity_percent);
    block += 4;
    ++panel;
    found += fmt::format(
        " {}: {}; greatest attraction {:.4g} nN dry, {:.4g} nN humid; lets go at {:.3g} nm dry, {:.3g} nm "
        "humid; a loop "
        "costs {:.3g} aJ dry, {:.3g} aJ humid.",
        sample.name,
        std::isfinite(dry.snap_in_nm)
            ? fmt::format("snaps in at {:.3g} nm by {:.3g} nN", dry.snap_in_nm, dry.snap_in_nn)
            : std::string("goes in without a jump"),
        dry.pull_off_nn, humid.pull_off_nn, dry.let_go_nm, humid.let_go_nm, dry.loop_aj, humid.loop_aj);
  }
  folder.write("ks06.csv", csv);
  Figure figure{
      "ks06", "Force against distance",
      "Silicon tip of 20 nm on a rigid probe: van der Waals outside joined to Maugis–Dugdale inside, and a "
      "liquid bridge at 50 % relative humidity (contact angles of water 20° on the tip; 20°, 90°, 105° on "
      "the "
      "samples)." +
          found +
          " On PDMS the contact at rest is wider than the tip (a₀/R = 4.1): half-space theory is formal "
          "there.",
      ""};
  folder.draw(figure, 1200, 420, script);
  return figure;
}

}  // namespace telenano::studies
