#include "tests/studies/zwidth/zwidth_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/paper_table.h"
#include "tests/studies/zwidth/wall_simulation.h"

namespace telenano::studies {
namespace {

bool PaperConfiguration::*const kFactors[] = {&PaperConfiguration::damper, &PaperConfiguration::fast,
                                              &PaperConfiguration::fine, &PaperConfiguration::filtered};
constexpr const char* kFactorNames[] = {"damper in", "1 kHz for 100 Hz", "900 000 for 8 000 counts",
                                        "30 Hz filter"};

bool same(const PaperConfiguration& a, const PaperConfiguration& b) {
  return std::all_of(std::begin(kFactors), std::end(kFactors), [&](auto f) { return a.*f == b.*f; });
}

/// Stiffest wall and strongest damper of one configuration.
struct Reach {
  double stiffness = 0, damping = 0;
};
Reach reach(const std::vector<PaperRow>& rows, const PaperConfiguration& c) {
  Reach best;
  for (const PaperRow& row : rows) {
    if (!same(row.configuration, c) || !(row.values.simulated > 0)) continue;
    best.stiffness = std::max(best.stiffness, row.values.simulated);
    best.damping = std::max(best.damping, row.values.virtual_damping_n_s_m);
  }
  return best;
}

/// A wall that all configurations can show, far below their limits.
constexpr double kSoftWall_n_m = 100;

/// How much virtual damping 1 kHz and 100 Hz reach on it, with the damper.
struct DampingReach {
  double fast = 0, slow = 0;
};
DampingReach damping_reach(bool fine, bool filtered, bool feels) {
  const auto reach_of = [&](bool fast) {
    const ZWidthOptions o = PaperConfiguration{true, fast, fine, filtered}.options();
    WallPlant plant;
    plant.display = o.display;
    if (o.filter_hz > 0) plant.damper.filter_s = 1 / (2 * M_PI * o.filter_hz);
    plant.encoder_quantum_m = 1 / o.encoder_counts_per_m;
    return reachable_damping(plant, kSoftWall_n_m, feels);
  };
  return {reach_of(true), reach_of(false)};
}

std::string text_of(const DampingReach& reach) {
  return fmt::format("1 kHz {:.3g}, 100 Hz {:.3g} N s/m", reach.fast, reach.slow);
}

void write_cb04_beside(const FigureFolder& folder, const std::string& id, bool fine, bool filtered,
                       const std::vector<FactorGain>& gains) {
  // An 8 000-count encoder on a lever of 0.1 m, sampled at 1 kHz: the paper's own example.
  const double example_cm_s = 100 * (2 * M_PI / 8000) * 0.1 / 1e-3;
  const DampingReach seen = damping_reach(fine, filtered, false), felt = damping_reach(fine, filtered, true);
  const auto both = [](double stiffness, double damping) {
    return fmt::format("stiffness ×{:.2g}, damping ×{:.2g}", stiffness, damping);
  };
  std::vector<BesidePaper> beside{
      {"damper in", "raises the greatest stiffness and damping in all cases", "as printed", "CB section 5",
       both(gains[0].stiffness_least, gains[0].damping_least) + " at least",
       gains[0].stiffness_least > 1 && gains[0].damping_least > 1 ? "agrees" : "does not agree"},
      {"1 kHz for 100 Hz", "high stiffness needs a high rate", "as printed", "CB section 5",
       fmt::format("stiffness ×{:.2g} (median)", gains[1].stiffness_median),
       gains[1].stiffness_median > 1 ? "agrees" : "does not agree"},
      {"encoder resolution", "little effect on the limits", "as printed", "CB section 5",
       both(gains[2].stiffness_median, gains[2].damping_median) + " (medians)",
       std::fabs(gains[2].stiffness_median - 1) < 0.5 ? "agrees" : "does not agree"}};
  if (!filtered)
    beside.push_back(
        {"damping at 1 kHz, seen (0.5 mm and four counts)",
         "large damping is difficult to achieve at the high rate", "no axis in the text", "CB section 5",
         text_of(seen),
         seen.fast < seen.slow ? "agrees" : "does not agree: the swing is too small to be seen"});
  beside.push_back(
      {fmt::format("damping at 1 kHz, felt (force swings by {:g} N of {:g})", kFeltSwing_n, kFirmPush_n),
       filtered ? "a filter allows large damping with high stiffness"
                : "large damping is difficult to achieve at the high rate",
       "no axis in the text", "CB section 5", text_of(felt),
       filtered                ? fmt::format("×{:.2g} without the filter's noise",
                                             felt.fast / std::max(damping_reach(fine, false, true).fast, 1e-9))
       : felt.fast < felt.slow ? fmt::format("agrees: {:.2g} times as much at 100 Hz", felt.slow / felt.fast)
                               : "does not agree"});
  beside.push_back({"velocity of one count, 8 000 a turn, 0.1 m, 1 kHz", "7.8 cm/s", "0.05 cm/s",
                    "CB section 4", fmt::format("{:.3g} cm/s", example_cm_s),
                    fmt::format("{:+.2g} %", 100 * (example_cm_s / 7.8 - 1))});
  if (filtered)
    beside.push_back({"30 Hz filter", "helps virtual damping at high rates", "as printed", "CB figs. 4a–d",
                      fmt::format("damping ×{:.2g} (median), ×{:.2g} at most", gains[3].damping_median,
                                  gains[3].damping_most),
                      gains[3].damping_median > 1 ? "agrees" : "does not agree"});
  beside.push_back({"curves of K over B", "mass and damping lost from the text", "no axis in the text",
                    "CB figs. 4a–d", "in the caption, for 2 kg, 2 and 20 N s/m", "not comparable"});
  write_beside_paper(folder, id, beside);
}

double median(std::vector<double>& sorted) {
  std::sort(sorted.begin(), sorted.end());
  return 0.5 * (sorted[(sorted.size() - 1) / 2] + sorted[sorted.size() / 2]);
}

}  // namespace

std::vector<FactorGain> factor_gains(const std::vector<PaperRow>& rows) {
  std::vector<FactorGain> gains;
  for (std::size_t i = 0; i < std::size(kFactors); ++i) {
    std::vector<double> stiffness, damping;
    for (const PaperConfiguration& with : paper_configurations()) {
      if (!(with.*kFactors[i])) continue;
      PaperConfiguration without = with;
      without.*kFactors[i] = false;
      const Reach a = reach(rows, with), b = reach(rows, without);
      stiffness.push_back(a.stiffness / b.stiffness);
      damping.push_back(a.damping / b.damping);
    }
    FactorGain gain;
    gain.factor = kFactorNames[i];
    gain.stiffness_median = median(stiffness);
    gain.damping_median = median(damping);
    gain.stiffness_least = stiffness.front();
    gain.stiffness_most = stiffness.back();
    gain.damping_least = damping.front();
    gain.damping_most = damping.back();
    gains.push_back(gain);
  }
  return gains;
}

std::string factor_table(const std::vector<FactorGain>& gains) {
  std::string csv =
      "factor,stiffness_gain_least,stiffness_gain_median,stiffness_gain_most,damping_gain_least,"
      "damping_gain_median,damping_gain_most\n";
  for (const FactorGain& g : gains)
    csv +=
        fmt::format("{},{:.3g},{:.3g},{:.3g},{:.3g},{:.3g},{:.3g}\n", g.factor, g.stiffness_least,
                    g.stiffness_median, g.stiffness_most, g.damping_least, g.damping_median, g.damping_most);
  return csv;
}

Figure draw_zwidth(const ZWidthOptions& o, const std::vector<ZWidthRow>& rows, const std::string& id,
                   const FigureFolder& folder) {
  std::string text = std::string(kZWidthHeader) + "\n";
  for (const ZWidthRow& row : rows) text += csv(row) + "\n";
  folder.write(id + ".csv", "# " + text);
  Figure figure{id, "Z-width",
                fmt::format("Stiffest virtual wall: b = {:g} N s/m, m = {:g} kg, T = {:g} ms",
                            o.display.damping_n_s_m, o.display.mass_kg, 1e3 * o.display.period_s),
                ""};
  const std::string script = fmt::format(
      "set title {0} noenhanced\nset lmargin at screen 0.1\nset rmargin at screen 0.97\nset tmargin at "
      "screen 0.9\nset bmargin at screen 0.14\nset logscale y\nset xlabel 'virtual damping B (N s/m)'\nset "
      "ylabel 'virtual stiffness K (N/m)' offset 1,0\nplot '{1}.csv' using 1:2 with linespoints pt 7 ps 0.4 "
      "lc rgb '{2}' lw 2 title 'passive', '' using 1:4 with linespoints pt 7 ps 0.4 lc rgb '{3}' lw 1.4 "
      "title "
      "'worst mass-spring hand, eigenvalues', '' using 1:5 lc rgb '{4}' lw 1.4 dt (6,4) title 'free device, "
      "eigenvalues', '' using 1:6 with points pt 6 ps 1 lc rgb '{5}' title 'simulated'\n",
      studies::quoted(figure.caption), id, kBlue, kGreen, kGrey, kRed);
  folder.draw(figure, 800, 460, script);
  return figure;
}

Figure draw_cb03(const FigureFolder& folder) {
  // With the damper, so that a swing dies within a second; 1 kHz, 8 000 counts; wall damping of half of b.
  const ZWidthOptions o = PaperConfiguration{true, true, false, false}.options();
  WallPlant plant;
  plant.display = o.display;
  plant.damper.damping_n_s_m = 0.5 * o.display.damping_n_s_m;
  plant.encoder_quantum_m = 1 / o.encoder_counts_per_m;
  const double limit = simulated_stiffness(plant);
  // The hand that sets it off first.
  PushingHand worst;
  double most = 0;
  for (const PushingHand& hand : trying_hands(plant.display)) {
    const double swing = simulate_wall(plant, 1.5 * limit, hand).peak_to_peak_m;
    if (swing > most) {
      most = swing;
      worst = hand;
    }
  }
  std::vector<double> stable, unstable;
  simulate_wall(plant, 0.5 * limit, worst, &stable);
  simulate_wall(plant, 1.5 * limit, worst, &unstable);
  std::string rows = "# time_s,into_wall_mm at half of the limit,at 1.5 times it\n";
  const std::size_t count = std::min({stable.size(), unstable.size(), std::size_t{1000}});
  for (std::size_t i = 0; i < count; ++i)
    rows += fmt::format("{:.6g},{:.6g},{:.6g}\n", static_cast<double>(i) * plant.display.period_s,
                        1e3 * stable[i], 1e3 * unstable[i]);
  folder.write("cb03.csv", rows);
  const auto swing_mm = [](const std::vector<double>& trace) {
    const auto late = trace.end() - static_cast<std::ptrdiff_t>(trace.size() / 4);
    const auto [low, high] = std::minmax_element(late, trace.end());
    return 1e3 * (*high - *low);
  };
  write_beside_paper(
      folder, "cb03",
      {{"stable interaction", "no visually apparent sustained oscillation", "no axis in the text",
        "CB section 5, fig. 3", fmt::format("{:.2g} mm peak to peak in the last quarter", swing_mm(stable)),
        swing_mm(stable) < 0.5 ? "agrees" : "does not agree"},
       {"unstable interaction", "visually apparent sustained oscillation", "no axis in the text",
        "CB section 5, fig. 3", fmt::format("{:.2g} mm peak to peak in the last quarter", swing_mm(unstable)),
        swing_mm(unstable) > 0.5 ? "agrees" : "does not agree"}});
  Figure figure{
      "cb03", "Stable and unstable interaction with a virtual wall",
      fmt::format(
          "Simulated: a hand ({:.2g} kg, resonance with the device at {:.3g} Hz) leans with {:g} N on a "
          "virtual wall with B = {:g} N s/m; device with its damper (b = {:g} N s/m, m = {:g} kg), 1 "
          "kHz, 8 000 counts a turn. Least stiffness that some hand sets off: {:.4g} N/m. At half of it the "
          "swing dies down, at 1.5 times it grows until the handle leaves the wall and bounces: the two "
          "kinds that CB show. Theirs were felt by people on a real crank; time and length scales are "
          "not comparable.",
          worst.arm.mass_kg,
          std::sqrt(worst.arm.stiffness_n_m / (o.display.mass_kg + worst.arm.mass_kg)) / (2 * M_PI),
          worst.push_n, plant.damper.damping_n_s_m, o.display.damping_n_s_m, o.display.mass_kg, limit),
      ""};
  const std::vector<Panel> panels{{"in the wall (mm), stable",
                                   {fmt::format("'cb03.csv' using 1:2 lc rgb '{}' lw 1 notitle", kBlue)},
                                   "set ytics 0.05\nset ylabel offset -0.5,0\n"},
                                  {"in the wall, unstable",
                                   {fmt::format("'cb03.csv' using 1:3 lc rgb '{}' lw 1 notitle", kRed)},
                                   "set ytics 0.2\nset ylabel offset -0.5,0\n"}};
  folder.draw(figure, 1000, 480,
              "set multiplot\n" + column_of_panels(panels, {0.09, 0.98, 0.95, 0.13, 0.06, true, "0:1"}, ""));
  return figure;
}

Figure draw_cb04(char part, const FigureFolder& folder) {
  const bool fine = part == 'a' || part == 'c';
  const bool filtered = part == 'c' || part == 'd';
  run_paper_study(folder.path().string());
  const std::vector<PaperRow> rows = read_paper_study(folder.path().string());
  const std::string id = std::string("cb04") + part;
  std::string data =
      std::string("# ") + kZWidthHeader + "; blocks: damper 1 kHz, damper 100 Hz, bare 1 kHz, bare 100 Hz\n";
  std::string curves, found;
  int block = 0;
  constexpr const char* kColours[] = {kBlue, kGreen, kRed, kPurple};
  for (const bool damper : {true, false}) {
    for (const bool fast : {true, false}) {
      const PaperConfiguration c{damper, fast, fine, filtered};
      for (const PaperRow& row : rows)
        if (same(row.configuration, c)) data += csv(row.values) + "\n";
      data += "\n\n";
      const Reach r = reach(rows, c);
      const std::string name =
          fmt::format("{}, {}", damper ? "damper" : "no damper", fast ? "1 kHz" : "100 Hz");
      curves += fmt::format(
          "{0}'{1}.csv' index {2} using 1:6 with linespoints pt 7 ps 0.5 lc rgb '{3}' lw 1.8 title '{4}', "
          "'' index {2} using 1:2 lc rgb '{3}' lw 1.2 dt (6,4) notitle, "
          "'' index {2} using 1:4 lc rgb '{3}' lw 1.5 dt (2,3) notitle",
          block == 0 ? "plot " : ", ", id, block, kColours[block], name);
      found += fmt::format(" {}: to {:.3g} N/m and {:.3g} N s/m.", name, r.stiffness, r.damping);
      ++block;
    }
  }
  // The legend names the colours, then, in black, the three kinds of line: twelve entries in one list were not read.
  curves +=
      ", NaN with linespoints pt 7 ps 0.5 lc rgb 'black' lw 1.8 title 'simulated', NaN lc rgb 'black' lw 1.2 "
      "dt (6,4) title 'passive (CB)', NaN lc rgb 'black' lw 1.5 dt (2,3) title 'worst hand'";
  folder.write(id + ".csv", data);
  const std::vector<FactorGain> gains = factor_gains(rows);
  folder.write("zwidth_factors.csv", factor_table(gains));
  write_cb04_beside(folder, id, fine, filtered, gains);
  std::string answer;
  switch (part) {
    case 'a':
      answer = fmt::format(
          " Agrees with CB: the damper raises stiffness and damping in every configuration (×{:.2g} and "
          "×{:.2g}, "
          "medians over all sixteen), and stiffness needs the high rate (×{:.2g}).",
          gains[0].stiffness_median, gains[0].damping_median, gains[1].stiffness_median);
      break;
    case 'b':
      answer = fmt::format(
          " Agrees with CB: resolution hardly moves the limits (fine over coarse: stiffness ×{:.2g}, damping "
          "×{:.2g}, medians); it changes the size of limit cycles. CB found large damping hard to reach at "
          "1 kHz for the noise of differentiation: here that is felt and not seen, since a limit cycle of a "
          "few "
          "counts (118 µm each) stays below the 0.5 mm that count as unstable. On a wall of {:g} N/m damping "
          "reaches, seen, {}; where a firm hand must not feel the force swing by {:g} of {:g} N: {}.",
          gains[2].stiffness_median, gains[2].damping_median, kSoftWall_n_m,
          text_of(damping_reach(false, false, false)), kFeltSwing_n, kFirmPush_n,
          text_of(damping_reach(false, false, true)));
      break;
    case 'c':
      answer = fmt::format(
          " Agrees with CB: the filter allows more virtual damping, most at the high rate (×{:.2g} median, "
          "up "
          "to ×{:.2g}).",
          gains[3].damping_median, gains[3].damping_most);
      break;
    default:
      answer =
          " Agrees with CB: with the filter the coarse encoder does as well as the fine one (by this measure "
          "a little better).";
      break;
  }
  Figure figure{
      id,
      fmt::format("Z-width, {} encoder, {}", fine ? "900 000-count" : "8 000-count",
                  filtered ? "velocity filtered at 30 Hz" : "no velocity filter"),
      fmt::format(
          "Stiffest wall over its virtual damping. Solid: simulated, no hand sustains a swing of 0.5 mm "
          "and four counts; dashed: CB's theorem; dotted: worst mass–spring hand by eigenvalues.{}{} "
          "Mass and damping are assumed (2 kg, 2 and 20 N s/m): the text of the paper has lost them, so "
          "shapes and ratios compare, absolute numbers do not.",
          found, answer),
      ""};
  folder.draw(
      figure, 1000, 480,
      "set lmargin at screen 0.1\nset rmargin at screen 0.64\nset tmargin at screen 0.96\nset bmargin "
      "at screen 0.13\nset logscale xy\nset xrange [0.2:*]\nset xlabel 'virtual damping B (N "
      "s/m)'\nset ylabel 'virtual stiffness K (N/m)' offset 1,0\nset key at graph 1.02, graph 1 top "
      "left Left reverse samplen 2.5\n" +
          curves + "\n");
  return figure;
}

PlotTarget plot_target(const std::string& file, const std::string& command) {
  const std::filesystem::path path(file);
  if (path.extension() != ".svg" || path.stem().empty())
    throw UserError(fmt::format("{}: --plot: '{}' must end in .svg", command, file));
  PlotTarget target{FigureFolder(path.has_parent_path() ? path.parent_path() : std::filesystem::path(".")),
                    path.stem().string()};
  if (!target.folder.has_gnuplot())
    throw UserError(fmt::format("{}: --plot: gnuplot is not installed", command));
  return target;
}

}  // namespace telenano::studies
