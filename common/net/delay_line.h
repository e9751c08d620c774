#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "telenano/common/net/impairment.h"

namespace telenano::net {

/// Datagrams on their way, given out by time of arrival; equal times keep the order of sending. Everything is
/// allocated at construction. One thread.
///
/// What arrives no sooner than all before it waits in a queue, O(1); only what overtakes goes into a heap.
/// The next is the sooner of the two first ones.
class DelayLine {
 public:
  /// Keeps up to `capacity` datagrams, of each the first `slot_bytes`.
  DelayLine(std::size_t capacity, std::size_t slot_bytes);

  std::size_t room() const noexcept { return free_.size(); }
  bool empty() const noexcept { return waiting_ == 0 && heap_.empty(); }
  /// Keeps a copy of `bytes`, cut and corrupted as `copy` says. `tag` comes out with it. Needs room().
  void put(std::span<const std::uint8_t> bytes, const Fate::Copy& copy, std::uint64_t tag = 0) noexcept;
  /// INT64_MAX when empty.
  std::int64_t next_arrival_ns() const noexcept { return empty() ? INT64_MAX : first().arrival_ns; }

  struct Item {
    std::int64_t arrival_ns = 0;
    std::size_t size = 0;  ///< of the datagram, also where fewer bytes were kept
    std::uint64_t tag = 0;
    std::span<const std::uint8_t> bytes;  ///< until pop()
  };
  Item front() const noexcept;  ///< of one that is not empty
  void pop() noexcept;

 private:
  struct Arrival {
    std::int64_t arrival_ns;
    std::uint64_t order;
    std::size_t slot;
  };
  struct Slot {
    std::size_t size = 0;
    std::uint64_t tag = 0;
  };
  static bool later(const Arrival& a, const Arrival& b) noexcept {
    return a.arrival_ns != b.arrival_ns ? a.arrival_ns > b.arrival_ns : a.order > b.order;
  }

  bool queue_is_next() const noexcept {
    return heap_.empty() || (waiting_ > 0 && later(heap_.front(), queue_[front_]));
  }
  const Arrival& first() const noexcept { return queue_is_next() ? queue_[front_] : heap_.front(); }
  std::size_t wrapped(std::size_t i) const noexcept { return i < queue_.size() ? i : i - queue_.size(); }

  std::size_t slot_bytes_;
  std::unique_ptr<std::uint8_t[]> bytes_;
  std::vector<Slot> slots_;
  std::vector<std::size_t> free_;
  std::vector<Arrival> queue_;  ///< a ring: waiting_ of them from front_ on, by time of arrival
  std::size_t front_ = 0;
  std::size_t waiting_ = 0;
  std::vector<Arrival> heap_;
  std::uint64_t order_ = 0;
};

}  // namespace telenano::net
