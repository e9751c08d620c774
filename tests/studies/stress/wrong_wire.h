#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/link/codec.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// A reply gate that is wrong on purpose, after a server that answers every command: what a right one does is
/// link::ReplyGate.
class WrongGate {
 public:
  WrongGate(Mutant mutant, const link::ReplyDeadband& deadband) noexcept
      : mutant_(mutant), deadband_(deadband) {}
  /// False: left out. What goes has the numbers of a server that has left it out itself.
  bool passes(link::Reply& reply) noexcept;

 private:
  bool is_due(const link::Reply& reply) const noexcept;
  bool says_more(const link::Reply& reply) const noexcept;

  Mutant mutant_;
  link::ReplyDeadband deadband_;
  link::Reply sent_;                                      ///< as it came here
  link::Reply last_;                                      ///< likewise, sent or not
  std::uint64_t passed_ = 0, left_out_ = 0, in_row_ = 0;  ///< of this session
  double in_aj_ = 0, out_aj_ = 0;                         ///< that the station was told
};

/// A codec, a session or a reply gate that is wrong on purpose (mutants.h), on the way from the server to the
/// station: each datagram is read, changed and written again.
class WrongWire {
 public:
  static bool concerns(Mutant mutant) noexcept;
  /// The server then answers every command, and this leaves replies out.
  static bool is_gate(Mutant mutant) noexcept;
  explicit WrongWire(Mutant mutant, const link::ReplyDeadband& deadband = {}) noexcept
      : mutant_(mutant), gate_(mutant, deadband) {
    old_w_nn_.fill(Vec3::Zero());  // Eigen leaves it as the memory was
  }
  /// Bytes of the datagram that goes instead; 0: none goes.
  std::size_t operator()(std::span<std::uint8_t> out, std::size_t size) noexcept;

 private:
  bool change_reply(link::Reply& reply) noexcept;

  static constexpr std::size_t kOldReplies = 60;
  Mutant mutant_;
  WrongGate gate_;
  link::Codec codec_;
  link::Incoming in_;
  Vec3 last_w_nn_ = Vec3::Zero();
  std::array<Vec3, kOldReplies> old_w_nn_;
  std::size_t count_ = 0;
  std::uint32_t epoch_ = 0;
  std::uint64_t last_command_ns_ = 0;
  bool deaf_ = false;
};

}  // namespace telenano::studies::stress
