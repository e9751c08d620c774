#pragma once

#include "telenano/master/station/station.h"

namespace telenano::station {

/// A station at 1 kHz with a device that applies every force as commanded, and replies made by hand.
class StationRig {
 public:
  static constexpr double kPeriodS = 1e-3;

  static device::DeviceInfo device() {
    device::DeviceInfo info;
    info.name = "rig";
    info.force_max_n = 12;
    info.damping_n_s_m = 2;
    return info;
  }

  /// Of a session that logs its steps, in a box of 100 nm each way.
  static link::Welcome welcome_with_log() {
    link::Welcome welcome;
    welcome.epoch = 1;
    welcome.feature_bits = link::kFeatureStepLog;
    welcome.workspace_min_w_nm = Vec3::Constant(-100);
    welcome.workspace_max_w_nm = Vec3::Constant(100);
    return welcome;
  }

  explicit StationRig(const StationConfig& config = {}, const SlavePort& slave = {10, 0, 500})
      : station(config, device(), slave) {
    welcome.start_pos_w_nm = Vec3(100, 200, 40);
    station.begin_session(welcome);
    input.session_up = true;
    input.buttons = device::kButtonDeadman;
  }

  /// One tick; `with_reply` says whether a new reply has come.
  const StationOutput& tick(bool with_reply = true) {
    if (with_reply) {
      ++reply.sequence;
      input.reply = &reply;
    } else {
      input.reply = nullptr;
    }
    input.time_ns += 1'000'000;
    station.step(input, kPeriodS, output);
    input.applied_force_h_n = output.hand_force_h_n;
    return output;
  }

  void ticks(int count, bool with_reply = true) {
    for (int k = 0; k < count; ++k) tick(with_reply);
  }

  /// Engaged, the ramp at its end, with this force at the tip.
  void engage(const Vec3& tip_force_w_nn) {
    reply.force_w_nn = tip_force_w_nn;
    ticks(400);
  }

  double force_n() const { return output.hand_force_h_n.norm(); }

  Station station;
  link::Welcome welcome;
  link::Reply reply;
  StationInput input;
  StationOutput output;
};

}  // namespace telenano::station
