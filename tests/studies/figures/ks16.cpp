#include "tests/studies/figures/ks16.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/paper_table.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies {
namespace {

// Times of the script, s: (b) first, then three indents of (c).
constexpr double kContactBegins_s = 2.5;
constexpr double kContactEnds_s = 4.5;
constexpr double kIndent_s = 4;
constexpr double kHeld_n = 0.05;                 // by the sample, where the tip has not let go
constexpr double kIndents_nm[] = {-4, -8, -12};  // as intended: hand and springs yield

std::vector<device::IntendedMotion::Waypoint> script(double start_nm) {
  std::vector<device::IntendedMotion::Waypoint> points{{0, Vec3(0, 0, start_nm)}};
  const auto go = [&](double t, double z) { points.push_back({t, Vec3(0, 0, z)}); };
  go(2, -0.5);
  go(kContactEnds_s, -0.5);
  go(6, 15);
  double t = 6;
  for (const double depth : kIndents_nm) {
    go(t + 1.5, depth);
    go(t + 2.5, depth);
    go(t += kIndent_s, 15);
  }
  return points;
}

}  // namespace

Indents run_ks16(const std::string& scene_path) {
  support::VirtualSessionConfig config;
  config.scene = scene::load_scene(scene_path);
  config.task = device::Task::kScript;
  config.script = script(config.scene->start_apex_w_nm.z() - config.scene->start_touch_w_nm);
  support::VirtualSession session(config);
  Indents result;
  result.sample = config.scene->sample.name;
  const double surface = config.scene->start_touch_w_nm;
  double sum = 0;
  int count = 0;
  session.run(1'000'000, [&](const recording::Sample& s) {
    if (!session.device().motion_started()) return;
    const double t = session.device().motion_time_s();
    const double force = s.hand_force_commanded_h_n[2];
    const double height = s.tip_pos_w_nm[2] - surface;
    result.rows.push_back({t, height, force});
    if (t > kContactBegins_s && t < kContactEnds_s) {
      sum += force;
      ++count;
    }
    result.deepest_nm = std::max(result.deepest_nm, -height);
    result.greatest_n = std::max(result.greatest_n, force);
    result.pull_off_n = std::max(result.pull_off_n, -force);
    result.hand_work_mj = 1e3 * s.energy_j;
  });
  result.contact_n = count > 0 ? sum / count : std::nan("");
  return result;
}

const char* agrees_on_rubber(double rubber_n, double other_n) {
  return rubber_n > 0 && rubber_n < other_n ? "agrees" : "does not agree";
}

Figure draw_ks16(const FigureFolder& folder) {
  const Indents soft = run_ks16("flat_polystyrene");
  const Indents hard = run_ks16("flat_silicon_oxide");
  const Indents rubber = run_ks16("flat_pdms");
  std::string csv = "# time_s,tip_height_nm,hand_force_n; blocks: " + soft.sample + ", " + hard.sample +
                    ", " + rubber.sample + "\n";
  std::string found;
  for (const Indents* run : {&soft, &hard, &rubber}) {
    for (std::size_t i = 0; i < run->rows.size(); i += 4)
      csv += fmt::format("{:.6g},{:.7g},{:.6g}\n", run->rows[i].time_s, run->rows[i].height_nm,
                         run->rows[i].hand_force_n);
    csv += "\n\n";
    found += fmt::format(
        " {}: {:.2g} N in contact, to {:.3g} nm below the surface at {:.3g} N, {} {:.2g} N; the hand "
        "spends {:.3g} mJ.",
        run->sample, run->contact_n, run->deepest_nm, run->greatest_n,
        run->rows.back().hand_force_n < -kHeld_n ? "held to the end by up to" : "lets go at", run->pull_off_n,
        run->hand_work_mj);
  }
  folder.write("ks16.csv", csv);
  write_beside_paper(
      folder, "ks16",
      {{"tasks (b) and (c)", "performed with different samples, stable", "as printed",
        "KS section IV, fig. 16", "three samples, no stop", "agrees"},
       {"silicone rubber, same force scale", "its softness gives less force feedback", "as printed",
        "KS section IV",
        fmt::format(
            "greatest push {:.2g} N on {} (it holds on with {:.2g} N), {:.2g} N on {}, {:.2g} N on {}, same "
            "motion of the intention",
            rubber.greatest_n, rubber.sample, rubber.pull_off_n, soft.greatest_n, soft.sample,
            hard.greatest_n, hard.sample),
        soft.greatest_n < hard.greatest_n ? agrees_on_rubber(rubber.greatest_n, soft.greatest_n)
                                          : "does not agree"},
       {"position and force over time", "sample, depth and scaling not stated", "no axis in the text",
        "KS fig. 16", "in the caption", "not comparable"}});
  Figure figure{
      "ks16", "In contact, and indenting",
      "Sessions in virtual time: (b) just in contact, then (c) pressed in three times at one place, with the "
      "same motion of the hand's intention, on three elastic samples." +
          found +
          " As in KS contact and indenting are stable, and the hard sample gives more force for less depth. "
          "Which sample, depth and scaling KS's figure has is not known, so the numbers are not comparable.",
      ""};
  const auto lines = [&](int column, const char* colour) {
    return std::vector<std::string>{fmt::format("'ks16.csv' index 0 using 1:{} lc rgb '{}' lw 1.4 title {}",
                                                column, colour, quoted(soft.sample)),
                                    fmt::format("'ks16.csv' index 1 using 1:{} lc rgb '{}' lw 1.4 title {}",
                                                column, kPurple, quoted(hard.sample)),
                                    fmt::format("'ks16.csv' index 2 using 1:{} lc rgb '{}' lw 1.4 title {}",
                                                column, kGreen, quoted(rubber.sample))};
  };
  folder.draw(figure, 1000, 520,
              "set multiplot\n" + column_of_panels({{"tip above surface (nm)", lines(2, kBlue)},
                                                    {"force at the hand (N)", lines(3, kRed)}},
                                                   {0.09, 0.98, 0.93, 0.1, 0.07, true, "0:18"}, ""));
  return figure;
}

}  // namespace telenano::studies
