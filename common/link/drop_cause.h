#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::link {

/// Why a datagram was not used. Each one is counted under exactly one cause: the first that applies, in the
/// order in which a receiver looks (PROTOCOL.md, "Drop causes").
enum class DropCause : std::uint8_t {
  kNone = 0,
  kTruncated,       ///< shorter than the header, or than its header says
  kOversize,        ///< longer than 512 bytes
  kBadMagic,        ///< not ours
  kWrongVersion,    ///< header of a version that is not spoken here
  kUnknownType,     ///< no such message, or one that only the other side may send
  kBadLength,       ///< longer than its header says, or a Hello that is not padded to 512 bytes
  kMalformedField,  ///< unknown, repeated or cut field, or wrong wire type
  kOutOfRange,      ///< a value that no peer may send: unknown enumerator, sequence 0, a leap of the sequence
  kNonFinite,       ///< NaN or infinity
  kUnknownSession,  ///< no such session (any more)
  kUnauthenticated,  ///< wrong cookie, nonce or address
  kStale,            ///< older than the newest accepted
  kDuplicate,        ///< seen before
  kWrongEpoch,       ///< of another energy account
  kUnexpected,       ///< well formed, but not in this state
  kFull,             ///< no room for one more session
  kRateLimited,      ///< more than the bounded rate of answers
  kCount
};

inline constexpr std::size_t kDropCauseCount = static_cast<std::size_t>(DropCause::kCount);

/// Short name for counters, CSV and messages, e.g. "bad_magic".
constexpr const char* name(DropCause cause) noexcept {
  constexpr std::array<const char*, kDropCauseCount + 1> kNames = {"none",
                                                                   "truncated",
                                                                   "oversize",
                                                                   "bad_magic",
                                                                   "wrong_version",
                                                                   "unknown_type",
                                                                   "bad_length",
                                                                   "malformed_field",
                                                                   "out_of_range",
                                                                   "non_finite",
                                                                   "unknown_session",
                                                                   "unauthenticated",
                                                                   "stale",
                                                                   "duplicate",
                                                                   "wrong_epoch",
                                                                   "unexpected",
                                                                   "full",
                                                                   "rate_limited",
                                                                   "?"};
  const auto i = static_cast<std::size_t>(cause);
  return kNames[i < kDropCauseCount ? i : kDropCauseCount];
}

/// How many datagrams were dropped, by cause.
class DropCounters {
 public:
  void add(DropCause cause) noexcept { ++count_[static_cast<std::size_t>(cause)]; }
  void add(const DropCounters& more) noexcept {
    for (std::size_t i = 0; i < kDropCauseCount; ++i) count_[i] += more.count_[i];
  }
  std::uint64_t operator[](DropCause cause) const noexcept { return count_[static_cast<std::size_t>(cause)]; }
  std::uint64_t total() const noexcept {
    std::uint64_t sum = 0;
    for (std::size_t i = 1; i < kDropCauseCount; ++i) sum += count_[i];
    return sum;
  }

 private:
  std::array<std::uint64_t, kDropCauseCount> count_{};
};

}  // namespace telenano::link
