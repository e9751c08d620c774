#include "tests/studies/replay/scripted_wire.h"

#include <algorithm>

#include "common/link/messages.h"

namespace telenano::studies {
namespace {

// A reply may be overtaken, or come twice; one that did not come for so many commands never will.
constexpr std::size_t kRepliesKept = 1u << 16;

}  // namespace

net::SendStatus ScriptedWire::send(std::span<const std::uint8_t> bytes, const net::Address&) noexcept {
  std::uint64_t number = 0;
  if (!open_) {
    if (codec_.decode(bytes, incoming_) != link::DropCause::kNone ||
        incoming_.type != link::MessageType::kCommand)
      return net::SendStatus::kSent;
    number = incoming_.command.sequence;
    if (!order_.commands.contains(number)) return net::SendStatus::kSent;
  }
  std::vector<std::uint8_t> answer(link::kMaxDatagramBytes);
  const std::size_t size = server_.on_datagram(bytes, address_, clock_.now_ns(), answer);
  if (size == 0) return net::SendStatus::kSent;
  answer.resize(size);
  if (open_) {
    waiting_.push_back(std::move(answer));
  } else {
    ++steps_;
    replies_[number] = std::move(answer);
    if (replies_.size() > kRepliesKept) replies_.erase(replies_.begin());
  }
  return net::SendStatus::kSent;
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
