#pragma once

#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace telenano::rt {

/// Bounded queue from exactly one producer thread to exactly one consumer thread. Neither side ever waits: a
/// push into a full queue drops the new element and counts it. All memory is taken by the constructor.
///
/// Indices grow for ever (2^64 at 4 kHz is 10^8 years) and are masked on access, so full and empty need no
/// spare slot. Each side keeps a private copy of the other's index and reads the shared one only when the
/// copy says full or empty: the usual push touches no cache line that the consumer writes.
template <class T>
class SpscQueue {
  static_assert(std::is_trivially_copyable_v<T>, "elements are copied while the other side runs");

 public:
  /// Holds at least `capacity` elements (rounded up to a power of two).
  explicit SpscQueue(std::size_t capacity)
      : slots_(std::bit_ceil(capacity < 2 ? std::size_t{2} : capacity)), mask_(slots_.size() - 1) {}

  SpscQueue(const SpscQueue&) = delete;
  SpscQueue& operator=(const SpscQueue&) = delete;

  /// Producer only. False when the queue was full; the element is then counted as dropped.
  bool push(const T& element) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_seen_ == slots_.size()) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail - head_seen_ == slots_.size()) {
        dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
        return false;
      }
    }
    slots_[tail & mask_] = element;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Consumer only. False when the queue was empty.
  bool pop(T& element) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_seen_) {
      tail_seen_ = tail_.load(std::memory_order_acquire);
      if (head == tail_seen_) return false;
    }
    element = slots_[head & mask_];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  /// Any thread: elements dropped so far.
  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }
  std::size_t capacity() const noexcept { return slots_.size(); }

 private:
  static constexpr std::size_t kLine = 64;

  std::vector<T> slots_;
  const std::size_t mask_;
  alignas(kLine) std::atomic<std::uint64_t> tail_{0};  // written by the producer
  std::uint64_t head_seen_ = 0;
  std::atomic<std::uint64_t> dropped_{0};
  alignas(kLine) std::atomic<std::uint64_t> head_{0};  // written by the consumer
  std::uint64_t tail_seen_ = 0;
};

}  // namespace telenano::rt
