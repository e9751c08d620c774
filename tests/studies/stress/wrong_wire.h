#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/link/codec.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// A codec or a session that is wrong on purpose (mutants.h), on the way from the server to the station: each
/// datagram is read, changed and written again.
class WrongWire {
 public:
  static bool concerns(Mutant mutant) noexcept;
  explicit WrongWire(Mutant mutant) noexcept : mutant_(mutant) {}
  /// Bytes of the datagram that goes instead; 0: none goes.
  std::size_t operator()(std::span<std::uint8_t> out, std::size_t size) noexcept;

 private:
  bool change_reply(link::Reply& reply) noexcept;

  static constexpr std::size_t kOldReplies = 60;
  Mutant mutant_;
  link::Codec codec_;
  link::Incoming in_;
  Vec3 last_w_nn_ = Vec3::Zero();
  std::array<Vec3, kOldReplies> old_w_nn_{};
  std::size_t count_ = 0;
  std::uint32_t epoch_ = 0;
  std::uint64_t last_command_ns_ = 0;
  bool deaf_ = false;
};

}  // namespace telenano::studies::stress
