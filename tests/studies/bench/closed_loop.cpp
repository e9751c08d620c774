#include "tests/studies/bench/closed_loop.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <string>

#include "telenano/common/base/error.h"
#include "tests/studies/bench/pinned_thread.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kTickNs = 1'000'000;
constexpr std::int64_t kPatienceNs = 50'000'000;  // after it, what has not come is lost

std::int64_t now_ns() noexcept {
  return clock_ns(CLOCK_MONOTONIC);
}

}  // namespace

ClosedLoop::ClosedLoop(const net::Address& server, std::size_t sockets, std::size_t sessions_each, bool model,
                       bool floor)
    : floor_(floor), bytes_(sessions_each) {
  for (std::size_t k = 0; k < sockets; ++k) {
    groups_.push_back(std::make_unique<Group>());
    Group& group = *groups_.back();
    group.socket.connect_to(server.port);
    group.socket.blocking(false);
    group.stations.resize(sessions_each);
    for (std::size_t i = 0; i < sessions_each; ++i) {
      Station& station = group.stations[i];
      station.tick = static_cast<std::int64_t>(37 * (k * sessions_each + i));
      station.motion.model = model;
      if (!floor_) open(group, station, 1 + k * sessions_each + i, model);
    }
  }
  if (!floor_) return;
  // The bytes of a session in touch, as far as an echo cares.
  link::Codec codec;
  link::Command command;
  command.session_id = 0x1234567890ab;
  command.sequence = 1000;
  command.send_time_ns = 123456789;
  command.newest_reply = 999;
  command.epoch = 77;
  Group& group = *groups_.front();
  group.stations.front().motion.fill(command, 500);
  command_bytes_ = codec.encode(command, bytes_.front());
  for (auto& bytes : bytes_) bytes = bytes_.front();
}

void ClosedLoop::open(Group& group, Station& station, std::uint64_t seed, bool model) {
  link::ClientConfig config;
  config.nonce_seed = seed;
  config.feature_bits = model ? link::kKnownFeatures : 0;
  station.session = std::make_unique<link::ClientSession>(config);
  std::array<std::uint8_t, 576> bytes{};
  station.session->start(now_ns());
  const std::int64_t end_ns = now_ns() + 10'000'000'000;
  while (station.session->state() != link::ClientState::kEstablished) {
    if (now_ns() > end_ns) throw RunError("bench: a session does not open");
    if (const std::size_t n = station.session->poll(now_ns(), bytes))
      ::send(group.socket.handle(), bytes.data(), n, 0);
    pollfd entry{group.socket.handle(), POLLIN, 0};
    ::poll(&entry, 1, 10);
    const ssize_t n = ::recv(group.socket.handle(), bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (n > 0) station.session->on_datagram({bytes.data(), static_cast<std::size_t>(n)}, now_ns());
  }
  station.motion = Motion::of(station.session->welcome(), model);
}

void ClosedLoop::send(Group& group) {
  std::array<mmsghdr, 64> headers{};
  std::array<iovec, 64> parts{};
  const std::size_t n = group.stations.size();
  for (std::size_t i = 0; i < n; ++i) {
    Station& station = group.stations[i];
    if (!floor_) {
      station.motion.fill(station.command, station.tick++);
      command_bytes_ = station.session->make_command(station.command, station.tick * kTickNs, bytes_[i]);
    }
    parts[i] = {bytes_[i].data(), command_bytes_};
    headers[i].msg_hdr.msg_iov = &parts[i];
    headers[i].msg_hdr.msg_iovlen = 1;
  }
  const int sent = ::sendmmsg(group.socket.handle(), headers.data(), static_cast<unsigned>(n), 0);
  group.outstanding = static_cast<std::size_t>(std::max(sent, 0));
  group.answered = 0;
}

void ClosedLoop::collect(Group& group) {
  std::array<std::array<std::uint8_t, 576>, 64> in;
  std::array<mmsghdr, 64> headers{};
  std::array<iovec, 64> parts{};
  const std::int64_t end_ns = now_ns() + kPatienceNs;
  while (group.answered < group.outstanding) {
    for (std::size_t i = 0; i < headers.size(); ++i) {
      parts[i] = {in[i].data(), in[i].size()};
      headers[i].msg_hdr = {};
      headers[i].msg_hdr.msg_iov = &parts[i];
      headers[i].msg_hdr.msg_iovlen = 1;
    }
    const int n = ::recvmmsg(group.socket.handle(), headers.data(), headers.size(), MSG_DONTWAIT, nullptr);
    for (int i = 0; i < n; ++i) {
      const std::size_t size = headers[static_cast<std::size_t>(i)].msg_len;
      reply_bytes_ = size;
      ++group.answered;
      if (floor_) {
        ++answers_;
        continue;
      }
      // One server thread answers in the order in which it was asked.
      const std::size_t which = std::min(group.answered - 1, group.stations.size() - 1);
      Station& station = group.stations[which];
      const auto event = station.session->on_datagram({in[static_cast<std::size_t>(i)].data(), size},
                                                      station.tick * kTickNs);
      ++(event == link::ClientEvent::kReply ? answers_ : lost_);
    }
    if (n <= 0 && now_ns() > end_ns) break;
  }
  lost_ += group.outstanding - std::min(group.answered, group.outstanding);
  group.outstanding = 0;
}

std::uint64_t ClosedLoop::run(std::int64_t duration_ns) {
  const std::uint64_t before = answers_;
  const std::int64_t end_ns = now_ns() + duration_ns;
  while (now_ns() < end_ns) {
    for (auto& group : groups_) {
      collect(*group);
      send(*group);
    }
  }
  for (auto& group : groups_) collect(*group);
  return answers_ - before;
}

}  // namespace telenano::studies
