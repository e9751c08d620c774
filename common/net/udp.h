#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "telenano/common/net/datagram.h"

namespace telenano::net {

/// "127.0.0.1:5100", "[::1]:5100", "host.lab:5100", ":5100" (every address of this machine). Throws
/// UserError, naming `what` (e.g. "--listen"), if it cannot be understood or resolved.
Address parse_address(const std::string& text, const std::string& what);
std::string to_string(const Address& address);
/// Expedited Forwarding, RFC 3246: low delay, low jitter.
inline constexpr int kDscpEf = 46;
/// "ef" → 46, "none" → 0, "0" … "63". Throws UserError, naming `what`, for anything else.
int parse_dscp(const std::string& text, const std::string& what);
/// Datagrams to and from this machine only?
bool is_loopback(const Address& address) noexcept;

struct UdpOptions {
  /// So long a wait may look at the network card itself before it sleeps (SO_BUSY_POLL); 0: not at all. Has
  /// no effect on loopback; a kernel that does not grant it is no error (Udp::busy_poll_ns tells).
  std::int64_t busy_poll_ns = 0;
  /// The kernel notes when each datagram came (Received::age_ns), for who looks once a tick; costs the others
  /// some 50 ns a datagram.
  bool arrival_times = true;
};

/// What the network has answered (ICMP) instead of the peer: nobody listens on that port, or there is no way
/// to that host.
enum class Unreachable : std::uint8_t { kNo, kPort, kHost };

/// A UDP socket that never waits in send() and receive(). IPv4 and IPv6.
class Udp final : public Datagram {
 public:
  /// Asked of the kernel, each way. A burst of 64 stations at 4 kHz during a 20 ms stall of the loop is about
  /// 5000 datagrams; the kernel charges some 800 bytes for each.
  static constexpr std::size_t kBufferBytes = std::size_t{4} << 20;

  /// Bound to `local` (the server's end). Throws UserError if the port is taken or the address is not this
  /// machine's.
  static Udp listen(const Address& local, const UdpOptions& options = {});
  /// Bound to any free port, for talking to `peer` (the station's end).
  static Udp open_for(const Address& peer);

  Udp(Udp&&) noexcept;
  Udp& operator=(Udp&&) noexcept;
  ~Udp() override;

  SendStatus send(std::span<const std::uint8_t> bytes, const Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, Received& received) noexcept override;
  /// Sleeps until a datagram is there (true), or the time has passed or a signal has come (false).
  bool wait_readable(std::int64_t timeout_ns) noexcept;
  /// From now on listens to such answers. For the end that talks to one peer: they do not say to which
  /// datagram.
  void notice_unreachable() noexcept;
  /// The last one since a datagram came. A peer that is being restarted looks like this too: a reason to
  /// tell, not to give up.
  Unreachable unreachable() const noexcept;
  /// Marks what is sent from now on with a differentiated services code point, 0 … 63 (RFC 2474), so that
  /// routers that look at it can put it first. False where the system does not let us.
  bool set_dscp(int dscp) noexcept;
  Address local() const noexcept;
  std::int64_t busy_poll_ns() const noexcept;  ///< granted
  /// What the kernel has granted of kBufferBytes: less than that (net.core.rmem_max) and a stall of the loop
  /// loses datagrams sooner.
  std::size_t receive_buffer_bytes() const noexcept;
  int handle() const noexcept;  ///< the file descriptor, to wait for several sockets at once

 private:
  struct Impl;
  explicit Udp(std::unique_ptr<Impl> impl) noexcept;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::net
