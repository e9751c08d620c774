#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "telenano/common/rt/spsc_queue.h"

namespace telenano::server {

/// Wakes the thread that keeps checkpoints. Ringing neither waits nor locks.
class Bell {
 public:
  void ring() noexcept {
    rings_.fetch_add(1, std::memory_order_release);
    rings_.notify_one();
  }
  std::uint32_t rings() const noexcept { return rings_.load(std::memory_order_acquire); }
  void wait_beyond(std::uint32_t seen) const noexcept { rings_.wait(seen, std::memory_order_acquire); }

 private:
  std::atomic<std::uint32_t> rings_{0};
};

/// What a worker says about one of its sessions to the keeper of checkpoints.
struct CheckpointNote {
  enum class Kind : std::uint8_t {
    kState,     ///< as it is now: `size` bytes in `buffer`
    kHandOut,   ///< the same, for the last time: whoever asks for it next may have it
    kGiveBack,  ///< as it was written last: whoever asks for it next may have it
    kEnded      ///< nobody may have it any more
  };
  Kind kind = Kind::kState;
  std::uint32_t buffer = 0;
  std::size_t size = 0;
  std::uint64_t token = 0;
  std::uint64_t owner = 0;
  std::uint64_t number = 0;  ///< grows with each state of a session, whichever server it is with
};

/// From one worker's loop to the keeper: notes, and buffers that go to and fro, so that the loop neither
/// allocates nor waits. Where no buffer is free, a state is written later. On a busy machine the keeper runs once
/// in some ten milliseconds, and then writes what the buffers hold: small states get many buffers.
class CheckpointQueue {
 public:
  static constexpr std::uint32_t kLeastBuffers = 4;
  static constexpr std::uint32_t kMostBuffers = 256;
  static constexpr std::size_t kBytesOfMany = std::size_t{4} << 20;  ///< beyond the least number
  static constexpr std::size_t kNotes = 8192;

  static constexpr std::uint32_t buffers_of(std::size_t bytes) noexcept {
    const std::size_t many = kBytesOfMany / std::max<std::size_t>(bytes, 1);
    return static_cast<std::uint32_t>(std::clamp<std::size_t>(many, kLeastBuffers, kMostBuffers));
  }

  CheckpointQueue(std::size_t bytes, Bell& bell)
      : bytes_(bytes), bell_(bell), notes_(kNotes), free_(buffers_of(bytes)) {
    for (std::uint32_t i = 0; i < buffers_of(bytes); ++i) {
      buffers_.push_back(std::make_unique_for_overwrite<std::uint8_t[]>(bytes));  // most is never touched
      free_.push(i);
    }
  }

  // The loop's end.

  /// The bytes to write the next state into; empty: the keeper has all buffers.
  std::span<std::uint8_t> next_buffer() noexcept {
    if (!has_buffer_) has_buffer_ = free_.pop(buffer_);
    return has_buffer_ ? buffer(buffer_) : std::span<std::uint8_t>();
  }
  /// With the state that was written into next_buffer(): note.size bytes. False: no room, nothing was said.
  bool post_state(CheckpointNote note) noexcept {
    note.buffer = buffer_;
    if (!post(note)) return false;
    has_buffer_ = false;
    ++posted_;
    return true;
  }
  bool post(const CheckpointNote& note) noexcept {
    const std::uint32_t lets_go = lets_go_with(note) ? 1 : 0;
    letting_go_.fetch_add(lets_go, std::memory_order_relaxed);  // before what is said of it by any other way
    const bool posted = notes_.push(note);
    if (!posted) letting_go_.fetch_sub(lets_go, std::memory_order_release);
    bell_.ring();
    return posted;
  }
  /// Is the keeper done with all states, and with what lets sessions go?
  bool idle() const noexcept { return done_.load(std::memory_order_acquire) == posted_ && !lets_go(); }

  // Both.

  std::span<std::uint8_t> buffer(std::uint32_t i) noexcept { return {buffers_[i].get(), bytes_}; }

  // The keeper's end.
  bool fetch(CheckpointNote& note) noexcept { return notes_.pop(note); }
  /// Does a note wait here, or is it not done() yet, by which somebody else may have a session? One that was
  /// posted before something else that was heard since is counted.
  bool lets_go() const noexcept { return letting_go_.load(std::memory_order_acquire) != 0; }
  void done(const CheckpointNote& note) noexcept {
    if (lets_go_with(note)) letting_go_.fetch_sub(1, std::memory_order_release);
  }
  void give_back(std::uint32_t buffer) noexcept {
    free_.push(buffer);
    done_.fetch_add(1, std::memory_order_release);
  }

 private:
  static constexpr bool lets_go_with(const CheckpointNote& note) noexcept {
    return note.kind == CheckpointNote::Kind::kHandOut || note.kind == CheckpointNote::Kind::kGiveBack;
  }

  std::size_t bytes_;
  Bell& bell_;
  rt::SpscQueue<CheckpointNote> notes_;
  rt::SpscQueue<std::uint32_t> free_;
  std::vector<std::unique_ptr<std::uint8_t[]>> buffers_;
  std::atomic<std::uint64_t> done_{0};
  std::atomic<std::uint32_t> letting_go_{0};
  // The loop's own.
  std::uint64_t posted_ = 0;
  std::uint32_t buffer_ = 0;
  bool has_buffer_ = false;
};

}  // namespace telenano::server
