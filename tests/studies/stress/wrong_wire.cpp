#include "tests/studies/stress/wrong_wire.h"

#include <algorithm>
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

/// By the time of the commands: no more than 6 ms between two replies, 10 ms after one that was sent.
bool WrongGate::is_due(const link::Reply& reply) const noexcept {
  const std::uint64_t since_ns = reply.command_send_time_ns - sent_.command_send_time_ns;
  const std::uint64_t spacing_ns = reply.command_send_time_ns - last_.command_send_time_ns;
  return mutant_ != Mutant::kGateSilent && since_ns + spacing_ns > (in_row_ == 0 ? 10'000'000u : 6'000'000u);
}

bool WrongGate::says_more(const link::Reply& reply) const noexcept {
  const bool contact = reply.contact_state != sent_.contact_state && mutant_ != Mutant::kGateBlind;
  return contact || reply.epoch != sent_.epoch || reply.fault_bits != sent_.fault_bits ||
         reply.port.energy_sent_aj != sent_.port.energy_sent_aj ||
         reply.port.wave_sum != sent_.port.wave_sum ||
         reply.port.wave_energy_aj != sent_.port.wave_energy_aj || reply.model.version != sent_.model.version;
}

bool WrongGate::passes(link::Reply& reply) noexcept {
  const link::Reply came = reply;
  const bool first = came.session_id != sent_.session_id;
  const Vec3& than_w_nn = mutant_ == Mutant::kGateCreeping ? last_.force_w_nn : sent_.force_w_nn;
  const double most_nn =
      std::max(1e-3 * deadband_.floor_pn, 1e-3 * deadband_.relative_permille * than_w_nn.norm());
  const bool within = (came.force_w_nn - than_w_nn).norm() <= most_nn;
  if (!first && within && !is_due(came) && !says_more(came)) {
    ++left_out_;
    ++in_row_;
    last_ = came;
    return false;
  }
  if (first) {
    passed_ = left_out_ = 0;
    in_aj_ = came.energy_in_aj;
    out_aj_ = came.energy_out_aj;
  } else {
    // The forgetful one sums up what it sends.
    in_aj_ += came.energy_in_aj - last_.energy_in_aj;
    out_aj_ += came.energy_out_aj - last_.energy_out_aj;
  }
  if (mutant_ == Mutant::kGateForgetful) {
    reply.energy_in_aj = in_aj_;
    reply.energy_out_aj = out_aj_;
  }
  in_row_ = 0;
  reply.sequence = ++passed_;
  reply.replies_left_out = left_out_;
  sent_ = last_ = came;
  return true;
}

bool WrongWire::concerns(Mutant mutant) noexcept {
  return (mutant >= Mutant::kCodecSwapped && mutant <= Mutant::kSessionDeaf) || is_gate(mutant);
}

bool WrongWire::is_gate(Mutant mutant) noexcept {
  return mutant >= Mutant::kGateCreeping && mutant <= Mutant::kGateBlind;
}

/// False: the reply does not arrive.
bool WrongWire::change_reply(link::Reply& reply) noexcept {
  if (is_gate(mutant_)) return gate_.passes(reply);
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
