#pragma once

#include <cstdint>

#include "telenano/common/link/drop_cause.h"

namespace telenano::link {

/// Newest wins: a 64-bit sequence is accepted only if it is higher than every one before. The last 64 are
/// remembered, so that a late datagram (reordered on the way) is told from a repeated one.
///
/// Counts: `lost()` are sequences below the newest that never came, `reordered()` those that came late and
/// were not used, `duplicate()` those that came again (or so late that it cannot be told).
class SequenceWindow {
 public:
  /// How far ahead of the newest a number may be that comes `since_ns` after it: beyond that it is an error,
  /// not a gap, and following it would lock out every later datagram. A sender counts rate_hz numbers a
  /// second; of two datagrams that both come, the delay of the first may have been longer than the second's,
  /// by kLeapSlackS at most, and the clocks may run apart. What a longer delay cuts off comes in a little
  /// later, since the bound grows.
  static constexpr std::uint64_t max_leap(std::uint32_t rate_hz, std::int64_t since_ns) noexcept {
    constexpr std::int64_t kLongest_ns =
        std::int64_t{86'400'000'000'000};  // a day: 8 kHz stay far below 2^32
    const std::int64_t since = since_ns < 0 ? 0 : since_ns > kLongest_ns ? kLongest_ns : since_ns;
    const double numbers = 1.25 * rate_hz * (1e-9 * static_cast<double>(since) + kLeapSlackS);
    return kLeapAtLeast + static_cast<std::uint64_t>(numbers);
  }
  static constexpr double kLeapSlackS = 1;
  static constexpr std::uint64_t kLeapAtLeast = 64;

  void reset() noexcept { *this = {}; }

  /// kNone: newer than all before, and remembered. kStale, kDuplicate, kOutOfRange: do not use.
  DropCause accept(std::uint64_t sequence, std::uint64_t max_leap) noexcept {
    if (sequence == 0) return DropCause::kOutOfRange;
    if (sequence > newest_) {
      const std::uint64_t leap = sequence - newest_;
      if (leap > max_leap) return DropCause::kOutOfRange;
      seen_ = leap < 64 ? (seen_ << leap) | 1u : 1u;
      newest_ = sequence;
      ++received_;
      return DropCause::kNone;
    }
    const std::uint64_t age = newest_ - sequence;
    if (age < 64 && ((seen_ >> age) & 1u) == 0) {
      seen_ |= 1ull << age;
      ++received_;
      ++reordered_;
      return DropCause::kStale;
    }
    ++duplicate_;
    return DropCause::kDuplicate;
  }

  std::uint64_t newest() const noexcept { return newest_; }
  std::uint64_t received() const noexcept { return received_; }  ///< different ones, reordered ones included
  std::uint64_t lost() const noexcept { return newest_ - received_; }
  std::uint64_t reordered() const noexcept { return reordered_; }
  std::uint64_t duplicate() const noexcept { return duplicate_; }

 private:
  std::uint64_t newest_ = 0;
  std::uint64_t seen_ = 0;  ///< bit k: newest - k came
  std::uint64_t received_ = 0;
  std::uint64_t reordered_ = 0;
  std::uint64_t duplicate_ = 0;
};

}  // namespace telenano::link
