#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"

namespace telenano::link {

/// Decides which replies of a session the server leaves out (PROTOCOL.md, section 4, Reply deadband): a reply whose force
/// differs from that of the last reply by less than the command's deadband, and that brings nothing else new. Apart from
/// delay and loss, the force that the station shows therefore differs from the true one by no more than the deadband.
///
/// Always sent
///   - a reply with another contact state, fault, holding, model, particle state, or energy or wave sent by the port;
///   - the reply to a command with other flags, method, scale, holding or deadband;
///   - every reply of method `wave`: the station integrates waves over the time between two replies;
///   - enough replies that two are at most kLongestNs apart, or kLongestOfTwoNs where only every second one is left out.
/// Energies are running sums: the next reply contains those of all replies left out before it, so the accounts stay exact.
///
/// Time is taken from the commands, not from the server's clock: the same commands leave out the same replies, also in a
/// replay.
class ReplyGate {
 public:
  /// Three of these, and the way's jitter, within the 20 ms for which a force is held: two may be lost in a row.
  static constexpr std::int64_t kLongestNs = 6'000'000;
  /// Where commands come less often: every second one is answered. As far apart as a station's own heartbeat.
  static constexpr std::int64_t kLongestOfTwoNs = 10'000'000;
  /// Whatever times the commands claim. At most half of those that Reply::steps_before can tell of.
  static constexpr std::uint32_t kMostInRow = 32;

  /// True: `reply`, to `command`, is sent, and counts as sent. `spacing_s`: from the command before to this one, and
  /// likely to the next. Another session id begins anew.
  bool wants(const Reply& reply, const Command& command, double spacing_s) noexcept {
    if (reply.session_id != session_id_) {
      *this = {};
      session_id_ = reply.session_id;
      note(reply, command);
      return true;
    }
    if (!is_due(command, spacing_s) && is_within(reply.force_w_nn, command.reply_deadband) &&
        !says_more(reply, command)) {
      ++left_out_;
      ++in_row_;
      return false;
    }
    note(reply, command);
    return true;
  }

  std::uint64_t left_out() const noexcept { return left_out_; }  ///< of this session

 private:
  /// Must this command be answered, whatever its force?
  bool is_due(const Command& command, double spacing_s) const noexcept {
    if (command.reply_deadband.empty() || in_row_ >= kMostInRow) return true;
    const auto since_ns = static_cast<std::int64_t>(command.send_time_ns - send_time_ns_);
    const double next_ns = static_cast<double>(since_ns) + 1e9 * spacing_s;
    const std::int64_t longest_ns = in_row_ == 0 ? kLongestOfTwoNs : kLongestNs;
    return since_ns < 0 || !(next_ns <= static_cast<double>(longest_ns));
  }

  bool is_within(const Vec3& force_w_nn, const ReplyDeadband& deadband) const noexcept {
    const double relative_nn = 1e-3 * deadband.relative_permille * force_w_nn_.norm();
    return (force_w_nn - force_w_nn_).norm() <= std::max(1e-3 * deadband.floor_pn, relative_nn);
  }

  bool says_more(const Reply& r, const Command& c) const noexcept {
    const bool asked = c.flags != flags_ || c.control.method != method_ || c.tip_hold != tip_hold_ ||
                       c.control.energy_scale_aj_j != energy_scale_aj_j_ || c.reply_deadband != deadband_;
    const bool state = r.epoch != epoch_ || r.contact_state != contact_state_ ||
                       r.fault_bits != fault_bits_ || r.tip.hold != hold_ || r.particle.status != particle_ ||
                       !r.steps.empty() || (r.measurement_age_ns == kNeverMeasuredNs) != unmeasured_;
    const bool port = c.control.method == kMethodWave || r.model.version != model_version_ ||
                      r.port.energy_sent_aj != port_.energy_sent_aj || r.port.wave_sum != port_.wave_sum ||
                      r.port.wave_energy_aj != port_.wave_energy_aj;
    return asked || state || port;
  }

  void note(const Reply& r, const Command& c) noexcept {
    in_row_ = 0;
    send_time_ns_ = c.send_time_ns;
    flags_ = c.flags;
    method_ = c.control.method;
    tip_hold_ = c.tip_hold;
    energy_scale_aj_j_ = c.control.energy_scale_aj_j;
    deadband_ = c.reply_deadband;
    force_w_nn_ = r.force_w_nn;
    epoch_ = r.epoch;
    contact_state_ = r.contact_state;
    fault_bits_ = r.fault_bits;
    hold_ = r.tip.hold;
    particle_ = r.particle.status;
    unmeasured_ = r.measurement_age_ns == kNeverMeasuredNs;
    model_version_ = r.model.version;
    port_ = r.port;
  }

  std::uint64_t session_id_ = 0;
  std::uint64_t left_out_ = 0;
  std::uint32_t in_row_ = 0;  // left out since the last one that was sent, of which and of whose command is:
  std::uint64_t send_time_ns_ = 0;
  std::uint32_t flags_ = 0;
  std::uint32_t method_ = 0;
  std::uint32_t tip_hold_ = 0;
  double energy_scale_aj_j_ = 0;
  ReplyDeadband deadband_;
  Vec3 force_w_nn_ = Vec3::Zero();
  std::uint32_t epoch_ = 0;
  ContactState contact_state_ = ContactState::kFree;
  std::uint32_t fault_bits_ = 0;
  std::uint32_t hold_ = 0;
  ParticleStatus particle_ = ParticleStatus::kRests;
  bool unmeasured_ = false;
  std::uint32_t model_version_ = 0;
  PortAnswer port_;
};

}  // namespace telenano::link
