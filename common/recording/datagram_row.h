#pragma once

#include <cstdint>
#include <type_traits>

namespace telenano::recording {

/// One datagram that the station took in, in the order in which it looked at them. With the samples' own
/// columns it is what a replay needs to know of the network: what came when, which reply answered which
/// command and so, by the replies' numbers, in which order the slave stepped.
struct DatagramRow {
  std::int64_t tick = 0;       ///< at whose start it was looked at
  std::int64_t came_ns = 0;    ///< when it reached this machine, station clock
  std::uint64_t sequence = 0;  ///< of a reply; else 0
  std::uint64_t answers = 0;   ///< the command that a reply answers; else 0
  std::uint64_t steps_before =
      0;                       ///< of a reply: which of the 64 commands before that one the slave stepped by
  std::uint64_t executed = 0;  ///< of a reply: the last step of the log that the slave had made; else 0
  std::uint32_t type = 0;      ///< link::MessageType; 0 = could not be decoded
  std::uint32_t drop = 0;      ///< link::DropCause; 0 = accepted
  // What else a reply or a Welcome says of the log (link::StepReport, of which `executed` is the first).
  std::uint64_t state_hash = 0;
  std::uint64_t newest = 0;
  std::uint64_t break_step = 0;
  std::uint32_t breaks = 0;
  std::uint32_t break_reason = 0;  ///< of a Bye: its own reason (link::ByeReason)
  std::uint64_t epoch = 0;         ///< of a reply or a Welcome; 0 in recordings made before this was written
  std::uint64_t left_out = 0;      ///< of a reply: those before it in this session that were left out
};

static_assert(std::is_trivially_copyable_v<DatagramRow> && sizeof(DatagramRow) == 104);

}  // namespace telenano::recording
