#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/net/datagram.h"
#include "telenano/nve_server/server/worker_mail.h"

namespace telenano::server {

/// The Hellos of one worker that wait until the others have said whether theirs is the token. A Hello that
/// waits longer than kPatienceNs is forgotten: the station repeats it.
class TokenSearch {
 public:
  static constexpr std::int64_t kPatienceNs = 100'000'000;

  struct Question {
    enum class State : std::uint8_t { kFree, kAsking, kAnswered };
    State state = State::kFree;
    std::uint32_t generation = 0;
    std::size_t unheard = 0;  ///< workers that have not answered
    link::Hello hello;
    net::Address from;
    net::Standing standing;
    std::int64_t since_ns = 0;
  };

  /// Without `mail` there is nobody to ask.
  TokenSearch(WorkerMail* mail, std::size_t worker) noexcept : mail_(mail), worker_(worker) {}

  bool has_others() const noexcept { return mail_ != nullptr && mail_->workers() > 1; }
  /// Is anything open?
  bool waits() const noexcept { return open_ > 0; }

  /// Of these, and of the places that are free, one key, or in the clear one address, may have three quarters: who shows tokens
  /// of nobody's one after the other does not keep others from their sessions.
  static constexpr std::size_t most_of_one_party(std::size_t free_places) noexcept {
    return std::max<std::size_t>(3 * std::min(WorkerMail::kOpenQuestions, free_places) / 4, 1);
  }

  /// Asks all others. kDuplicate: the same Hello waits already; kRateLimited: too many wait.
  link::DropCause ask(const link::Hello& hello, const net::Address& from, const net::Standing& standing,
                      std::size_t free_places, std::int64_t now_ns) noexcept;
  /// An answer to `ticket`: `final` if nobody else needs to be heard.
  void on_answer(std::uint32_t ticket, bool final) noexcept;
  /// One that is answered, and free from now on; its Hello can be judged. False: none.
  bool take_answered(Question& question) noexcept;
  /// Who waits for the answer to `ticket`; null: nobody any more.
  const Question* find(std::uint32_t ticket) const noexcept;
  void forget_old(std::int64_t now_ns) noexcept;

 private:
  WorkerMail* mail_;
  std::size_t worker_;
  std::size_t open_ = 0;
  std::array<Question, WorkerMail::kOpenQuestions> questions_;
};

}  // namespace telenano::server
