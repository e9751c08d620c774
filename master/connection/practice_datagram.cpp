#include "telenano/master/connection/practice_datagram.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace telenano::connection {
namespace {

constexpr double kNsPerMs = 1e6;

void apply(const link::PracticeLink& link, net::ImpairmentConfig& config) noexcept {
  config.delay_ns = std::llround(0.5 * kNsPerMs * link.rtt_ms);
  config.jitter_ns = std::llround(kNsPerMs * link.jitter_ms);
  config.jitter = net::ImpairmentConfig::Jitter::kHalfNormal;
  config.loss = link.loss;
}

}  // namespace

PracticeDatagram::PracticeDatagram(net::Datagram& inner, Clock clock, const link::PracticeLink& link,
                                   std::uint64_t seed)
    : inner_(inner),
      clock_(clock),
      began_ns_(clock()),
      up_({}, seed),
      down_({}, seed + 1),
      going_(kCapacity, kSlotBytes),
      coming_(kCapacity, kSlotBytes),
      coming_from_(kCapacity),
      buffer_(kSlotBytes) {
  set(link);
}

void PracticeDatagram::set(const link::PracticeLink& link) noexcept {
  apply(link, up_.config);
  apply(link, down_.config);
}

void PracticeDatagram::move_on(std::int64_t now) noexcept {
  for (; going_.next_arrival_ns() <= now; going_.pop()) inner_.send(going_.front().bytes, to_);
  inner_.flush();
  net::Received received;
  while (coming_.room() > 1 && inner_.receive(buffer_, received)) {
    // What is cut is of no use to anybody.
    if (received.size > buffer_.size()) continue;
    // From when it reached this machine on, not from when somebody looked.
    came_ns_ = std::max(came_ns_, now - received.age_ns);
    const net::Fate fate = down_.send(received.size, came_ns_, coming_.room() - 1);
    for (std::size_t i = 0; i < fate.n; ++i) {
      coming_from_[came_ % kCapacity] = received;
      coming_.put(std::span(buffer_).first(received.size), fate.copies[i], came_++ % kCapacity);
    }
  }
}

net::SendStatus PracticeDatagram::send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept {
  const std::int64_t now = now_ns();
  to_ = to;
  if (bytes.size() > kSlotBytes) return net::SendStatus::kFailed;
  const net::Fate fate = up_.send(bytes.size(), now, going_.room());
  for (std::size_t i = 0; i < fate.n; ++i) going_.put(bytes, fate.copies[i]);
  move_on(now);
  return net::SendStatus::kSent;
}

bool PracticeDatagram::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  const std::int64_t now = now_ns();
  move_on(now);
  if (coming_.next_arrival_ns() > now) return false;
  const net::DelayLine::Item item = coming_.front();
  received = coming_from_[item.tag];
  received.size = item.size;
  received.age_ns = now - item.arrival_ns;
  std::memcpy(buffer.data(), item.bytes.data(), std::min(buffer.size(), item.bytes.size()));
  coming_.pop();
  return true;
}

void PracticeDatagram::flush() noexcept {
  move_on(now_ns());
}

}  // namespace telenano::connection
