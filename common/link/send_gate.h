#pragma once

#include <cstdint>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"

namespace telenano::link {

struct SendGateConfig {
  double deadband_nm = 0;                  ///< of the commanded position; 0: every change of it is sent
  double deadband_n = 0;                   ///< of the force shown to the hand; 0: the force is not looked at
  std::int64_t heartbeat_ns = 10'000'000;  ///< the longest time without a command

  bool enabled() const noexcept { return deadband_nm > 0 || deadband_n > 0; }
};

/// Deadband sending: a tick's command is sent only if it says something new: other flags or another method, a
/// commanded position more than the deadband away from the last one sent, a force that has changed by more
/// than its deadband (the slave answers commands only, so a force that moves asks for the next one), or the
/// heartbeat. Positions and energies are cumulative and carry their send time: what was held back is in the
/// next one, exactly. The slave's target is never further from the commanded one than the deadband.
class SendGate {
 public:
  explicit SendGate(const SendGateConfig& config) noexcept : config_(config) {}

  bool enabled() const noexcept { return config_.enabled(); }
  /// Deadbands are `factor` times what was configured, 1 or more, from now on.
  void widen(double factor) noexcept { factor_ = factor; }
  /// True: send it, and it counts as sent.
  bool wants(const Command& command, const Vec3& hand_force_h_n, std::int64_t now_ns) noexcept {
    ++asked_;
    const bool changed =
        !sent_any_ || command.flags != flags_ || command.control.method != method_ ||
        (command.tip_pos_w_nm - pos_w_nm_).norm() > factor_ * config_.deadband_nm ||
        (config_.deadband_n > 0 && (hand_force_h_n - force_h_n_).norm() > factor_ * config_.deadband_n);
    if (config_.enabled() && !changed && now_ns - sent_ns_ < config_.heartbeat_ns) {
      ++held_;
      return false;
    }
    sent(command, hand_force_h_n, now_ns);
    return true;
  }
  /// The command is sent without being asked for here: by a twin's own pace.
  void sent(const Command& command, const Vec3& hand_force_h_n, std::int64_t now_ns) noexcept {
    sent_any_ = true;
    flags_ = command.flags;
    method_ = command.control.method;
    pos_w_nm_ = command.tip_pos_w_nm;
    force_h_n_ = hand_force_h_n;
    sent_ns_ = now_ns;
  }
  /// Another session: the next command is sent.
  void clear() noexcept { sent_any_ = false; }

  std::uint64_t asked() const noexcept { return asked_; }
  std::uint64_t held() const noexcept { return held_; }  ///< commands that were not sent

 private:
  SendGateConfig config_;
  double factor_ = 1;
  bool sent_any_ = false;
  std::uint32_t flags_ = 0;
  std::uint32_t method_ = 0;
  Vec3 pos_w_nm_ = Vec3::Zero();
  Vec3 force_h_n_ = Vec3::Zero();
  std::int64_t sent_ns_ = 0;
  std::uint64_t asked_ = 0;
  std::uint64_t held_ = 0;
};

}  // namespace telenano::link
