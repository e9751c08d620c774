#pragma once

#include <string>

namespace telenano::afm {

/// A rig and what its operator allows, as afm.toml says (deploy/afm.toml explains every key). Lengths along Z
/// are heights: away from the sample positive, whatever the sign of the rig's Z.
struct AfmConfig {
  std::string path = "afm.toml";  ///< for messages

  // [signals]
  int deflection_signal = 8;
  int lateral_signal = 9;
  double range_v = 10;  ///< both end at plus and minus this
  // [calibration]
  int z_sign = 1;                   ///< +1: larger Z is away from the sample
  double sensitivity_nm_v = 50;     ///< signed: deflection away from the sample, per volt
  double spring_constant_n_m = 40;  ///< of the lever
  double lateral_nn_v = 100;        ///< signed
  double across_n_m = 400;          ///< stiffness across of lever, tip and contact together, the largest
  double along_part = 0.45;         ///< of a force along the lever, what the deflection shows (across_rule.h)
  // [limits]
  double speed_nm_s = 1000;
  double step_nm = 1;  ///< of one command, along Z and across
  double force_max_nn = 300;
  double lateral_max_nn = 200;
  double slope_max = 0.5;      ///< steepest ground that the learned model may have
  double relief_nm = 20;       ///< so much higher than where it has touched the ground may be anywhere
  double along_slope = 0;      ///< steepest way of the tip, friction included; 0: not known
  double half_width_nm = 500;  ///< workspace, across, about where the tip stands at the start
  double top_nm = 60;          ///< above and
  double depth_nm = 40;        ///< below the surface there
  double drift_max_nm_s = 5;   ///< more than this between two touches is no drift
  // [timing]
  double force_rate_hz = 200;
  double link_loss_ms = 100;      ///< without a command from a session
  double reply_timeout_ms = 100;  ///< of the controller, besides an acquisition period where it reads
  double stale_force_ms = 0;      ///< without a reading; 0: two periods and 20 ms, at least 60 ms
  // [approach]
  double lift_nm = 25;  ///< above the surface, where the tip waits
  int tare_readings = 20;
  double touch_force_nn = 40;
  double touch_pause_s = 2;  ///< between the two touches that measure the drift
  double timeout_s = 60;     ///< of the whole approach
  double withdraw_nm_s = 20000;
  double park_after_s = 60;  ///< without a session: the tip is withdrawn until one comes
  // [deadman]
  std::string deadman_key;  ///< file; empty: none is named

  double period_s() const noexcept { return 1 / force_rate_hz; }
  /// After this long without a reading the force is not known.
  double stale_force_s() const noexcept {
    if (stale_force_ms > 0) return 1e-3 * stale_force_ms;
    const double two_s = 2 * period_s() + 0.02;
    return two_s > 0.06 ? two_s : 0.06;
  }
  /// The guard withdraws when the server's thread has been silent for so long.
  int guard_silence_ms() const noexcept {
    const double four = 4 * reply_timeout_ms;
    return four > 400 ? static_cast<int>(four) : 400;
  }
};

/// Throws UserError: one line with file, line, key and expected range.
AfmConfig load_afm_config(const std::string& path);

}  // namespace telenano::afm
