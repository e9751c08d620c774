#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace telenano::link {

/// How many sessions each party has in several tables together. A party is who opens sessions: a key or
/// certificate, or in the clear an IP address, as a number that nobody can choose (a keyed hash). Two parties
/// may fall on one counter, once in kCounters: they then share what one may have. Any thread; never waits.
class PartyCounts {
 public:
  static constexpr std::size_t kCounters = 16384;

  /// One more; false: it has `max`.
  bool take(std::uint64_t party, std::size_t max) noexcept {
    std::atomic<std::uint32_t>& count = of(party);
    std::uint32_t now = count.load(std::memory_order_relaxed);
    while (now < max) {
      if (count.compare_exchange_weak(now, now + 1, std::memory_order_relaxed)) return true;
    }
    return false;
  }
  /// One more, whatever it has: a session that moves from table to table.
  void add(std::uint64_t party) noexcept { of(party).fetch_add(1, std::memory_order_relaxed); }
  void give_back(std::uint64_t party) noexcept { of(party).fetch_sub(1, std::memory_order_relaxed); }
  std::size_t count(std::uint64_t party) const noexcept {
    return counts_[party % kCounters].load(std::memory_order_relaxed);
  }

 private:
  std::atomic<std::uint32_t>& of(std::uint64_t party) noexcept { return counts_[party % kCounters]; }

  std::array<std::atomic<std::uint32_t>, kCounters> counts_{};
};

}  // namespace telenano::link
