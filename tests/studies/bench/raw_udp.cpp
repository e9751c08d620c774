#include "tests/studies/bench/raw_udp.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "tests/studies/bench/pinned_thread.h"

namespace telenano::studies {
namespace {

constexpr std::size_t kBytes = 576;
constexpr std::size_t kBatch = 32;

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  at.sin_port = htons(port);
  return at;
}

}  // namespace

RawUdp::RawUdp() : handle_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in at = loopback(0);
  socklen_t length = sizeof at;
  if (handle_ < 0 || ::bind(handle_, reinterpret_cast<sockaddr*>(&at), sizeof at) != 0 ||
      ::getsockname(handle_, reinterpret_cast<sockaddr*>(&at), &length) != 0) {
    throw RunError(std::string("bench: no UDP socket on loopback: ") + std::strerror(errno));
  }
  port_ = ntohs(at.sin_port);
  const int bytes = 4 << 20;
  ::setsockopt(handle_, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
  ::setsockopt(handle_, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
}

RawUdp::~RawUdp() {
  ::close(handle_);
}

void RawUdp::connect_to(std::uint16_t port) const {
  const sockaddr_in at = loopback(port);
  if (::connect(handle_, reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0)
    throw RunError(std::string("bench: connect: ") + std::strerror(errno));
}

void RawUdp::blocking(bool yes) const {
  const int flags = ::fcntl(handle_, F_GETFL);
  ::fcntl(handle_, F_SETFL, yes ? flags & ~O_NONBLOCK : flags | O_NONBLOCK);
  const timeval patience{0, 50'000};
  ::setsockopt(handle_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
}

void echo_one_by_one(const RawUdp& socket, std::size_t reply_bytes, const std::atomic<bool>& stop) {
  std::array<std::uint8_t, kBytes> bytes{};
  while (!stop.load(std::memory_order_relaxed)) {
    sockaddr_in from{};
    socklen_t length = sizeof from;
    if (::recvfrom(socket.handle(), bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from),
                   &length) < 0)
      continue;
    ::sendto(socket.handle(), bytes.data(), reply_bytes, 0, reinterpret_cast<sockaddr*>(&from), length);
  }
}

void echo_batched(const RawUdp& socket, std::size_t reply_bytes, std::int64_t work_ns,
                  const std::atomic<bool>& stop, std::atomic<std::uint64_t>& answered) {
  std::vector<std::array<std::uint8_t, kBytes>> bytes(kBatch);
  std::array<sockaddr_in, kBatch> names{};
  std::array<iovec, kBatch> parts{};
  std::array<mmsghdr, kBatch> headers{};
  std::uint64_t sum = 0;
  while (!stop.load(std::memory_order_relaxed)) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      parts[i] = {bytes[i].data(), kBytes};
      headers[i].msg_hdr = {};
      headers[i].msg_hdr.msg_name = &names[i];
      headers[i].msg_hdr.msg_namelen = sizeof names[i];
      headers[i].msg_hdr.msg_iov = &parts[i];
      headers[i].msg_hdr.msg_iovlen = 1;
    }
    const int n = ::recvmmsg(socket.handle(), headers.data(), kBatch, MSG_DONTWAIT, nullptr);
    for (int i = 0; i < n; ++i) {
      parts[static_cast<std::size_t>(i)].iov_len = reply_bytes;
      if (work_ns == 0) continue;
      const std::int64_t end_ns = clock_ns(CLOCK_MONOTONIC) + work_ns;
      while (clock_ns(CLOCK_MONOTONIC) < end_ns) {
      }
    }
    if (n > 0) {
      const int sent = ::sendmmsg(socket.handle(), headers.data(), static_cast<unsigned>(n), MSG_DONTWAIT);
      if (sent > 0) answered.store(sum += static_cast<std::uint64_t>(sent), std::memory_order_relaxed);
    }
    if (n == static_cast<int>(kBatch)) continue;
    pollfd entry{socket.handle(), POLLIN, 0};
    const timespec patience{0, 50'000'000};
    ::ppoll(&entry, 1, &patience, nullptr);
  }
}

}  // namespace telenano::studies
