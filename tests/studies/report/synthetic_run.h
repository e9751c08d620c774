#pragma once

#include <cmath>
#include <filesystem>
#include <numbers>
#include <random>

#include "telenano/common/recording/recorder.h"

namespace telenano::studies {

/// A made-up session with known answers, for the report's tests: one approach from 20 nm to -3 nm and back
/// within `duration_s`, snap-in at 1 nm, a linear contact of 5 nN/nm with 12 nN of adhesion that lets go at
/// +2 nm. With `shaken`, the hand force chatters in contact and the account falls. Round trips are lognormal
/// about 80 us.
struct SyntheticRun {
  double duration_s = 8;
  double rate_hz = 1000;
  bool shaken = false;

  static constexpr double kAdhesionNn = 12;
  static constexpr double kStiffness = 5;  // nN/nm
  static constexpr double kSurfaceNm = 100;
  static constexpr double kDepthNm = 3;

  void write(const std::filesystem::path& path) const {
    using namespace recording;
    const auto rows = static_cast<std::int64_t>(duration_s * rate_hz);
    RecorderOptions options;
    options.path = path;
    options.overwrite = true;
    options.queue_rows = static_cast<std::size_t>(rows) + 1;
    Configuration configuration;
    configuration.title = "synthetic";
    configuration.scene_name = "made up";
    configuration.scene_text = "name = \"made up\"\n# <a scene & its comment>\n";
    configuration.seed = "1";
    configuration.rate_hz = rate_hz;
    configuration.extra = {{"surface_z_w_nm", std::to_string(kSurfaceNm)},
                           {"method", shaken ? "none" : "ks-clamp"}};
    Recorder recorder(options, configuration);
    std::mt19937 random(1);
    std::lognormal_distribution<double> rtt(std::log(80.0), 0.25);
    bool contact = false;
    Sample s;
    double energy = 0.002;
    for (std::int64_t i = 0; i < rows; ++i) {
      s.tick = i;
      s.time_s = static_cast<double>(i) / rate_hz;
      const double phase = static_cast<double>(i) / static_cast<double>(rows - 1);
      const double height = 20 - (20 + kDepthNm) * std::sin(std::numbers::pi * phase);
      if (!contact && height < 1) contact = true;
      if (contact && height > 2) contact = false;
      const double chatter = shaken && contact ? std::sin(0.9 * static_cast<double>(i)) : 0.0;
      const double force =
          contact ? -kAdhesionNn - kStiffness * (height - 2) * (height < 2 ? 1 : 0) : -0.3 / (1 + height);
      s.hand_pos_h_m = {0, 0, 1e-3 * (height + 0.4 * chatter)};
      s.tip_target_w_nm = {50, 60, kSurfaceNm + height};
      s.tip_pos_w_nm = {50, 60, kSurfaceNm + height + 0.02 * force};
      s.force_w_nn = {0, 0, force};
      s.hand_force_scaled_h_n = {0, 0, 0.1 * force};
      s.hand_force_applied_h_n = {0, 0, 0.1 * force * (1 + 0.8 * chatter)};
      s.hand_force_commanded_h_n = s.hand_force_applied_h_n;
      const bool damped = !shaken && contact && i % 4 == 0;
      s.damper_n_s_m = damped ? 1.5 : 0.0;
      s.limit_flags = damped ? kLimitDamper : 0u;
      energy += contact && shaken ? -2e-6 : 1e-7;
      s.energy_j = energy;
      s.slave_energy_in_aj = 100 * phase;
      s.slave_energy_out_aj = 60 * phase;
      s.contact_state = contact ? 3 : height < 5 ? 1 : 0;
      s.reply_sequence = i + 1;
      s.rtt_us = rtt(random);
      s.lateness_us = 5;
      s.lost = i / 1000;
      recorder.push(s);
    }
    recorder.close();
  }
};

}  // namespace telenano::studies
