#include "tests/studies/figures/ks18.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "telenano/common/control/scaling_plan.h"
#include "tests/studies/figures/ks16.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/paper_table.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies {
namespace {

// Times of the script, s: two cycles of 10 s each (above, to the sample, in contact, back), then pressed.
constexpr double kCycle_s = 10;
constexpr double kAboveEnds_s = 4;
constexpr double kContactBegins_s = 6;
constexpr double kContactEnds_s = 8;
constexpr double kPressBegins_s = 2 * kCycle_s + 6;
constexpr double kPressEnds_s = 2 * kCycle_s + 8;
constexpr double kPressed_nm = -7;  // as intended: hand and springs yield
constexpr double kEnd_s = 2 * kCycle_s + 12;

std::vector<device::IntendedMotion::Waypoint> script(double start_nm) {
  std::vector<device::IntendedMotion::Waypoint> points{{0, Vec3(0, 0, start_nm)}};
  const auto go = [&](double t, double z) { points.push_back({t, Vec3(0, 0, z)}); };
  for (int cycle = 0; cycle < 2; ++cycle) {
    const double t = cycle * kCycle_s;
    go(t + 1, 20);
    go(t + 2.5, 10);
    go(t + kAboveEnds_s, 15);
    go(t + kContactBegins_s - 0.5, -0.5);
    go(t + kContactEnds_s, -0.5);
    go(t + kCycle_s - 0.5, 15);
  }
  go(2 * kCycle_s + 4, 15);
  go(kPressBegins_s - 0.5, kPressed_nm);
  go(kPressEnds_s, kPressed_nm);
  go(kEnd_s, 20);
  return points;
}

}  // namespace

TaskTransitions run_ks18(const std::string& scene_path, double compand) {
  support::VirtualSessionConfig config;
  config.scene = scene::load_scene(scene_path);
  config.task = device::Task::kScript;
  if (compand >= 1) {
    config.twin = true;
    config.station.method = control::Method::kTwin;
    config.station.companding.gain = compand;
  }
  config.script = script(config.scene->start_apex_w_nm.z() - config.scene->start_touch_w_nm);
  support::VirtualSession session(config);
  TaskTransitions result;
  result.scene = config.scene->sample.name;
  double sum_contact = 0, sum_pressed = 0;
  int in_contact = 0, pressed = 0;
  const double surface = config.scene->start_touch_w_nm;
  std::array<double, 10> on_the_way_n{};  // of the last ticks
  std::size_t tick = 0;
  session.run(1'000'000, [&](const recording::Sample& s) {
    if (!session.device().motion_started()) return;
    const double t = session.device().motion_time_s();
    const double force = s.hand_force_commanded_h_n[2];
    result.rows.push_back({t, s.tip_pos_w_nm[2] - surface, force});
    if (t > kPressBegins_s && t < kPressEnds_s) {
      sum_pressed += force;
      ++pressed;
    }
    if (t > 2 * kCycle_s) return;
    const double phase = std::fmod(t, kCycle_s);
    const bool touching = s.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact) ||
                          s.contact_state == static_cast<std::uint32_t>(link::ContactState::kNonContact);
    if (phase > 1 && phase < kAboveEnds_s) {
      result.above_n = std::max(result.above_n, std::fabs(force));
      result.above_tip_n = std::max(result.above_tip_n, std::fabs(s.hand_force_scaled_h_n[2]));
    } else if (phase > kContactBegins_s && phase < kContactEnds_s) {
      sum_contact += force;
      ++in_contact;
    } else if (phase > kAboveEnds_s) {
      // A twin shows the jump before the server's reply says that it touches: what was shown just before a
      // contact is the jump's.
      if (touching) {
        result.jump_n = std::max(result.jump_n, -force);
        on_the_way_n.fill(0);
      } else {
        double& oldest_n = on_the_way_n[tick++ % on_the_way_n.size()];
        result.going_n = std::max(result.going_n, std::exchange(oldest_n, std::fabs(force)));
      }
    }
  });
  result.in_contact_n = in_contact > 0 ? sum_contact / in_contact : std::nan("");
  result.pressed_n = pressed > 0 ? sum_pressed / pressed : std::nan("");
  return result;
}

namespace {

Figure draw_transitions(const FigureFolder& folder, const std::string& id, const std::string& scene,
                        const std::string& comparison) {
  const TaskTransitions run = run_ks18(scene);
  std::string csv = "# time_s,tip_height_nm,hand_force_n\n";
  for (std::size_t i = 0; i < run.rows.size(); i += 4) {
    const auto& row = run.rows[i];
    csv += fmt::format("{:.6g},{:.7g},{:.7g}\n", row.time_s, row.height_nm, row.hand_force_n);
  }
  folder.write(id + ".csv", csv);
  constexpr double kGain = 5;
  const TaskTransitions plain = run_ks18(scene, 1), companded = run_ks18(scene, kGain);
  const auto newtons = [](double n) { return fmt::format("{:.2g} N", n); };
  std::vector<BesidePaper> beside{
      {"task (a)", "10–20 nm above the surface", "as printed", "KS section IV", "10–20 nm above the surface",
       "0 (taken from there)"},
      {"forces between (a) and (b)", "very small to perceive", "no axis in the text",
       "KS section IV, fig. 18",
       newtons(run.going_n) + " at most, a hand notices about " + newtons(control::kNoticedForceN),
       run.going_n < control::kNoticedForceN ? "agrees" : "does not agree"},
      {"a better perception of non-contact forces", "future work", "as printed", "KS section V",
       fmt::format("method twin, companding {:g} times: {} at most on the way instead of {}, pressed {} "
                   "instead of {}",
                   kGain, newtons(companded.going_n), newtons(plain.going_n), newtons(companded.pressed_n),
                   newtons(plain.pressed_n)),
       fmt::format("{:.2g} times as strong on the way", companded.going_n / std::max(plain.going_n, 1e-12))},
      {"position and force over time", "hand and scaling not stated", "no axis in the text",
       id == "ks17" ? "KS fig. 17" : "KS fig. 18", "in the caption", "not comparable"}};
  if (id == "ks18") {
    const TaskTransitions rubber = run_ks18("flat_pdms");
    beside.push_back({"silicone rubber, same force scale", "less force feedback", "as printed",
                      "KS section IV",
                      fmt::format("pressed {} on {}, {} on {}", newtons(rubber.pressed_n), rubber.scene,
                                  newtons(run.pressed_n), run.scene),
                      agrees_on_rubber(rubber.pressed_n, run.pressed_n)});
  }
  write_beside_paper(folder, id, beside);
  Figure figure{
      id, "Forces at the hand between tasks",
      fmt::format(
          "A session in virtual time (device, hand, station, link, server) over {}: (a) held 10–20 nm above, "
          "(b) just in contact, twice, then (c) pressed in. Greatest force above {:.2g} N (of the tip {:.2g} "
          "N, the rest is damping by control); on the way between (a) and (b), the jumps left out, {:.2g} N; "
          "attraction when the tip lets go up to {:.2g} N; mean force in contact {:.2g} N, and pressed in "
          "{:.2g} N.",
          run.scene, run.above_n, run.above_tip_n, run.going_n, run.jump_n, run.in_contact_n, run.pressed_n) +
          comparison,
      ""};
  std::string shades;
  int object = 0;
  const auto shade = [&](double from, double to, const char* colour) {
    shades += fmt::format(
        "set object {} rectangle from {}, graph 0 to {}, graph 1 behind fc rgb '{}' fs solid 1 noborder\n",
        ++object, from, to, colour);
  };
  for (int cycle = 0; cycle < 2; ++cycle) {
    shade(cycle * kCycle_s + 1, cycle * kCycle_s + kAboveEnds_s, "#E8F1F8");
    shade(cycle * kCycle_s + kContactBegins_s, cycle * kCycle_s + kContactEnds_s, "#FBEFD9");
  }
  shade(kPressBegins_s, kPressEnds_s, "#F6DDD0");
  const std::vector<Panel> panels{
      {"tip above sample (nm)", {fmt::format("'{}.csv' using 1:2 lc rgb '{}' lw 1.4 notitle", id, kBlue)}},
      {"force at the hand (N)", {fmt::format("'{}.csv' using 1:3 lc rgb '{}' lw 1.4 notitle", id, kRed)}}};
  folder.draw(
      figure, 1000, 520,
      "set multiplot\n" + shades +
          column_of_panels(panels, {0.09, 0.98, 0.95, 0.1, 0.05, true, fmt::format("0:{}", kEnd_s)}, ""));
  return figure;
}

}  // namespace

Figure draw_ks17(const FigureFolder& folder) {
  return draw_transitions(
      folder, "ks17", "flat_silicon_oxide",
      " As in KS a stable contact on the hardest sample, at a scaling that is passive; their "
      "hand, scaling and axes are not given.");
}

Figure draw_ks18(const FigureFolder& folder) {
  return draw_transitions(folder, "ks18", "flat_polystyrene",
                          " As in KS the forces between (a) and (b) are too small to be felt.");
}

}  // namespace telenano::studies
