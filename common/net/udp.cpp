#include "telenano/common/net/udp.h"

#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/ip/v6_only.hpp>

#include "telenano/common/base/error.h"
#include "telenano/common/net/socket_name.h"

namespace telenano::net {
namespace {

using boost::asio::ip::udp;
namespace asio = boost::asio;

[[noreturn]] void bad_address(const std::string& text, const std::string& what, const std::string& why) {
  throw UserError(what + " '" + text + "': " + why +
                  "; expected HOST:PORT, e.g. 127.0.0.1:5100 or [::1]:5100");
}

}  // namespace

Address parse_address(const std::string& text, const std::string& what) {
  const auto colon = text.rfind(':');
  if (colon == std::string::npos) bad_address(text, what, "no port");
  std::string host = text.substr(0, colon);
  const std::string port_text = text.substr(colon + 1);
  unsigned port = 0;
  const char* const end = port_text.data() + port_text.size();
  const auto parsed = std::from_chars(port_text.data(), end, port);
  if (port_text.empty() || parsed.ec != std::errc() || parsed.ptr != end || port > 65535) {
    bad_address(text, what, "port '" + port_text + "' is not a number from 0 to 65535");
  }
  const bool bracketed = host.size() >= 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) host = host.substr(1, host.size() - 2);
  if (!bracketed && host.find(':') != std::string::npos)
    bad_address(text, what, "an IPv6 address needs brackets");
  if (host.empty() && !bracketed) host = "0.0.0.0";
  if (host.empty()) bad_address(text, what, "no host");

  boost::system::error_code error;
  const auto literal = asio::ip::make_address(host, error);
  if (!error) return from_endpoint(udp::endpoint(literal, static_cast<std::uint16_t>(port)));
  asio::io_context context;
  udp::resolver resolver(context);
  const auto results = resolver.resolve(host, port_text, asio::ip::resolver_base::numeric_service, error);
  if (error || results.empty())
    bad_address(text, what, "cannot find host '" + host + "' (" + error.message() + ")");
  for (const auto& entry : results) {  // most stations and servers listen on IPv4 only
    if (entry.endpoint().address().is_v4()) return from_endpoint(entry.endpoint());
  }
  return from_endpoint(results.begin()->endpoint());
}

int parse_dscp(const std::string& text, const std::string& what) {
  if (text == "ef") return kDscpEf;
  if (text == "none") return 0;
  int value = -1;
  const char* const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, value);
  if (text.empty() || parsed.ec != std::errc() || parsed.ptr != end || value < 0 || value > 63)
    throw UserError(what + " '" + text + "': expected ef, none or a number from 0 to 63");
  return value;
}

std::string to_string(const Address& address) {
  const udp::endpoint endpoint = to_endpoint<udp::endpoint>(address);
  const std::string host = endpoint.address().to_string();
  return (is_v4(address) ? host : "[" + host + "]") + ":" + std::to_string(address.port);
}

bool is_loopback(const Address& address) noexcept {
  if (is_v4(address)) return address.ip[12] == 127;
  constexpr std::array<std::uint8_t, 16> kV6Loopback = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1};
  return address.ip == kV6Loopback;
}

namespace {

/// Time since the kernel received the datagram; 0 if it did not say, or if the wall clock was set in between.
/// `here`: which address it came to, where that is told.
std::int64_t age_ns(msghdr& header, std::array<std::uint8_t, 16>& here) noexcept {
  here = {};
  std::int64_t age = 0;
  for (cmsghdr* part = CMSG_FIRSTHDR(&header); part != nullptr; part = CMSG_NXTHDR(&header, part)) {
    here_of(*part, here);
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec came{}, now{};
    std::memcpy(&came, CMSG_DATA(part), sizeof came);
    ::clock_gettime(CLOCK_REALTIME, &now);
    age = (now.tv_sec - came.tv_sec) * std::int64_t{1'000'000'000} + (now.tv_nsec - came.tv_nsec);
  }
  return age > 0 && age < 1'000'000'000 ? age : 0;
}

}  // namespace

/// Asio makes and sets up the socket, and lets it go: while Asio has it, it is in an epoll set, which is told
/// of every datagram that comes and of every one that has left, 0.1 µs each. Sending and receiving are the
/// plain system calls: Asio's synchronous path costs about 1 µs more a datagram, and there is nothing to
/// port.
struct Udp::Impl {
  int handle = -1;
  Address local;
  bool v6 = false;
  bool here = false;  // it listens on every address, and is told which one a datagram came to
  std::int64_t busy_poll_ns = 0;
  bool notices = false;
  Unreachable unreachable = Unreachable::kNo;
  // The last peer's address as the kernel wants it: nearly always the next one's too.
  Address cached;
  SocketName cached_name{};
  socklen_t cached_length = 0;

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (handle >= 0) ::close(handle);
  }

  void open(const Address& at, const UdpOptions& options, bool answers) {
    const udp::endpoint endpoint = to_endpoint<udp::endpoint>(at);
    asio::io_context context;
    udp::socket socket{context};
    boost::system::error_code error;
    socket.open(endpoint.protocol(), error);
    if (error) throw UserError("cannot open a UDP socket for " + to_string(at) + ": " + error.message());
    boost::system::error_code ignored;  // smaller buffers or IPv6 without IPv4 still work
    set_buffer(socket.native_handle(), SO_RCVBUF, SO_RCVBUFFORCE);
    set_buffer(socket.native_handle(), SO_SNDBUF, SO_SNDBUFFORCE);
    if (endpoint.address().is_v6()) socket.set_option(asio::ip::v6_only(false), ignored);
    const int yes = 1;
    if (options.busy_poll_ns > 0) {
      const int us = static_cast<int>(std::clamp<std::int64_t>(options.busy_poll_ns / 1000, 1, 1'000'000));
      if (::setsockopt(socket.native_handle(), SOL_SOCKET, SO_BUSY_POLL, &us, sizeof us) == 0) {
        busy_poll_ns = us * std::int64_t{1000};
      }
    }
    socket.bind(endpoint, error);
    if (error == asio::error::address_in_use) {
      throw UserError("UDP port " + std::to_string(at.port) + " on " + to_string(at) +
                      " is in use: stop the program that holds it (ss -ulpn) or choose another port");
    }
    if (error == asio::error::access_denied) {
      throw UserError("no permission to use UDP port " + std::to_string(at.port) +
                      ": choose a port from 1024 to 65535");
    }
    if (error)
      throw UserError("cannot listen on " + to_string(at) + ": " + error.message() +
                      "; expected an address of this machine");
    socket.non_blocking(true, error);
    const udp::endpoint bound = socket.local_endpoint(error);
    if (!error) local = from_endpoint(bound);
    handle = socket.release(error);
    if (error) throw RunError("cannot keep a UDP socket: " + error.message());
    // The kernel notes when each datagram came (CLOCK_REALTIME): a loop that looks once a tick would
    // otherwise measure its own period as round trip. Where it is not to be had, age_ns stays 0.
    if (options.arrival_times) ::setsockopt(handle, SOL_SOCKET, SO_TIMESTAMPNS, &yes, sizeof yes);
    // The routing table's choice need not be the address that the peer has written to. Who begins has only
    // that choice.
    v6 = endpoint.address().is_v6();
    here = answers && is_any(at.ip) && tell_here(handle, v6);
  }

  /// Up to net.core.{r,w}mem_max, or beyond for a program that may administer the network.
  static void set_buffer(int socket, int option, int forced) noexcept {
    const int bytes = kBufferBytes;
    if (::setsockopt(socket, SOL_SOCKET, forced, &bytes, sizeof bytes) != 0)
      ::setsockopt(socket, SOL_SOCKET, option, &bytes, sizeof bytes);
  }

  /// What a call has just ended with: the network's word on an earlier datagram? Then it is noted, and true.
  bool note(int error) noexcept {
    if (error == ECONNREFUSED) unreachable = Unreachable::kPort;
    if (error == EHOSTUNREACH || error == ENETUNREACH) unreachable = Unreachable::kHost;
    const bool noted = error == ECONNREFUSED || error == EHOSTUNREACH || error == ENETUNREACH;
    if (!noted || !notices) return noted;
    // The kernel keeps the whole story besides; until it is fetched, every wait ends at once.
    std::array<std::byte, 512> story;
    msghdr header{};
    header.msg_control = story.data();
    do {
      header.msg_controllen = story.size();
    } while (::recvmsg(handle, &header, MSG_ERRQUEUE | MSG_DONTWAIT) >= 0);
    return noted;
  }

  void cache(const Address& to) noexcept {
    if (cached_length != 0 && to == cached) return;
    cached_length = to_kernel(to, !is_v4(to), cached_name);
    cached = to;
  }

  /// To whom cache() was told.
  ssize_t send(std::span<const std::uint8_t> bytes) const noexcept {
    return ::sendto(handle, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
                    reinterpret_cast<const sockaddr*>(&cached_name), cached_length);
  }

  ssize_t send_from(const std::array<std::uint8_t, 16>& from,
                    std::span<const std::uint8_t> bytes) const noexcept {
    alignas(cmsghdr) std::array<std::byte, kHereControlBytes> control;
    SocketName to = cached_name;
    iovec part{const_cast<std::uint8_t*>(bytes.data()), bytes.size()};
    msghdr header{};
    header.msg_name = &to;
    header.msg_namelen = cached_length;
    header.msg_iov = &part;
    header.msg_iovlen = 1;
    leave_from(from, v6, control.data(), header);
    return ::sendmsg(handle, &header, MSG_NOSIGNAL | MSG_DONTWAIT);
  }

  void remember(const SocketName& name, socklen_t length, Address& from) noexcept {
    if (length == cached_length && std::memcmp(&name, &cached_name, length) == 0) {
      from = cached;
      return;
    }
    from = from_kernel(name);
    cached_name = name;
    cached_length = length;
    cached = from;
  }
};

Udp::Udp(std::unique_ptr<Impl> impl) noexcept : impl_(std::move(impl)) {}
Udp::Udp(Udp&&) noexcept = default;
Udp& Udp::operator=(Udp&&) noexcept = default;
Udp::~Udp() = default;

Udp Udp::listen(const Address& local, const UdpOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->open(local, options, true);
  return Udp(std::move(impl));
}

Udp Udp::open_for(const Address& peer) {
  Address any;
  if (is_v4(peer)) std::copy(kV4Prefix.begin(), kV4Prefix.end(), any.ip.begin());
  auto impl = std::make_unique<Impl>();
  impl->open(any, {}, false);
  return Udp(std::move(impl));
}

SendStatus Udp::send(std::span<const std::uint8_t> bytes, const Address& to) noexcept {
  impl_->cache(to);
  for (int tries = 0; tries < 3; ++tries) {
    const ssize_t n = impl_->here && !is_any(to.here) ? impl_->send_from(to.here, bytes) : impl_->send(bytes);
    if (n >= 0) return SendStatus::kSent;
    if (errno == EAGAIN || errno == EWOULDBLOCK || errno == ENOBUFS) return SendStatus::kWouldBlock;
    // A port that was unreachable a moment ago (ICMP) is reported here, for an earlier datagram: try this
    // one.
    if (errno != EINTR && !impl_->note(errno)) break;
  }
  return SendStatus::kFailed;
}

bool Udp::receive(std::span<std::uint8_t> buffer, Received& received) noexcept {
  for (int tries = 0; tries < 8; ++tries) {
    SocketName name;
    alignas(cmsghdr) std::array<std::byte, CMSG_SPACE(sizeof(timespec)) + kHereControlBytes> control;
    iovec part{buffer.data(), buffer.size()};
    msghdr header{};
    header.msg_name = &name;
    header.msg_namelen = sizeof name;
    header.msg_iov = &part;
    header.msg_iovlen = 1;
    header.msg_control = control.data();
    header.msg_controllen = control.size();
    // MSG_TRUNC: the true size of a datagram that is cut, so that the receiver can tell.
    const ssize_t n = ::recvmsg(impl_->handle, &header, MSG_TRUNC | MSG_DONTWAIT);
    if (n >= 0) {
      received.size = static_cast<std::size_t>(n);
      std::array<std::uint8_t, 16> here;
      received.age_ns = age_ns(header, here);
      impl_->unreachable = Unreachable::kNo;
      impl_->remember(name, header.msg_namelen, received.from);
      received.from.here = here;
      return true;
    }
    if (errno != EINTR && !impl_->note(errno)) return false;
  }
  return false;
}

bool Udp::wait_readable(std::int64_t timeout_ns) noexcept {
  pollfd entry{impl_->handle, POLLIN, 0};
  const std::int64_t ns = std::max<std::int64_t>(timeout_ns, 0);
  const timespec timeout{static_cast<time_t>(ns / 1'000'000'000), static_cast<long>(ns % 1'000'000'000)};
  return ::ppoll(&entry, 1, &timeout, nullptr) > 0;
}

void Udp::notice_unreachable() noexcept {
  const int on = 1;
  const bool v4 = ::setsockopt(impl_->handle, IPPROTO_IP, IP_RECVERR, &on, sizeof on) == 0;
  const bool v6 = ::setsockopt(impl_->handle, IPPROTO_IPV6, IPV6_RECVERR, &on, sizeof on) == 0;
  impl_->notices = v4 || v6;
}

Unreachable Udp::unreachable() const noexcept {
  return impl_->unreachable;
}

bool Udp::set_dscp(int dscp) noexcept {
  // The upper six bits of the octet; the lower two are congestion notification's (RFC 3168).
  const int octet = dscp << 2;
  const bool v4 = ::setsockopt(impl_->handle, IPPROTO_IP, IP_TOS, &octet, sizeof octet) == 0;
  // A socket of IPv6 carries IPv4 too: one option for each, and an IPv4 socket has only the first.
  const bool v6 = ::setsockopt(impl_->handle, IPPROTO_IPV6, IPV6_TCLASS, &octet, sizeof octet) == 0;
  return v4 || v6;
}

Address Udp::local() const noexcept {
  return impl_->local;
}

std::int64_t Udp::busy_poll_ns() const noexcept {
  return impl_->busy_poll_ns;
}

std::size_t Udp::receive_buffer_bytes() const noexcept {
  int bytes = 0;
  socklen_t size = sizeof bytes;
  if (::getsockopt(impl_->handle, SOL_SOCKET, SO_RCVBUF, &bytes, &size) != 0 || bytes < 0) return 0;
  return static_cast<std::size_t>(bytes) / 2;  // Linux doubles what is asked for, for its own accounting
}

int Udp::handle() const noexcept {
  return impl_->handle;
}

}  // namespace telenano::net
