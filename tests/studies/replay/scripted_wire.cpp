#include "tests/studies/replay/scripted_wire.h"

#include <algorithm>
#include <limits>

#include "telenano/common/link/messages.h"

namespace telenano::studies {
namespace {

// A reply may be overtaken, or come twice; one that did not come for so many commands never will.
constexpr std::size_t kRepliesKept = 1u << 16;

}  // namespace

/// The command at hand with the next steps up to `last`, or as many of them as are made and fit: its bytes.
std::size_t ScriptedWire::with_steps(std::uint64_t last, std::span<std::uint8_t> out) noexcept {
  std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
  link::StepWriter writer(bytes, brought_ + 1);
  for (; brought_ < last; ++brought_) {
    const auto found = made_.find(brought_ + 1);
    if (found == made_.end() || !writer.add(found->second)) break;
    made_.erase(found);
  }
  const std::size_t used = writer.count() > 0 ? writer.size() : 0;
  return codec_.encode(incoming_.command, std::span<const std::uint8_t>(bytes).first(used), out);
}

/// The last step that the slave may make by this command. If its reply was lost, nobody saw what it had made:
/// anything up to what the next reply that came says. After the last one nothing is seen any more.
std::uint64_t ScriptedWire::executed_by(std::uint64_t command) const noexcept {
  const auto next = executed_.lower_bound(command);
  return next != executed_.end() ? std::max(next->second, last_executed_) : last_executed_;
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
  if (number > brought_) made_[number] = step;
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
      const std::uint64_t most = executed_by(number);
      server_.set_steps_at_once(static_cast<std::size_t>(most - last_executed_));
      // A stop leaves out what is not executed: it must not find more than had come.
      const bool stops = (incoming_.command.flags & link::kFlagStop) != 0;
      bytes = std::span<const std::uint8_t>(rewritten).first(
          with_steps(stops ? most : std::numeric_limits<std::uint64_t>::max(), rewritten));
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
  if (!executed_.empty()) {
    const bool answers = codec_.decode(answer, incoming_) == link::DropCause::kNone &&
                         incoming_.type == link::MessageType::kReply;
    if (answers) last_executed_ = incoming_.reply.steps.executed;
    const auto expected = executed_.find(number);
    const bool other = expected != executed_.end() && (!answers || last_executed_ != expected->second);
    if (other && other_steps_at_ == 0) other_steps_at_ = number;
  }
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
