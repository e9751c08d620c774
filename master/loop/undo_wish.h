#pragma once

#include <cstdint>

#include "telenano/common/link/messages.h"

namespace telenano::loop {

/// What became of a wish to take the last stroke of marks back.
enum class UndoAnswer : std::uint32_t {
  kNone,   ///< nobody has asked
  kAsked,  ///< under way
  kDone,
  kRefused,   ///< the tip touches, or there is no stroke to take back
  kNoAnswer,  ///< the server has said nothing; it may have done it
  kAnothers,  ///< of a shared tip: another session has made the last stroke
};

/// A person's wish as the protocol has it (PROTOCOL.md, section 16): the flag stays until a command that had it is
/// answered, and then is clear until one without it is. Pure; told by each tick.
class UndoWish {
 public:
  static constexpr std::int64_t kPatience_ns = 3'000'000'000;

  /// False: the last wish is not over yet.
  bool ask(std::int64_t now_ns) noexcept {
    if (state_ != State::kIdle) return false;
    state_ = State::kAsks;
    since_ns_ = now_ns;
    first_ = 0;
    answer_ = UndoAnswer::kAsked;
    return true;
  }

  /// The flag of this tick's command, which has number `next`.
  std::uint32_t flag(std::uint64_t next) noexcept {
    if (first_ == 0) first_ = next;
    return state_ == State::kAsks ? std::uint32_t{link::kFlagUndo} : 0;
  }

  void on_reply(std::uint64_t command_sequence, std::uint32_t fault_bits) noexcept {
    if (first_ == 0 || command_sequence < first_) return;
    if (state_ == State::kAsks) {
      const bool refused = (fault_bits & link::kFaultUndo) != 0;
      const bool anothers = (fault_bits & link::kFaultUndoAnothers) != 0;
      answer_ = !refused ? UndoAnswer::kDone : anothers ? UndoAnswer::kAnothers : UndoAnswer::kRefused;
      clear();
    } else if (state_ == State::kClears) {
      state_ = State::kIdle;
    }
  }

  void on_time(std::int64_t now_ns) noexcept {
    if (state_ != State::kAsks || now_ns - since_ns_ < kPatience_ns) return;
    answer_ = UndoAnswer::kNoAnswer;
    clear();
  }

  /// Another session: what was asked of the last one is not known, and its numbers are over.
  void on_session() noexcept {
    if (state_ == State::kAsks) answer_ = UndoAnswer::kNoAnswer;
    if (state_ != State::kIdle) clear();
  }

  UndoAnswer answer() const noexcept { return answer_; }

 private:
  enum class State : std::uint8_t { kIdle, kAsks, kClears };
  void clear() noexcept {
    state_ = State::kClears;
    first_ = 0;
  }

  State state_ = State::kIdle;
  UndoAnswer answer_ = UndoAnswer::kNone;
  std::int64_t since_ns_ = 0;
  std::uint64_t first_ = 0;  // command in this state; 0: none yet
};

}  // namespace telenano::loop
