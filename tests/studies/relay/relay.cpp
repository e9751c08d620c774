#include "tests/studies/relay/relay.h"

#include <algorithm>
#include <ctime>
#include <exception>

namespace telenano::studies {
namespace {

// So much is taken from a socket at a time: a flood in one must not hold up what is due or the others.
constexpr int kBatch = 64;

std::uint64_t tag_of(std::size_t index, std::uint32_t generation) noexcept {
  return (std::uint64_t{generation} << 32) | index;
}

std::uint64_t sub_seed(std::uint64_t seed, std::uint64_t which) noexcept {
  std::uint64_t state = seed ^ (which * 0x9e3779b97f4a7c15ull);
  return Random::splitmix64(state);
}

}  // namespace

Relay::Relay(const RelayConfig& config, const rt::Clock& clock)
    : config_(config),
      clock_(clock),
      start_ns_(clock.now_ns()),
      listen_(net::Udp::listen(config.listen)),
      clients_(config.max_clients),
      waiting_(config.max_clients + 1, pollfd{-1, POLLIN, 0}),
      to_server_(config.to_server, sub_seed(config.seed, 1), config.capacity),
      to_client_(config.to_client, sub_seed(config.seed, 2), config.capacity) {
  waiting_[0].fd = listen_.handle();
}

void Relay::step(std::int64_t wait_ns) noexcept {
  const std::int64_t due_ns = std::min(to_server_.line.next_arrival_ns(), to_client_.line.next_arrival_ns());
  const std::int64_t now = now_ns();
  const std::int64_t wait = std::clamp<std::int64_t>(due_ns > now ? due_ns - now : 0, 0, wait_ns);
  const timespec timeout{static_cast<time_t>(wait / 1'000'000'000), static_cast<long>(wait % 1'000'000'000)};
  if (::ppoll(waiting_.data(), waiting_.size(), &timeout, nullptr) > 0) {
    if (waiting_[0].revents != 0) take_from_clients();
    for (std::size_t i = 0; i < clients_.size(); ++i) {
      if (waiting_[i + 1].fd >= 0 && waiting_[i + 1].revents != 0) take_from_server(i);
    }
  }
  send_due(to_server_);
  send_due(to_client_);
  if (now_ns() >= next_reap_ns_) reap();
}

void Relay::take_from_clients() noexcept {
  net::Received received;
  for (int i = 0; i < kBatch && listen_.receive(buffer_, received); ++i) {
    const std::size_t index = place_of(received.from);
    if (index == clients_.size()) {
      ++counts_.refused;
      continue;
    }
    put(to_server_, received, index);
  }
}

void Relay::take_from_server(std::size_t index) noexcept {
  net::Received received;
  net::Udp& socket = *clients_[index].socket;
  for (int i = 0; i < kBatch && socket.receive(buffer_, received); ++i) {
    // As a NAT does: only the server that the client talks to may answer.
    if (received.from == config_.to) put(to_client_, received, index);
  }
}

void Relay::put(Direction& direction, const net::Received& received, std::size_t index) noexcept {
  const std::int64_t now = now_ns();
  clients_[index].heard_ns = now;
  if (received.size > kDatagramBytes) {
    ++direction.too_long;
    return;
  }
  if (config_.tap) config_.tap({buffer_.data(), received.size}, &direction == &to_server_);
  // Sent when the kernel had it, not when this loop came to look.
  direction.last_sent_ns = std::max(direction.last_sent_ns, now - received.age_ns);
  const net::Fate fate =
      direction.impairment.send(received.size, direction.last_sent_ns, direction.line.room());
  for (std::size_t i = 0; i < fate.n; ++i)
    direction.line.put({buffer_.data(), received.size}, fate.copies[i],
                       tag_of(index, clients_[index].generation));
}

void Relay::send_due(Direction& direction) noexcept {
  const bool up = &direction == &to_server_;
  // What became due while sending waits for the next turn: reading must not starve either.
  const std::int64_t turn_ns = now_ns();
  while (direction.line.next_arrival_ns() <= turn_ns && !direction.line.empty()) {
    const net::DelayLine::Item item = direction.line.front();
    Client& client = clients_[item.tag & 0xffffffffu];
    const bool there = client.socket.has_value() && client.generation == item.tag >> 32;
    net::SendStatus status = net::SendStatus::kFailed;
    if (there) {
      status = up ? client.socket->send(item.bytes, config_.to) : listen_.send(item.bytes, client.address);
    }
    if (status == net::SendStatus::kSent) {
      ++direction.impairment.counts.delivered;
      direction.late.add(now_ns() - item.arrival_ns);
    } else {
      ++direction.not_sent;
    }
    direction.line.pop();
  }
}

std::size_t Relay::place_of(const net::Address& address) noexcept {
  const auto is_it = [&](const Client& c) { return c.socket.has_value() && c.address == address; };
  if (is_it(clients_[last_place_])) return last_place_;
  std::size_t free = clients_.size();
  for (std::size_t i = 0; i < clients_.size(); ++i) {
    if (is_it(clients_[i])) return last_place_ = i;
    if (!clients_[i].socket.has_value() && free == clients_.size()) free = i;
  }
  if (free == clients_.size()) return free;
  try {
    clients_[free].socket.emplace(net::Udp::open_for(config_.to));
  } catch (const std::exception&) {  // no more sockets to be had: no place
    return clients_.size();
  }
  clients_[free].address = address;
  ++clients_[free].generation;
  waiting_[free + 1].fd = clients_[free].socket->handle();
  waiting_[free + 1].revents = 0;
  ++counts_.now;
  ++counts_.seen;
  return last_place_ = free;
}

void Relay::reap() noexcept {
  const std::int64_t now = now_ns();
  next_reap_ns_ = now + std::min<std::int64_t>(config_.idle_ns / 4, 1'000'000'000);
  for (std::size_t i = 0; i < clients_.size(); ++i) {
    if (!clients_[i].socket.has_value() || now - clients_[i].heard_ns < config_.idle_ns) continue;
    clients_[i].socket.reset();
    waiting_[i + 1].fd = -1;
    --counts_.now;
    ++counts_.idled;
  }
}

}  // namespace telenano::studies
