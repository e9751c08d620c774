#include "tests/studies/figures/ks13.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tests/studies/report/gnuplot.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies {

HardContact run_hard_contact(control::Method method, double force_scale) {
  support::VirtualSessionConfig config;
  config.scene =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flat_silicon_oxide.toml");
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
      "taken out of the port {:.3g} mJ{}",
      run.greatest_n, 1e3 * run.hand_speed_rms_m_s, run.force_step_rms_n, run.extracted_mj,
      run.stopped ? ", ended by the station's velocity trip" : "");
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
  draw(figure, folder, {fmt::format("'ks13.csv' using 1:2 lc rgb '{}' lw 1 notitle", kBlue)},
       {fmt::format("'ks13.csv' using 1:3 lc rgb '{}' lw 1 notitle", kRed)});
  return figure;
}

Figure draw_ks14(const FigureFolder& folder) {
  const HardContact published = run_hard_contact(control::Method::kKs, kHardContactForceScale);
  const HardContact clamp = run_hard_contact(control::Method::kKsClamp, kHardContactForceScale);
  folder.write("ks14.csv", "# time_s,hand_z_mm,hand_force_n; blocks: ks as published, ks-clamp\n" +
                               rows_of(published) + rows_of(clamp));
  Figure figure{"ks14", "Silicon oxide with a passivity controller",
                std::string(kSetting) + "KS's controller as published: " + found(published) +
                    ". The default, ks-clamp: " + found(clamp) +
                    ". What KS report, a hand brought to rest, is what the default does; their controller as "
                    "printed books its damper twice and has no cap on it.",
                ""};
  const auto lines = [](int column) {
    return std::vector<std::string>{
        fmt::format("'ks14.csv' index 0 using 1:{} lc rgb '{}' lw 1 title 'ks, as published'", column, kGrey),
        fmt::format("'ks14.csv' index 1 using 1:{} lc rgb '{}' lw 1.4 title 'ks-clamp'", column,
                    column == 2 ? kBlue : kRed)};
  };
  draw(figure, folder, lines(2), lines(3));
  return figure;
}

}  // namespace telenano::studies
