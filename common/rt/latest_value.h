#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace telenano::rt {

/// The newest value of one writer, for any number of readers (a viewer, a progress line). A sequence lock:
/// the writer never waits for anybody, not even for a reader that was suspended half way; a reader copies
/// again when the writer overtook it. The payload lies in relaxed atomic words, so that the race is defined
/// behaviour, not merely benign.
///
/// Memory order, after Boehm, "Can seqlocks get along with programming language memory models?" (2012): the
/// writer makes the sequence odd, then stores the words with release order (each keeps the odd sequence
/// before it), then stores the even sequence with release order; the reader loads the words with acquire
/// order (each keeps the second look at the sequence after it). A reader that sees any word of a newer write
/// therefore also sees a changed sequence. On x86 all of these are plain moves, and ThreadSanitizer
/// understands them, which it does not do with fences.
template <class T>
class LatestValue {
  static_assert(std::is_trivially_copyable_v<T> && std::is_default_constructible_v<T>);

 public:
  LatestValue() noexcept { write_words(T{}); }
  LatestValue(const LatestValue&) = delete;
  LatestValue& operator=(const LatestValue&) = delete;

  /// The writer's thread only. Wait-free.
  void store(const T& value) noexcept {
    const std::uint64_t sequence = sequence_.load(std::memory_order_relaxed);
    sequence_.store(sequence + 1, std::memory_order_relaxed);
    write_words(value);
    sequence_.store(sequence + 2, std::memory_order_release);
  }

  /// Any thread. False when the writer overtook the reader `attempts` times; `value` is then unchanged.
  bool try_load(T& value, int attempts = 100) const noexcept {
    for (int attempt = 0; attempt < attempts; ++attempt) {
      const std::uint64_t before = sequence_.load(std::memory_order_acquire);
      if ((before & 1u) != 0) continue;
      Words words;
      for (std::size_t i = 0; i < kWords; ++i) words[i] = words_[i].load(std::memory_order_acquire);
      if (sequence_.load(std::memory_order_relaxed) != before) continue;
      std::memcpy(static_cast<void*>(&value), words.data(), sizeof(T));
      return true;
    }
    return false;
  }

  /// Any thread but a real-time one: tries until it succeeds.
  T load() const noexcept {
    T value;
    while (!try_load(value)) {
    }
    return value;
  }

  /// Any thread: how many values have been stored, to see whether there is a new one.
  std::uint64_t count() const noexcept { return sequence_.load(std::memory_order_acquire) / 2; }

 private:
  static constexpr std::size_t kWords = (sizeof(T) + 7) / 8;
  using Words = std::array<std::uint64_t, kWords>;

  void write_words(const T& value) noexcept {
    Words words{};
    std::memcpy(words.data(), static_cast<const void*>(&value), sizeof(T));
    for (std::size_t i = 0; i < kWords; ++i) words_[i].store(words[i], std::memory_order_release);
  }

  alignas(64) std::atomic<std::uint64_t> sequence_{0};
  std::array<std::atomic<std::uint64_t>, kWords> words_;
};

}  // namespace telenano::rt
