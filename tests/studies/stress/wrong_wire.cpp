#include "tests/studies/stress/wrong_wire.h"

#include <cmath>
#include <utility>

namespace telenano::studies::stress {
namespace {

constexpr std::uint64_t kGapNs = 200'000'000;

/// Piconewtons in an integer of 16 bits.
double in_short(double force_nn) noexcept {
  return 1e-3 * static_cast<std::int16_t>(std::llround(1e3 * force_nn));
}

}  // namespace

bool WrongWire::concerns(Mutant mutant) noexcept {
  return mutant >= Mutant::kCodecSwapped && mutant <= Mutant::kSessionDeaf;
}

/// False: the reply does not arrive.
bool WrongWire::change_reply(link::Reply& reply) noexcept {
  Vec3& force = reply.force_w_nn;
  ++count_;
  switch (mutant_) {
    case Mutant::kCodecSwapped:
      std::swap(force.x(), force.y());
      return true;
    case Mutant::kCodecUnsigned:
      force = force.cwiseAbs();
      return true;
    case Mutant::kCodecShort:
      for (double& f : force) f = in_short(f);
      return true;
    case Mutant::kCodecKeepsFields:  // what is zero is not written, and the reader does not clear its message
      for (int i = 0; i < 3; ++i) {
        if (force[i] == 0) force[i] = last_w_nn_[i];
      }
      last_w_nn_ = force;
      return true;
    case Mutant::kSessionOldNews: {  // a late reply counts as a new one
      const Vec3 old = std::exchange(old_w_nn_[count_ % kOldReplies], force);
      if (count_ % 2 == 0) force = old;
      return true;
    }
    case Mutant::kSessionOneEpoch:
      if (epoch_ == 0) epoch_ = reply.epoch;
      reply.epoch = epoch_;
      return true;
    case Mutant::kSessionDeaf:
      if (last_command_ns_ != 0 && reply.command_send_time_ns > last_command_ns_ + kGapNs) deaf_ = true;
      last_command_ns_ = reply.command_send_time_ns;
      return !deaf_;
    default:
      return true;
  }
}

std::size_t WrongWire::operator()(std::span<std::uint8_t> out, std::size_t size) noexcept {
  if (codec_.decode(out.first(size), in_) != link::DropCause::kNone) return size;
  std::size_t changed = 0;
  if (in_.type == link::MessageType::kReply) {
    if (!change_reply(in_.reply)) return 0;
    changed = codec_.encode(in_.reply, out);
  } else if (in_.type == link::MessageType::kWelcome) {
    if (deaf_) return 0;
    if (mutant_ == Mutant::kSessionOneEpoch) {
      if (epoch_ == 0) epoch_ = in_.welcome.epoch;
      in_.welcome.epoch = epoch_;
    }
    changed = codec_.encode(in_.welcome, out);
  }
  return changed > 0 ? changed : size;
}

}  // namespace telenano::studies::stress
