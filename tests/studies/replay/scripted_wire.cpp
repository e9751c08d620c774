#include "tests/studies/replay/scripted_wire.h"

#include <algorithm>

#include "telenano/common/link/messages.h"

namespace telenano::studies {
namespace {

// A reply may be overtaken, or come twice; one that did not come for so many commands never will.
constexpr std::size_t kRepliesKept = 1u << 16;

}  // namespace

/// The command at hand with steps `first` to `last`, or as many of them as there are and fit. Returns its
/// bytes; `reached`: the last that it holds, first - 1 for none.
std::size_t ScriptedWire::with_steps(std::uint64_t first, std::uint64_t last, std::uint64_t& reached,
                                     std::span<std::uint8_t> out) noexcept {
  std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
  link::StepWriter writer(bytes, first);
  for (reached = first - 1; reached < last; ++reached) {
    const auto found = made_.find(reached + 1);
    if (found == made_.end() || !writer.add(found->second)) break;
  }
  const std::size_t used = writer.count() > 0 ? writer.size() : 0;
  return codec_.encode(incoming_.command, std::span<const std::uint8_t>(bytes).first(used), out);
}

/// The command at hand with steps such that the server has executed those up to `executed` by its reply; 0:
/// not all are there, or they do not fit.
///
/// After a loss a server has had steps waiting for one that was missing, and that one brings on more at once
/// than a datagram holds. So a command at which nothing is executed takes along what comes after the next
/// step, as far as the next reply that came will say (`then`), and leaves the next one out.
std::size_t ScriptedWire::with_steps_until(std::uint64_t executed, std::uint64_t then,
                                           std::span<std::uint8_t> out) noexcept {
  std::uint64_t reached = 0;
  const std::uint64_t next = last_executed_ + 1;
  if (executed == last_executed_) {
    const std::size_t n = with_steps(std::max(waiting_until_, next) + 1, then, reached, out);
    if (reached > next) waiting_until_ = std::max(waiting_until_, reached);
    return n;
  }
  const bool waits = executed <= waiting_until_;
  const std::size_t n = with_steps(next, waits ? next : executed, reached, out);
  if (reached < (waits ? next : executed)) return 0;
  note_executed(executed);
  return n;
}

/// The same for a command whose reply never came: the server executes what it can on the way to `until`,
/// where it is by the next reply that did.
std::size_t ScriptedWire::with_steps_towards(std::uint64_t until, std::span<std::uint8_t> out) noexcept {
  std::uint64_t reached = 0;
  const std::uint64_t next = last_executed_ + 1;
  const bool waits = waiting_until_ > next;
  const std::size_t n = with_steps(next, waits ? next : until, reached, out);
  if (reached >= next) note_executed(waits ? waiting_until_ : reached);
  return n;
}

void ScriptedWire::note_executed(std::uint64_t number) noexcept {
  made_.erase(made_.begin(), made_.upper_bound(number));
  last_executed_ = number;
}

net::SendStatus ScriptedWire::send(std::span<const std::uint8_t> bytes, const net::Address&) noexcept {
  if (!open_ && !executed_.empty()) {
    waits_for_steps_.push_back({clock_.now_ns(), {bytes.begin(), bytes.end()}});
  } else {
    deliver(bytes, clock_.now_ns());
  }
  return net::SendStatus::kSent;
}

void ScriptedWire::end_tick(std::uint64_t number, const link::LoggedStep& step) {
  if (number > last_executed_) made_[number] = step;
  for (const auto& [at_ns, bytes] : waits_for_steps_) deliver(bytes, at_ns);
  waits_for_steps_.clear();
}

void ScriptedWire::deliver(std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
  std::uint64_t number = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> rewritten{};
  if (!open_) {
    if (codec_.decode(bytes, incoming_) != link::DropCause::kNone ||
        incoming_.type != link::MessageType::kCommand)
      return;
    number = incoming_.command.sequence;
    if (!order_.commands.contains(number)) return;
    if (!executed_.empty()) {
      // Of the next reply that came it is known: what is made before that is nobody's to see.
      const auto next = executed_.lower_bound(number);
      const bool known = next != executed_.end() && next->first == number;
      const auto later = std::find_if(next, executed_.end(),
                                      [&](const auto& reply) { return reply.second > last_executed_; });
      const std::uint64_t then = later != executed_.end() ? later->second : last_executed_;
      const std::uint64_t until =
          next != executed_.end() ? std::max(next->second, last_executed_) : last_executed_;
      const std::size_t n = known || until == last_executed_ ? with_steps_until(until, then, rewritten)
                                                             : with_steps_towards(until, rewritten);
      if (n == 0) {
        if (other_steps_at_ == 0) other_steps_at_ = number;
        return;
      }
      bytes = std::span<const std::uint8_t>(rewritten).first(n);
    }
  }
  std::vector<std::uint8_t> answer(link::kMaxDatagramBytes);
  const std::size_t size = server_.on_datagram(bytes, address_, now_ns, answer);
  if (size == 0) return;
  answer.resize(size);
  if (open_) {
    waiting_.push_back(std::move(answer));
    return;
  }
  ++steps_;
  const auto expected = executed_.find(number);
  if (expected != executed_.end() && other_steps_at_ == 0 &&
      (codec_.decode(answer, incoming_) != link::DropCause::kNone ||
       incoming_.reply.steps.executed != expected->second))
    other_steps_at_ = number;
  replies_[number] = std::move(answer);
  if (replies_.size() > kRepliesKept) replies_.erase(replies_.begin());
}

const std::vector<std::uint8_t>* ScriptedWire::reply_to(std::uint64_t command) const {
  const auto found = replies_.find(command);
  return found == replies_.end() ? nullptr : &found->second;
}

bool ScriptedWire::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  const auto give = [&](const std::vector<std::uint8_t>& bytes, std::int64_t age_ns) {
    std::copy_n(bytes.begin(), std::min(bytes.size(), buffer.size()), buffer.begin());
    received = {};
    received.size = bytes.size();
    received.from = address_;
    received.age_ns = age_ns;
    return true;
  };
  if (!waiting_.empty()) {
    const auto bytes = std::move(waiting_.front());
    waiting_.pop_front();
    return give(bytes, 0);
  }
  while (!rows_.empty()) {
    const recording::DatagramRow row = rows_.front();
    rows_ = rows_.subspan(1);
    if (row.type != static_cast<std::uint32_t>(link::MessageType::kReply)) continue;
    if (const auto* reply = reply_to(row.answers)) return give(*reply, clock_.now_ns() - row.came_ns);
  }
  return false;
}

}  // namespace telenano::studies
