#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "proto/wire_fields.h"
#include "telenano/common/link/message_checks.h"
#include "telenano/common/link/recent_commands.h"
#include "telenano/common/link/wire_bytes.h"
#include "telenano/common/link/wire_scan.h"

/// What stands behind the other fields of a Command, written and read by hand: the commands that it repeats, and the steps
/// of a log. To Protobuf a nested message or a byte string there would cost an allocation each.
namespace telenano::link {

inline std::size_t recent_field_bytes(std::size_t count) noexcept {
  const std::size_t length = count * kRecentBytes;
  return count == 0 ? 0 : kRecentTagBytes + length_bytes(length) + length;
}

inline void write_recent(const RecentCommands& recent, std::uint8_t* at) noexcept {
  constexpr std::uint32_t kTag = (kCommandRecentCommands << 3) | 2u;
  const std::size_t length = recent.count * kRecentBytes;
  put(at, (kTag & 0x7fu) | 0x80u, 1);
  put(at, kTag >> 7, 1);
  put_length(at, length);
  for (std::size_t i = 0; i < recent.count; ++i) {
    const RecentCommand& r = recent.record[i];
    put(at, r.age_ns, 4);
    put(at, r.flags, 4);
    for (int axis = 0; axis < 3; ++axis) put(at, r.tip_pos_w_nm[axis]);
    put(at, r.energy);
    for (int axis = 0; axis < 3; ++axis) put(at, r.wave_sum[axis]);
  }
}

inline DropCause read_recent(std::span<const std::uint8_t> bytes, std::uint64_t sequence,
                             RecentCommands& recent) noexcept {
  recent.count = bytes.size() / kRecentBytes;
  const std::uint8_t* at = bytes.data();
  bool finite = true, good = recent.count < sequence;
  std::uint32_t last_age_ns = 0;
  for (std::size_t i = 0; i < recent.count; ++i) {
    RecentCommand& r = recent.record[i];
    r.age_ns = static_cast<std::uint32_t>(take(at, 4));
    r.flags = static_cast<std::uint32_t>(take(at, 4));
    for (int axis = 0; axis < 3; ++axis) r.tip_pos_w_nm[axis] = take(at);
    r.energy = take(at);
    for (int axis = 0; axis < 3; ++axis) r.wave_sum[axis] = take(at);
    finite = finite && all_finite(r.tip_pos_w_nm) && all_finite(r.wave_sum) && all_finite(r.energy);
    good = good && r.age_ns >= last_age_ns && r.energy >= 0;
    last_age_ns = r.age_ns;
  }
  return !finite ? DropCause::kNonFinite : good ? DropCause::kNone : DropCause::kOutOfRange;
}

inline std::size_t steps_field_bytes(std::size_t length) noexcept {
  return length == 0 ? 0 : kRecentTagBytes + length_bytes(length) + length;
}

inline void write_steps(std::span<const std::uint8_t> steps, std::uint8_t* at) noexcept {
  constexpr std::uint32_t kTag = (kCommandSteps << 3) | 2u;
  put(at, (kTag & 0x7fu) | 0x80u, 1);
  put(at, kTag >> 7, 1);
  put_length(at, steps.size());
  std::memcpy(at, steps.data(), steps.size());
}

}  // namespace telenano::link
