#include "tests/studies/flood/flooder.h"

#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstring>

#include "telenano/common/link/codec.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::studies {
namespace {

/// Of an address on loopback: IPv4 or IPv6.
socklen_t sockaddr_of(const net::Address& address, sockaddr_storage& name) noexcept {
  name = {};
  const bool v4 = address.ip[10] == 0xff && address.ip[11] == 0xff;
  if (v4) {
    auto& in = reinterpret_cast<sockaddr_in&>(name);
    in.sin_family = AF_INET;
    in.sin_port = htons(address.port);
    std::memcpy(&in.sin_addr, address.ip.data() + 12, 4);
    return sizeof in;
  }
  auto& in = reinterpret_cast<sockaddr_in6&>(name);
  in.sin6_family = AF_INET6;
  in.sin6_port = htons(address.port);
  std::memcpy(&in.sin6_addr, address.ip.data(), 16);
  return sizeof in;
}

}  // namespace

Flooder::Flooder(const net::Address& to, double rate_per_s, std::uint64_t seed)
    : to_(to), rate_per_s_(rate_per_s), random_(seed), pool_(kPool) {
  for (std::size_t i = 0; i < kSockets; ++i) sockets_.push_back(net::Udp::open_for(to));
  fill_pool();
  thread_ = std::thread([this] { run(); });
}

Flooder::~Flooder() {
  stop_ = true;
  thread_.join();
}

void Flooder::overhear(std::span<const std::uint8_t> datagram) noexcept {
  const std::unique_lock lock(overheard_mutex_, std::try_to_lock);
  if (!lock.owns_lock()) return;  // another time
  overheard_.size = std::min(datagram.size(), overheard_.data.size());
  std::copy_n(datagram.begin(), overheard_.size, overheard_.data.begin());
}

void Flooder::fill_pool() {
  link::Codec codec;
  for (std::size_t i = 0; i < kPool; ++i) {
    Bytes& bytes = pool_[i];
    switch (i % 6) {
      case 0:
        bytes.size = random_.below(bytes.data.size() + 1);
        for (std::size_t k = 0; k < bytes.size; ++k)
          bytes.data[k] = static_cast<std::uint8_t>(random_.bits());
        break;
      case 1: {
        link::Command command;
        command.session_id = random_.bits() | 1;
        command.sequence = 1 + random_.below(1u << 20);
        command.epoch = 1;
        command.flags = link::kFlagClutch | link::kFlagDeadman;
        command.tip_pos_w_nm = {1, 2, -40};
        bytes.size = codec.encode(command, bytes.data);
        if (i % 12 == 7) bytes.size = random_.below(bytes.size);  // truncated
        break;
      }
      case 2: {
        link::Hello hello;
        hello.nonce = random_.bits() | 1;
        hello.cookie = random_.bits() | 1;
        bytes.size = codec.encode(hello, bytes.data);
        break;
      }
      case 3: {
        link::Command stop;
        stop.session_id = random_.bits() << 8;  // the first slot's
        stop.sequence = random_.bits() | 1;
        stop.flags = link::kFlagStop;
        bytes.size = codec.encode(stop, bytes.data);
        break;
      }
      case 4:
        bytes.size = codec.encode(link::Bye{random_.bits() << 8 | 256, link::ByeReason::kDone}, bytes.data);
        break;
      default:
        break;  // the place of a replay
    }
  }
}

void Flooder::run() {
  const rt::SteadyClock clock;
  sockaddr_storage name{};
  const socklen_t name_bytes = sockaddr_of(to_, name);
  std::array<mmsghdr, kBatch> messages{};
  std::array<iovec, kBatch> parts{};
  Bytes replay;
  std::size_t next = 0;
  const std::int64_t start_ns = clock.now_ns();
  std::uint64_t sent = 0;
  for (std::size_t turn = 0; !stop_.load(std::memory_order_relaxed); ++turn) {
    const double due = 1e-9 * static_cast<double>(clock.now_ns() - start_ns) * rate_per_s_;
    if (static_cast<double>(sent) >= due) {
      const timespec pause{0, 50'000};
      ::nanosleep(&pause, nullptr);
      continue;
    }
    {
      const std::lock_guard lock(overheard_mutex_);
      replay = overheard_;
    }
    for (std::size_t i = 0; i < kBatch; ++i) {
      Bytes& bytes = pool_[next];
      if (next % 6 == 5) {
        bytes.size = replay.size;
        std::copy_n(replay.data.begin(), replay.size, bytes.data.begin());
      }
      parts[i] = {bytes.data.data(), bytes.size};
      messages[i].msg_hdr = {&name, name_bytes, &parts[i], 1, nullptr, 0, 0};
      next = (next + 1) % kPool;
    }
    const int n = ::sendmmsg(sockets_[turn % kSockets].handle(), messages.data(), kBatch, 0);
    if (n > 0) sent += static_cast<std::uint64_t>(n);
    sent_.store(sent, std::memory_order_relaxed);
  }
}

}  // namespace telenano::studies
