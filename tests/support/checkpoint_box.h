#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "telenano/nve_server/server/checkpoint.h"
#include "telenano/nve_server/server/worker_mail.h"

namespace telenano::support {

/// What app::CheckpointKeeper is to the programs, in memory: it keeps the newest checkpoint of each session, and
/// gives it to the server that asks, if the last one is dead. It outlives the servers.
class CheckpointBox {
 public:
  explicit CheckpointBox(std::size_t bytes) : queue_(bytes, mail_.bell()) {}

  server::WorkerMail& mail() noexcept { return mail_; }
  server::CheckpointQueue& queue() noexcept { return queue_; }
  void set_make_slave(std::function<std::unique_ptr<slave::Slave>()> make) { make_slave_ = std::move(make); }

  void work() {
    server::CheckpointNote note;
    while (queue_.fetch(note)) {
      using Kind = server::CheckpointNote::Kind;
      if (note.kind == Kind::kState || note.kind == Kind::kHandOut) {
        const auto bytes = queue_.buffer(note.buffer).first(note.size);
        if (!frozen_) kept_[note.token].assign(bytes.begin(), bytes.end());
        number_[note.token] = note.number;
        ++written_;
        queue_.give_back(note.buffer);
      } else if (note.kind == Kind::kEnded) {
        kept_.erase(note.token);
        ++ended_;
      }
      queue_.done(note);
    }
    server::HandoffMessage question;
    while (mail_.fetch(1, question)) {
      server::HandoffMessage answer;
      answer.kind = server::HandoffMessage::Kind::kNotHere;
      answer.from = 1;
      answer.ticket = question.ticket;
      server::CheckpointHead head;
      const auto found = kept_.find(question.token);
      if (found != kept_.end() && server::read_checkpoint_head(found->second, head) &&
          head.owner == question.owner) {
        if (auto state = server::read_checkpoint(of, found->second, make_slave_())) {
          state->record.checkpoints = number_[question.token];
          answer.kind = server::HandoffMessage::Kind::kState;
          answer.state = state.release();
          ++taken_;
        }
      }
      mail_.post(question.from, answer);
    }
  }
  /// From now on what is written is thrown away: who takes up gets the old one again and again.
  void freeze(bool frozen) noexcept { frozen_ = frozen; }
  int written() const noexcept { return written_; }
  std::uint64_t number(std::uint64_t token) const { return number_.contains(token) ? number_.at(token) : 0; }
  int taken() const noexcept { return taken_; }
  int ended() const noexcept { return ended_; }
  std::map<std::uint64_t, std::vector<std::uint8_t>>& kept() noexcept { return kept_; }

  server::CheckpointOf of{0, 1};

 private:
  server::WorkerMail mail_{1, true};
  server::CheckpointQueue queue_;
  std::function<std::unique_ptr<slave::Slave>()> make_slave_;
  std::map<std::uint64_t, std::vector<std::uint8_t>> kept_;  // by token
  std::map<std::uint64_t, std::uint64_t> number_;
  bool frozen_ = false;
  int written_ = 0;
  int taken_ = 0;
  int ended_ = 0;
};

}  // namespace telenano::support
