#include "telenano/nve_server/server/token_search.h"

namespace telenano::server {
namespace {

constexpr std::uint32_t kIndexBits = 8;
static_assert(WorkerMail::kOpenQuestions <= (1u << kIndexBits));

}  // namespace

link::DropCause TokenSearch::ask(const link::Hello& hello, const net::Address& from,
                                 const net::Standing& standing, std::size_t free_places,
                                 std::int64_t now_ns) noexcept {
  using State = Question::State;
  std::size_t free = questions_.size();
  std::size_t of_party = 0;
  for (std::size_t i = 0; i < questions_.size(); ++i) {
    const Question& q = questions_[i];
    if (q.state == State::kFree) {
      if (free == questions_.size()) free = i;
    } else if (q.hello.nonce == hello.nonce && q.from == from) {
      return link::DropCause::kDuplicate;
    } else if (q.standing.identity == standing.identity && (standing.identity != 0 || q.from.ip == from.ip)) {
      ++of_party;
    }
  }
  if (of_party >= most_of_one_party(free_places) || free == questions_.size())
    return link::DropCause::kRateLimited;
  Question& q = questions_[free];
  q.state = State::kAsking;
  ++q.generation;
  q.unheard = 0;
  q.hello = hello;
  q.from = from;
  q.standing = standing;
  q.since_ns = now_ns;
  ++open_;
  HandoffMessage message;
  message.kind = HandoffMessage::Kind::kAsk;
  message.from = static_cast<std::uint32_t>(worker_);
  message.ticket = static_cast<std::uint32_t>(free) | (q.generation << kIndexBits);
  message.token = hello.resume_token;
  message.owner = standing.identity;
  for (std::size_t to = 0; to < mail_->workers(); ++to) {
    if (to == worker_) continue;
    ++q.unheard;
    // Where there is no room the question goes unheard and grows old; nothing is opened twice for it.
    mail_->post(to, message);
  }
  return link::DropCause::kNone;
}

const TokenSearch::Question* TokenSearch::find(std::uint32_t ticket) const noexcept {
  const std::size_t index = ticket & ((1u << kIndexBits) - 1);
  if (index >= questions_.size()) return nullptr;
  const Question& q = questions_[index];
  const bool asks = q.state == Question::State::kAsking && (ticket ^ (q.generation << kIndexBits)) == index;
  return asks ? &q : nullptr;
}

void TokenSearch::on_answer(std::uint32_t ticket, bool final) noexcept {
  if (find(ticket) == nullptr) return;
  Question& q = questions_[ticket & ((1u << kIndexBits) - 1)];
  if (q.unheard > 0) --q.unheard;
  if (final || q.unheard == 0) q.state = Question::State::kAnswered;
}

bool TokenSearch::take_answered(Question& question) noexcept {
  if (open_ == 0) return false;
  for (Question& q : questions_) {
    if (q.state != Question::State::kAnswered) continue;
    question = q;
    q.state = Question::State::kFree;
    --open_;
    return true;
  }
  return false;
}

void TokenSearch::forget_old(std::int64_t now_ns) noexcept {
  if (open_ == 0) return;
  for (Question& q : questions_) {
    if (q.state != Question::State::kAsking || now_ns - q.since_ns <= kPatienceNs) continue;
    q.state = Question::State::kFree;
    --open_;
  }
}

}  // namespace telenano::server
