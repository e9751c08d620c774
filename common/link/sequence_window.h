#pragma once

#include <cstdint>

#include "common/link/drop_cause.h"

namespace telenano::link {

/// Newest wins: a 64-bit sequence is accepted only if it is higher than every one before. The last 64 are
/// remembered, so that a late datagram (reordered on the way) is told from a repeated one.
///
/// Counts: `lost()` are sequences below the newest that never came, `reordered()` those that came late and
/// were not used, `duplicate()` those that came again (or so late that it cannot be told).
class SequenceWindow {
 public:
  /// The largest leap that a peer may make: 12 days at 4 kHz. Beyond it the number is an error, not a gap,
  /// and following it would lock out every later datagram.
  static constexpr std::uint64_t kMaxLeap = 1ull << 32;

  void reset() noexcept { *this = {}; }

  /// kNone: newer than all before, and remembered. kStale, kDuplicate, kOutOfRange: do not use.
  DropCause accept(std::uint64_t sequence) noexcept {
    if (sequence == 0) return DropCause::kOutOfRange;
    if (sequence > newest_) {
      const std::uint64_t leap = sequence - newest_;
      if (leap > kMaxLeap) return DropCause::kOutOfRange;
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
