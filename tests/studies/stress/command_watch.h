#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/link/send_gate.h"

namespace telenano::studies::stress {

/// Does the slave learn where the hand leads it? By what the station sends and by where the slave is told to go:
///
///   sent   in each tick of a session; with a deadband, or while a twin is felt, later by the heartbeat at most, and with a
///          deadband the target is no further from the last one sent than that, nor the force from what it was then
///   path   the slave goes to targets that were sent, in the order in which they were: where a datagram repeats what was
///          lost, too (for methods that leave the command as it is)
class CommandWatch {
 public:
  struct Limits {
    double deadband_nm = 0, deadband_n = 0;
    double heartbeat_s = 0.010;  ///< SendGateConfig, and LinkOptions::step_pace_ns with a twin
    bool keeps_targets = true;   ///< the method leaves the command as it is, and nobody else moves the tip
  };
  explicit CommandWatch(const Limits& limits) noexcept : limits_(limits) {}

  struct Tick {
    double time_s = 0;
    std::int64_t sessions = 0;
    bool has_session = false;
    bool sent = false;
    bool twin = false;  ///< is felt
    Vec3 target_w_nm = Vec3::Zero();
    Vec3 force_h_n = Vec3::Zero();
  };

  void look(const Tick& now) {
    if (now.sessions != last_.sessions) {
      sent_any_ = false;
      begun_s_ = now.time_s;
    }
    if (now.sent) {
      sent_any_ = true;
      sent_s_ = now.time_s;
      sent_w_nm_ = now.target_w_nm;
      sent_h_n_ = now.force_h_n;
      if (limits_.keeps_targets) on_the_way_.push_back(now.target_w_nm);
    } else if (now.has_session && !may_wait(now)) {
      holds_back_ = true;
    }
    last_ = now;
  }

  /// Where the slave is told to go in a step in which it follows: after the tick in which that was sent.
  void follows(const Vec3& target_w_nm) {
    if (!limits_.keeps_targets) return;
    std::size_t at = next_;
    while (at < on_the_way_.size() && on_the_way_[at] != target_w_nm) ++at;
    if (at == on_the_way_.size()) {
      strays_ = true;
    } else {
      next_ = at;  // it may go there in more than one step
    }
  }

  bool tells() const noexcept { return !holds_back_; }
  bool keeps_to_the_path() const noexcept { return !strays_; }

 private:
  static constexpr double kRounding = 1e-9;
  // A logged step says its place in multiples of 2⁻¹⁴ nm: both ends of a way, each half of that away on three axes.
  static constexpr double kLoggedNm = 1.1e-4;

  bool may_wait(const Tick& now) const noexcept {
    const double silent_s = now.time_s - std::max(sent_s_, begun_s_);
    if (silent_s > limits_.heartbeat_s * (1 + kRounding)) return false;
    if (now.twin) return true;
    if (!sent_any_ || (limits_.deadband_nm == 0 && limits_.deadband_n == 0)) return false;
    return (now.target_w_nm - sent_w_nm_).norm() <= limits_.deadband_nm + kLoggedNm &&
           (limits_.deadband_n == 0 ||
            (now.force_h_n - sent_h_n_).norm() <= limits_.deadband_n * (1 + kRounding));
  }

  Limits limits_;
  Tick last_;
  bool sent_any_ = false;  // in this session
  double sent_s_ = 0, begun_s_ = 0;
  Vec3 sent_w_nm_ = Vec3::Zero(), sent_h_n_ = Vec3::Zero();
  std::vector<Vec3> on_the_way_;  // all that were sent
  std::size_t next_ = 0;          // the last one that the slave went to
  bool holds_back_ = false, strays_ = false;
};

}  // namespace telenano::studies::stress
