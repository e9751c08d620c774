#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/codec.h"
#include "tests/studies/stress/watched_slave.h"

namespace telenano::studies::stress {

/// Is what the server leaves out of its replies within what was agreed? Held against the datagrams that leave the
/// server, before the link loses any, and against what the slave does; the deadband is the run's own, not what a command
/// says. By the rule as PROTOCOL.md has it, not by link::ReplyGate.
///
/// A reply that leaves says the force, the contact and the sums of energy of the slave of that moment. After a command
/// that was not answered the last reply is still true: the force is no further from its force than the deadband, the
/// contact is the same, and the slave has gone on by no more than the longest time between two replies.
class ReplyWatch {
 public:
  /// Where only every second reply is left out; otherwise 6 ms.
  static constexpr double kLongestS = 0.010;

  /// `permille` of the last reply's force, and `floor_n` of the force at the hand. Less than 1: nothing is left out.
  ReplyWatch(double permille, double floor_n) : permille_(permille), floor_n_(floor_n) {}
  bool watches() const noexcept { return permille_ >= 1; }

  /// A datagram that leaves the server.
  void leaves(std::span<const std::uint8_t> bytes, const SlaveWatch& slave) noexcept {
    if (codec_.decode(bytes, in_) != link::DropCause::kNone || in_.type != link::MessageType::kReply) return;
    const link::Reply& reply = in_.reply;
    as_it_was_ = as_it_was_ && reply.force_w_nn == slave.force_w_nn &&
                 reply.energy_in_aj == slave.energy_in_aj && reply.energy_out_aj == slave.energy_out_aj;
    force_w_nn_ = reply.force_w_nn;
    touches_ = reply.contact_state == link::ContactState::kContact;
    time_s_ = slave.time_s;
  }

  /// After a tick. `exchanges`: of the server, so far; where there was none since the last tick, there was nothing to be
  /// told. `n_per_nn`: force at the hand for each nN; another scale is in use before the server knows of it.
  bool is_true(const SlaveWatch& slave, std::uint64_t exchanges, double n_per_nn) noexcept {
    const bool asked = exchanges > exchanges_;  // less: of another server
    exchanges_ = exchanges;
    if (n_per_nn > 0) floor_nn_ = std::max(floor_nn_, floor_n_ / n_per_nn);
    const bool as_it_was = as_it_was_;
    as_it_was_ = true;
    if (!asked) return as_it_was;
    const double most_nn = std::max(floor_nn_, 1e-3 * permille_ * force_w_nn_.norm());
    return as_it_was && (slave.force_w_nn - force_w_nn_).norm() <= most_nn * (1 + 1e-9) + 1e-12 &&
           touches_ == slave.touches && slave.time_s - time_s_ <= kLongestS * (1 + 1e-9);
  }

 private:
  double permille_, floor_n_;
  double floor_nn_ = 0;
  link::Codec codec_;
  link::Incoming in_;
  bool as_it_was_ = true;
  std::uint64_t exchanges_ = 0;
  Vec3 force_w_nn_ = Vec3::Zero();  // of the last reply, and what else it said
  bool touches_ = false;
  double time_s_ = 0;  // of the slave, then
};

}  // namespace telenano::studies::stress
