#include "tests/studies/figures/ks13.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/master/device/sim_device.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/paper_table.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies {

namespace {

constexpr const char* kScene = "flat_silicon_oxide";
constexpr double kHoldEndS = 6.5, kStaticS = 0.5, kSettledPart = 0.025;

// What the rows say of the hold.
void judge_hold(HardContact& result) {
  double sum_n = 0, low_n = 1e300, high_n = -1e300;
  int count = 0;
  for (const auto& row : result.rows) {
    result.greatest_push_n = std::max(result.greatest_push_n, row.force_n);
    if (row.time_s < kHoldEndS - kStaticS || row.time_s >= kHoldEndS) continue;
    sum_n += row.force_n;
    low_n = std::min(low_n, row.force_n);
    high_n = std::max(high_n, row.force_n);
    ++count;
  }
  if (count == 0) return;
  result.static_n = sum_n / count;
  result.swing_n = high_n - low_n;
  double touched_s = -1, outside_s = -1;
  for (const auto& row : result.rows) {
    if (row.time_s >= kHoldEndS) break;
    if (touched_s < 0 && std::fabs(row.force_n) > 0.1) touched_s = row.time_s;
    if (std::fabs(row.force_n - result.static_n) > kSettledPart * std::fabs(result.static_n))
      outside_s = row.time_s;
  }
  if (touched_s >= 0 && outside_s < kHoldEndS - kStaticS) result.settled_after_s = outside_s - touched_s;
}

}  // namespace

HardContact run_ideal_contact(double force_scale) {
  constexpr double kRateHz = 50'000;
  const auto scene = scene::load_scene(kScene);
  slave::NveSlave slave(scene);
  const control::Scaling scaling{station::StationConfig{}.scaling.velocity, force_scale};
  const Vec3 start_w_nm = slave.limits().start_pos_w_nm;
  device::SimDeviceConfig config;
  config.plant.period_s = 1 / kRateHz;
  config.plant.position_quantum_m = 0;
  config.metres_per_nm = scaling.hand_displacement_m(Vec3::UnitX()).x();
  config.start_height_nm = start_w_nm.z() - slave.limits().surface_z_w_nm;
  device::TaskOptions options;
  options.start_height_nm = config.start_height_nm;
  device::SimDevice device(config, device::IntendedMotion::for_task(device::Task::kIndent, options));
  device.start_motion();
  const double limit_n = station::StationConfig{}.force_safety * config.plant.force_max_n;
  HardContact result;
  slave::SlaveOutput output;
  const auto steps = static_cast<int>(options.duration_s * kRateHz);
  for (int k = 0; k < steps; ++k) {
    slave::SlaveInput input;
    input.tip_target_pos_w_nm = start_w_nm + scaling.tip_displacement_nm(device.plant().pos_m());
    slave.step(input, 1 / kRateHz, output);
    const Vec3 wanted_n = scaling.hand_force_n(output.force_w_nn);
    const Vec3 applied_n =
        device.write_force(wanted_n * std::min(1.0, limit_n / std::max(wanted_n.norm(), 1e-9)));
    if (k % 50 == 0) result.rows.push_back({k / kRateHz, 1e3 * device.plant().pos_m().z(), applied_n.z()});
    result.greatest_n = std::max(result.greatest_n, applied_n.norm());
    result.greatest_push_n = std::max(result.greatest_push_n, applied_n.z());
    device.advance(static_cast<std::int64_t>(1e9 / kRateHz));
  }
  judge_hold(result);
  return result;
}

HardContact run_hard_contact(control::Method method, double force_scale) {
  support::VirtualSessionConfig config;
  config.scene = scene::load_scene(kScene);
  config.task = device::Task::kIndent;
  config.station.method = method;
  config.station.scaling.force = force_scale;
  config.station.allow_unsafe_scaling = true;
  support::VirtualSession session(config);
  HardContact result;
  result.method = method;
  double speed2 = 0, step2 = 0;
  int touching = 0;
  double last_z = 0, last_force = 0;
  const auto ticks = static_cast<std::int64_t>((config.task_options.duration_s + 3) * config.station.rate_hz);
  session.run(ticks, [&](const recording::Sample& s) {
    const double z = s.hand_pos_h_m[2];
    const double force = s.hand_force_applied_h_n[2];
    if (session.device().motion_started()) {
      result.rows.push_back({session.device().motion_time_s(), 1e3 * z, force});
      if (s.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact)) {
        speed2 += (z - last_z) * (z - last_z) / (session.period_s() * session.period_s());
        step2 += (force - last_force) * (force - last_force);
        ++touching;
      }
      result.greatest_n = std::max(result.greatest_n, std::fabs(force));
      result.extracted_mj = std::max(result.extracted_mj, -1e3 * s.energy_j);
      result.stopped = result.stopped || s.station_faults != 0;
    }
    last_z = z;
    last_force = force;
  });
  if (touching > 0) {
    result.hand_speed_rms_m_s = std::sqrt(speed2 / touching);
    result.force_step_rms_n = std::sqrt(step2 / touching);
  }
  judge_hold(result);
  return result;
}

namespace {

std::string rows_of(const HardContact& run) {
  std::string csv;
  for (const auto& row : run.rows)
    csv += fmt::format("{:.6g},{:.7g},{:.6g}\n", row.time_s, row.hand_z_mm, row.force_n);
  return csv + "\n\n";
}

std::string found(const HardContact& run) {
  return fmt::format(
      "greatest force {:.3g} N, RMS speed of the hand in contact {:.3g} mm/s, RMS force step {:.3g} N, "
      "energy "
      "taken out of the port {:.3g} mJ; in the last half second of the hold {:.3g} N with {:.2g} % peak to "
      "peak{}{}",
      run.greatest_n, 1e3 * run.hand_speed_rms_m_s, run.force_step_rms_n, run.extracted_mj, run.static_n,
      100 * run.swing_n / std::max(std::fabs(run.static_n), 1e-9),
      run.settled_after_s >= 0
          ? fmt::format(", within 2.5 % of it {:.2g} s after the first touch", run.settled_after_s)
          : ", never settled",
      run.stopped ? ", ended by the station's velocity trip" : "");
}

/// Where KS's controller as published does what their figure shows: the largest of these scales at which it brings
/// the hand to rest though the hand does not come to rest without it. 0: none.
struct OwnController {
  double force_scale = 0;
  HardContact without, with;
};
OwnController find_own_controller() {
  OwnController found;
  for (double scale = kHardContactForceScale; scale > 0.05 * kHardContactForceScale; scale *= 0.9) {
    const HardContact without = run_hard_contact(control::Method::kNone, scale);
    const HardContact with = run_hard_contact(control::Method::kKs, scale);
    if (with.settled_after_s < 0 || with.stopped || without.settled_after_s >= 0) continue;
    found = {scale, without, with};
    break;
  }
  return found;
}

constexpr const char* kSetting =
    "A session in virtual time (device, hand, station, link, server) indents silicon oxide at α_v = 1e-6, "
    "α_F = 8e8: 11 times the stiffness that this device shows passively with one sample of delay; the force "
    "limit stays on. ";

void draw(Figure& figure, const FigureFolder& folder, const std::vector<std::string>& positions,
          const std::vector<std::string>& forces) {
  folder.draw(figure, 1000, 520,
              "set multiplot\n" +
                  column_of_panels({{"hand, z (mm)", positions}, {"force on the hand, z (N)", forces}},
                                   {0.09, 0.98, 0.93, 0.1, 0.07, true, "0:10"}, ""));
}

}  // namespace

Figure draw_ks13(const FigureFolder& folder) {
  const HardContact none = run_hard_contact(control::Method::kNone, kHardContactForceScale);
  folder.write("ks13.csv", "# time_s,hand_z_mm,hand_force_n\n" + rows_of(none));
  Figure figure{"ks13", "Silicon oxide without a passivity controller",
                std::string(kSetting) + "Without control: " + found(none) +
                    ". As in KS the hand bounces on the hard sample for as long as it presses. Size and "
                    "frequency depend on hand, device and scaling, which the paper does not give.",
                ""};
  write_beside_paper(
      folder, "ks13",
      {{"silicon oxide without a passivity controller", "position and force oscillate", "no axis in the text",
        "KS section IV, fig. 13",
        fmt::format("{:.2g} % peak to peak at the end of the hold, RMS force step {:.3g} N",
                    100 * none.swing_n / std::max(std::fabs(none.static_n), 1e-9), none.force_step_rms_n),
        none.settled_after_s < 0 ? "agrees: never settles" : "does not agree: settles"},
       {"amplitude and frequency", "not stated; hand, scaling and coupling not stated", "no axis in the text",
        "KS fig. 13", "in the caption", "not comparable"}});
  draw(figure, folder, {fmt::format("'ks13.csv' using 1:2 lc rgb '{}' lw 1 notitle", kBlue)},
       {fmt::format("'ks13.csv' using 1:3 lc rgb '{}' lw 1 notitle", kRed)});
  return figure;
}

Figure draw_ks14(const FigureFolder& folder) {
  const HardContact published = run_hard_contact(control::Method::kKs, kHardContactForceScale);
  const HardContact clamp = run_hard_contact(control::Method::kKsClamp, kHardContactForceScale);
  const HardContact model = run_hard_contact(control::Method::kModel, kHardContactForceScale);
  const HardContact ideal = run_ideal_contact(kHardContactForceScale);
  const OwnController own = find_own_controller();
  folder.write("ks14.csv",
               "# time_s,hand_z_mm,hand_force_n; blocks: ks as published, ks-clamp, model, continuous ideal; "
               "at the smaller "
               "scale: without control, ks as published\n" +
                   rows_of(published) + rows_of(clamp) + rows_of(model) + rows_of(ideal) +
                   rows_of(own.without) + rows_of(own.with));
  const auto rest = [](const HardContact& run) {
    return run.stopped ? std::string("the station stops itself")
           : run.settled_after_s >= 0
               ? fmt::format("at rest {:.2g} s after the first touch, {:.3g} N", run.settled_after_s,
                             run.static_n)
               : fmt::format("not at rest: {:.2g} % peak to peak",
                             100 * run.swing_n / std::max(std::fabs(run.static_n), 1e-9));
  };
  const auto agrees = [](const HardContact& run) {
    return std::string(run.settled_after_s >= 0 && !run.stopped ? "agrees" : "does not agree");
  };
  std::vector<BesidePaper> beside{{"their controller, 11 times what is passive",
                                   "the interface is stabilised", "no axis in the text",
                                   "KS section IV, fig. 14", rest(published), agrees(published)}};
  if (own.force_scale > 0)
    beside.push_back({fmt::format("their controller, {:.2g} times what is passive",
                                  11 * own.force_scale / kHardContactForceScale),
                      "the interface is stabilised", "no axis in the text", "KS section IV, fig. 14",
                      "without it " + rest(own.without) + "; with it " + rest(own.with), agrees(own.with)});
  else
    beside.push_back({"their controller, 0.55 to 11 times what is passive", "the interface is stabilised",
                      "no axis in the text", "KS section IV, fig. 14",
                      "nowhere both restless without it and at rest with it", "does not agree"});
  beside.push_back({"ks-clamp", "not in the paper", "", "", rest(clamp), ""});
  beside.push_back({"model", "not in the paper", "", "", rest(model), ""});
  write_beside_paper(folder, "ks14", beside);
  Figure figure{
      "ks14", "Silicon oxide with a passivity controller",
      std::string(kSetting) + "KS's controller as published: " + found(published) +
          ". With a clamp, ks-clamp: " + found(clamp) + ". The default, model: " + found(model) +
          fmt::format(
              ". Its greatest push is {:.3g} N; the same hand on the same sample without sampling, link and "
              "control (50 kHz) feels {:.3g} N. ",
              model.greatest_push_n, ideal.greatest_push_n) +
          (own.force_scale > 0
               ? fmt::format("At {:.2g} times what is passive KS's own controller does what KS show: without "
                             "it {}, with "
                             "it {}. ",
                             11 * own.force_scale / kHardContactForceScale, rest(own.without), rest(own.with))
               : std::string()) +
          "What KS report, a hand brought to rest, is what the default does; their controller as printed "
          "counts its "
          "damper twice and has no cap on it. The pull before and after the hold is the sample's adhesion, "
          "cut by "
          "the force limit.",
      ""};
  const auto lines = [&](int column) {
    std::vector<std::string> all{
        fmt::format("'ks14.csv' index 0 using 1:{} lc rgb '{}' lw 1 title 'ks'", column, kGrey),
        fmt::format("'ks14.csv' index 1 using 1:{} lc rgb '{}' lw 1 title 'ks-clamp'", column, kGreen),
        fmt::format("'ks14.csv' index 2 using 1:{} lc rgb '{}' lw 1.4 title 'model'", column,
                    column == 2 ? kBlue : kRed)};
    if (own.force_scale > 0)
      all.push_back(fmt::format("'ks14.csv' index 5 using 1:{} lc rgb '{}' lw 1.4 title 'ks, {:.2g} times'",
                                column, kPurple, 11 * own.force_scale / kHardContactForceScale));
    return all;
  };
  draw(figure, folder, lines(2), lines(3));
  return figure;
}

}  // namespace telenano::studies
