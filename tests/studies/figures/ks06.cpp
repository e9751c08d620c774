#include "tests/studies/figures/ks06.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/paper_table.h"

namespace telenano::studies {
namespace {

/// As table I of the paper prints it.
constexpr const char* kPaperTable[] = {"70 GPa, 0.2 J/m2, 0.27", "2 GPa, 0.066 J/m2, 0.4",
                                       "0.001 GPa, 0.022 J/m2, 0.5"};
constexpr double kTipRadius_nm = 20;
constexpr double kTipModulus_gpa = 160;
constexpr double kTipPoisson = 0.27;
constexpr double kTipEnergy_j_m2 = 0.2;
constexpr double kTipContactAngle_deg = 20;  // of water on silicon with its native oxide
constexpr double kHumidity_percent = 50;
constexpr double kLever_n_m = 10;
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
  static const std::vector<Ks06Sample> samples{{"silicon oxide", 70, 0.2, 0.27, 20, 3, 0.6, 8, 6},
                                               {"polystyrene", 2, 0.066, 0.4, 90, 4, 2.5, 6, 5},
                                               {"PDMS", 0.001, 0.022, 0.5, 105, 220, 120, 220, 120}};
  return samples;
}

ForceDistance ks06_curve(const Ks06Sample& sample, double humidity_percent, double stiffness_n_m) {
  const physics::TipSampleLaw law = law_of(sample, humidity_percent);
  const bool rigid = stiffness_n_m == 0;
  const double compliance = rigid ? 0.0 : 1 / stiffness_n_m;
  const double far = rigid ? sample.far_nm : sample.lever_far_nm;
  const double deep = rigid ? sample.deep_nm : sample.lever_deep_nm;
  ForceDistance curve;
  curve.sample = sample.name;
  curve.lambda = law.lambda(kTipRadius_nm);
  curve.snap_in_nm = std::nan("");
  physics::TipSampleState state;
  const double step = (far + deep) / kSteps;
  const auto go = [&](int i) {
    const double distance = far - step * i;
    const physics::Equilibrium e = law.advance(-distance, compliance, kTipRadius_nm, state);
    if (e.status != physics::SolveStatus::kOk)
      throw RunError(fmt::format("ks06: no state at {} nm", distance));
    curve.dissipated_aj += e.dissipated_aj;
    return std::pair{ForceDistance::Row{distance, e.force_nn}, e};
  };
  const auto inside = [](physics::Branch b) {
    return b == physics::Branch::kContact || b == physics::Branch::kNonContact;
  };
  bool was_inside = false;
  double last = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const auto [row, e] = go(i);
    if (inside(e.branch) && !was_inside && e.jumps > 0) {
      curve.snap_in_nm = row.distance_nm;
      curve.snap_in_nn = row.force_nn - last;
      curve.before_snap_in_nn = last;
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

namespace {

/// The points of one direction: every fifth, and all about a jump, so that its edge is upright in the
/// picture.
std::string points_of(const std::vector<ForceDistance::Row>& rows, double pull_off_nn) {
  std::string csv;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto jump = [&](std::size_t a, std::size_t b) {
      return std::fabs(rows[a].force_nn - rows[b].force_nn) > 0.02 * pull_off_nn;
    };
    const bool edge = (i > 0 && jump(i, i - 1)) || (i + 1 < rows.size() && jump(i, i + 1));
    if (i % 5 == 0 || edge) csv += fmt::format("{:.7g},{:.7g}\n", rows[i].distance_nm, rows[i].force_nn);
  }
  return csv + "\n\n";
}

}  // namespace

Figure draw_ks06(const FigureFolder& folder) {
  std::string csv =
      "# distance_nm,force_nn; blocks: rigid, then on a cantilever; sample by sample; dry approach, dry "
      "retract, humid approach, humid retract\n";
  std::string script = "set multiplot\n";
  std::string found;
  std::vector<BesidePaper> beside;
  int block = 0;
  for (int row = 0; row < 2; ++row) {
    const double stiffness = row == 0 ? 0 : kLever_n_m;
    int column = 0;
    for (const Ks06Sample& sample : ks06_samples()) {
      const ForceDistance dry = ks06_curve(sample, 0, stiffness);
      const ForceDistance humid = ks06_curve(sample, kHumidity_percent, stiffness);
      for (const ForceDistance* curve : {&dry, &humid})
        csv += points_of(curve->approach, curve->pull_off_nn) + points_of(curve->retract, curve->pull_off_nn);
      const double most = std::max(dry.pull_off_nn, humid.pull_off_nn);
      const double left = 0.07 + 0.315 * column;
      const double top = row == 0 ? 0.90 : 0.44;
      script += fmt::format(
          "set lmargin at screen {:.3f}\nset rmargin at screen {:.3f}\nset tmargin at screen {:.3f}\nset "
          "bmargin at screen {:.3f}\nset title {} noenhanced offset 0,-0.5\n{}{}set xrange [{}:{}]\n{}\n",
          left, left + 0.26, top, top - 0.34,
          quoted(row == 0 ? fmt::format("{}, λ = {:.3g}, rigid probe", sample.name, dry.lambda)
                          : fmt::format("{}, cantilever of {:g} N/m", sample.name, kLever_n_m)),
          row == 1 ? "set xlabel 'distance of the base (nm)' offset 0,0.3\n" : "unset xlabel\n",
          column == 0 ? "set ylabel 'force on the tip (nN)' offset 1,0\n" : "unset ylabel\n",
          -(row == 0 ? sample.deep_nm : sample.lever_deep_nm), row == 0 ? sample.far_nm : sample.lever_far_nm,
          y_range(-1.05 * most, 0.6 * most));
      script += row == 0 && column == 0 ? "set key top right Right vertical samplen 2 spacing 1.1\n"
                                        : "unset key\n";
      script += fmt::format(
          "plot 'ks06.csv' index {} lc rgb '{}' lw 1 dt (4,3) title 'approach, dry', '' index {} lc rgb '{}' "
          "lw 1 dt (4,3) title 'retract, dry', '' index {} lc rgb '{}' lw 1.8 title 'approach, {:g} % RH', "
          "'' index {} lc rgb '{}' lw 1.8 title 'retract, {:g} % RH'\n",
          block, kBlue, block + 1, kRed, block + 2, kBlue, kHumidity_percent, block + 3, kRed,
          kHumidity_percent);
      block += 4;
      ++column;
      if (row == 0) {
        beside.push_back({sample.name + std::string(": Young's modulus, surface energy, Poisson's ratio"),
                          kPaperTable[column - 1], "half of the last digit", "KS table I",
                          fmt::format("{:g} GPa, {:g} J/m2, {:g}", sample.e_gpa, sample.gamma, sample.nu),
                          "0 (taken from there)"});
        beside.push_back({sample.name + std::string(": way out against way in"),
                          "a curve with hysteresis, from approach and retraction", "no axis in the text",
                          "KS fig. 6", fmt::format("a dry loop costs {:.3g} aJ", dry.loop_aj),
                          dry.loop_aj > 0 ? "agrees in kind" : "does not agree"});
        found += fmt::format(
            " {}: greatest attraction {:.4g} nN dry, {:.4g} nN humid; lets go at {:.3g} nm dry, {:.3g} nm "
            "humid; a loop costs {:.3g} aJ dry, {:.3g} aJ humid.",
            sample.name, dry.pull_off_nn, humid.pull_off_nn, dry.let_go_nm, humid.let_go_nm, dry.loop_aj,
            humid.loop_aj);
      } else if (std::isfinite(dry.snap_in_nm)) {
        found += fmt::format(
            " On the cantilever the tip snaps into {} at {:.3g} nm, by {:.3g} nN (dry), and a loop costs "
            "{:.3g} "
            "aJ dry, {:.3g} aJ humid.",
            sample.name, dry.snap_in_nm, dry.snap_in_nn, dry.loop_aj, humid.loop_aj);
      }
    }
  }
  folder.write("ks06.csv", csv);
  beside.push_back({"model", "Maugis–Dugdale in contact, van der Waals and capillary outside", "as printed",
                    "KS section II.C", "the same", "agrees"});
  beside.push_back({"greatest attraction of each sample", "not stated; tip radius not stated",
                    "no axis in the text", "KS fig. 6", "in the caption, for a tip of 20 nm",
                    "not comparable"});
  write_beside_paper(folder, "ks06", beside);
  Figure figure{
      "ks06", "Force against distance",
      "Silicon tip of 20 nm: van der Waals outside joined to Maugis–Dugdale inside, and a liquid bridge at "
      "50 % relative humidity (contact angles of water 20° on the tip; 20°, 90°, 105° on the samples), under "
      "which the contact is that of w − 2γc; it forms where the energy falls by it, so on the soft samples, "
      "whose dry contact holds more, not at all. Rigid probe:" +
          found +
          " On PDMS the contact at rest is wider than the tip (a₀/R = 4.1): half-space theory is formal "
          "there.",
      ""};
  folder.draw(figure, 1200, 760, script);
  return figure;
}

}  // namespace telenano::studies
