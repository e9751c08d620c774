#include "telenano/common/net/udp_batch.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <vector>

#include "telenano/common/net/socket_name.h"

namespace telenano::net {
namespace {

// One line more than a power of two, so that the fronts of the slots do not all fall into the same few sets
// of the first cache.
constexpr std::size_t kStrideBytes = UdpBatch::kSlotBytes + 64;

// Where one datagram comes at a time, asking for a second one each time is a tenth of the exchange.
constexpr std::uint64_t kAloneFor = 8;
constexpr std::uint64_t kLookEvery = 16;

/// Between the kernel's stamp on a datagram and `now`, both CLOCK_REALTIME; 0 if it has none, or if the clock
/// was set in between. `here`: which address it came to, where that is told.
std::int64_t age_ns(msghdr& header, const timespec& now, std::array<std::uint8_t, 16>& here) noexcept {
  std::int64_t age = 0;
  for (cmsghdr* part = CMSG_FIRSTHDR(&header); part != nullptr; part = CMSG_NXTHDR(&header, part)) {
    here_of(*part, here);
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec came{};
    std::memcpy(&came, CMSG_DATA(part), sizeof came);
    age = (now.tv_sec - came.tv_sec) * std::int64_t{1'000'000'000} + (now.tv_nsec - came.tv_nsec);
  }
  return age > 0 && age < 1'000'000'000 ? age : 0;
}

}  // namespace

struct UdpBatch::Impl {
  /// What the kernel tells of a datagram besides: when it came, and where to.
  struct alignas(cmsghdr) Told {
    std::array<std::byte, CMSG_SPACE(sizeof(timespec)) + kHereControlBytes> bytes;
  };
  /// What it is told for an answer: where from.
  struct alignas(cmsghdr) From {
    std::array<std::byte, kHereControlBytes> bytes;
  };

  /// What the kernel fills or reads, a slot a datagram.
  struct Ring {
    explicit Ring(std::size_t n)
        : bytes(std::make_unique<std::uint8_t[]>(n * kStrideBytes)), names(n), parts(n), headers(n) {
      for (std::size_t i = 0; i < n; ++i) {
        parts[i] = {slot(i), kSlotBytes};
        msghdr& header = headers[i].msg_hdr;
        header = {};
        header.msg_name = &names[i];
        header.msg_iov = &parts[i];
        header.msg_iovlen = 1;
      }
    }
    std::uint8_t* slot(std::size_t i) const noexcept { return bytes.get() + i * kStrideBytes; }

    std::unique_ptr<std::uint8_t[]> bytes;
    std::vector<SocketName> names;
    std::vector<iovec> parts;
    std::vector<mmsghdr> headers;
  };

  Impl(Udp& s, std::size_t n) : socket(s), handle(s.handle()), in(n), out(n), told(n) {
    SocketName name{};
    socklen_t length = sizeof name;
    ::getsockname(handle, reinterpret_cast<sockaddr*>(&name), &length);
    v6 = name.v6.sin6_family == AF_INET6;
    int on = 0;
    socklen_t size = sizeof on;
    stamped = ::getsockopt(handle, SOL_SOCKET, SO_TIMESTAMPNS, &on, &size) == 0 && on != 0;
    here = tells_here(handle, v6);
    if (here) sources.resize(n);
    // Every call here says for itself whether it waits.
    const int flags = ::fcntl(handle, F_GETFL);
    const timeval patience{0, static_cast<suseconds_t>(kShortWaitNs / 1000)};
    may_wait = flags >= 0 && ::setsockopt(handle, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) == 0 &&
               ::fcntl(handle, F_SETFL, flags & ~O_NONBLOCK) == 0;
  }

  /// Asks the kernel; true if it had anything. `wait_flag`: MSG_DONTWAIT, or MSG_WAITFORONE to wait for it.
  bool fetch(int wait_flag) noexcept {
    for (std::size_t i = 0; i < touched; ++i) {  // the kernel has shortened these
      msghdr& header = in.headers[i].msg_hdr;
      header.msg_namelen = sizeof(SocketName);
      header.msg_control = stamped || here ? &told[i] : nullptr;
      header.msg_controllen = stamped || here ? sizeof(Told) : 0;
      header.msg_flags = 0;
    }
    touched = 0;
    next = filled = 0;
    for (int tries = 0; tries < 8; ++tries) {
      ++counters.receive_calls;
      const int n = wait_flag == MSG_WAITFORONE && comes_alone() ? receive_one() : receive_many(wait_flag);
      if (n > 0) {
        alone = n > 1 ? 0 : wait_flag == MSG_WAITFORONE ? alone + 1 : alone;
        filled = touched = static_cast<std::size_t>(n);
        emptied = filled < in.headers.size();
        counters.received += filled;
        if (stamped) ::clock_gettime(CLOCK_REALTIME, &fetched_at);
        return true;
      }
      // A port that was unreachable a moment ago (ICMP) is reported here, for a datagram sent earlier.
      const bool again = errno == ECONNREFUSED || errno == EHOSTUNREACH || errno == ENETUNREACH ||
                         (errno == EINTR && wait_flag == MSG_DONTWAIT);
      if (!again) break;
    }
    return false;
  }

  /// Waited for, and one at a time, so far: then the kernel is not asked for more, but now and then.
  bool comes_alone() const noexcept { return alone >= kAloneFor && alone % kLookEvery != 0; }

  // MSG_TRUNC: the true size of a datagram that is cut, so that the receiver can tell.

  int receive_many(int wait_flag) noexcept {
    return ::recvmmsg(handle, in.headers.data(), static_cast<unsigned>(in.headers.size()),
                      MSG_TRUNC | wait_flag, nullptr);
  }

  /// 1, or -1, after waiting.
  int receive_one() noexcept {
    const ssize_t size = ::recvmsg(handle, &in.headers.front().msg_hdr, MSG_TRUNC);
    if (size < 0) return -1;
    in.headers.front().msg_len = static_cast<unsigned>(size);
    return 1;
  }

  /// 1, or -1: a call for one costs less than one for many.
  int send_one(std::size_t i) const noexcept {
    const msghdr& header = out.headers[i].msg_hdr;
    if (header.msg_controllen > 0)
      return ::sendmsg(handle, &header, MSG_NOSIGNAL | MSG_DONTWAIT) >= 0 ? 1 : -1;
    return ::sendto(handle, header.msg_iov->iov_base, header.msg_iov->iov_len, MSG_NOSIGNAL | MSG_DONTWAIT,
                    static_cast<const sockaddr*>(header.msg_name), header.msg_namelen) >= 0
               ? 1
               : -1;
  }

  void flush() noexcept {
    std::size_t first = 0;
    int tries = 0;
    while (first < kept) {
      ++counters.send_calls;
      const int n = kept - first == 1
                        ? send_one(first)
                        : ::sendmmsg(handle, out.headers.data() + first, static_cast<unsigned>(kept - first),
                                     MSG_NOSIGNAL | MSG_DONTWAIT);
      if (n > 0) {
        first += static_cast<std::size_t>(n);
        counters.sent += static_cast<std::size_t>(n);
        tries = 0;
        continue;
      }
      if ((errno == EINTR || errno == ECONNREFUSED) && ++tries < 3) continue;
      if (errno == EAGAIN || errno == EWOULDBLOCK || errno == ENOBUFS)
        break;  // no room for the others either
      ++first;  // this one cannot go (no route, a filter): the others can
      ++counters.not_sent;
      tries = 0;
    }
    counters.not_sent += kept - first;
    kept = 0;
  }

  Udp& socket;
  int handle;
  bool v6 = false;
  bool stamped = false;  // the kernel notes when datagrams come
  bool here = false;     // and which of this machine's addresses they come to
  bool may_wait = false;
  Ring in;
  Ring out;
  std::vector<Told> told;
  std::vector<From> sources;
  std::size_t filled = 0;   // of `in`, by the last fetch
  std::size_t next = 0;     // of these, to be given out
  std::size_t touched = 0;  // headers that the kernel has changed
  bool emptied = false;     // the last fetch took all that there was
  timespec fetched_at{};
  std::size_t kept = 0;     // of `out`
  std::uint64_t alone = 0;  // waits in a row that brought one datagram each
  Counters counters;
};

UdpBatch::UdpBatch(Udp& socket, std::size_t batch)
    : impl_(std::make_unique<Impl>(socket, std::clamp<std::size_t>(batch, 1, 1024))) {
  impl_->touched = impl_->in.headers.size();  // none has been set up yet
}

UdpBatch::~UdpBatch() {
  impl_->flush();
}

SendStatus UdpBatch::send(std::span<const std::uint8_t> bytes, const Address& to) noexcept {
  Impl& m = *impl_;
  if (bytes.size() > kSlotBytes) {
    m.flush();
    return m.socket.send(bytes, to);
  }
  if (!is_v4(to) && !m.v6) return SendStatus::kFailed;  // no way from an IPv4 socket to an IPv6 address
  if (m.kept == m.out.headers.size()) m.flush();
  const std::size_t i = m.kept++;
  if (!bytes.empty()) std::memcpy(m.out.slot(i), bytes.data(), bytes.size());
  m.out.parts[i].iov_len = bytes.size();
  msghdr& header = m.out.headers[i].msg_hdr;
  header.msg_namelen = to_kernel(to, m.v6, m.out.names[i]);
  header.msg_control = nullptr;
  header.msg_controllen = 0;
  if (m.here && !is_any(to.here)) leave_from(to.here, m.v6, &m.sources[i], header);
  return SendStatus::kSent;
}

bool UdpBatch::receive(std::span<std::uint8_t> buffer, Received& received) noexcept {
  Impl& m = *impl_;
  if (m.next == m.filled) {
    m.flush();
    if (m.emptied) {
      m.emptied = false;
      return false;
    }
    if (!m.fetch(MSG_DONTWAIT)) return false;
  }
  const std::size_t i = m.next++;
  mmsghdr& header = m.in.headers[i];
  received.size = header.msg_len;
  received.from = from_kernel(m.in.names[i]);
  received.age_ns = m.stamped || m.here ? age_ns(header.msg_hdr, m.fetched_at, received.from.here) : 0;
  const std::size_t kept = std::min({received.size, kSlotBytes, buffer.size()});
  if (kept > 0) std::memcpy(buffer.data(), m.in.slot(i), kept);
  return true;
}

void UdpBatch::flush() noexcept {
  impl_->flush();
}

bool UdpBatch::wait(std::int64_t timeout_ns) noexcept {
  Impl& m = *impl_;
  m.flush();
  if (m.next < m.filled) return true;
  if (timeout_ns <= 0) return false;
  m.emptied = false;
  return m.may_wait && timeout_ns <= kShortWaitNs ? m.fetch(MSG_WAITFORONE)
                                                  : m.socket.wait_readable(timeout_ns);
}

const UdpBatch::Counters& UdpBatch::counters() const noexcept {
  return impl_->counters;
}

}  // namespace telenano::net
