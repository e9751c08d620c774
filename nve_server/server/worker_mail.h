#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "telenano/common/rt/spsc_queue.h"
#include "telenano/nve_server/server/session_port.h"

namespace telenano::server {

/// What one worker says to another about a resume token that a station showed to the first one.
struct HandoffMessage {
  enum class Kind : std::uint8_t {
    kAsk,      ///< have you a session with `token`? Then hand it over
    kNotHere,  ///< no
    kState     ///< here it is: `state` belongs to the receiver
  };
  Kind kind = Kind::kAsk;
  std::uint32_t from = 0;    ///< worker
  std::uint32_t ticket = 0;  ///< of the question, given back with the answer
  std::uint64_t token = 0;
  std::uint64_t owner = 0;  ///< identity of the channel by which it was shown
  SessionState* state = nullptr;
};

/// Letters between workers, one queue a pair. Never waits. What was not fetched goes with the object, which
/// must outlive the workers.
class WorkerMail {
 public:
  /// Questions that one worker may have open at once. Each takes one place in every queue from it and one in
  /// every queue to it, so no queue ever overflows.
  static constexpr std::size_t kOpenQuestions = 128;

  explicit WorkerMail(std::size_t workers);
  ~WorkerMail();
  WorkerMail(const WorkerMail&) = delete;
  WorkerMail& operator=(const WorkerMail&) = delete;

  std::size_t workers() const noexcept { return workers_; }
  /// Worker `message.from` only. False if there was no room.
  bool post(std::size_t to, const HandoffMessage& message) noexcept {
    return queue(message.from, to).push(message);
  }
  /// Worker `to` only. False if there is none.
  bool fetch(std::size_t to, HandoffMessage& message) noexcept;

 private:
  rt::SpscQueue<HandoffMessage>& queue(std::size_t from, std::size_t to) noexcept {
    return *queues_[from * workers_ + to];
  }

  std::size_t workers_;
  std::vector<std::unique_ptr<rt::SpscQueue<HandoffMessage>>> queues_;
};

}  // namespace telenano::server
