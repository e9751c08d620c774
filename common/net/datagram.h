#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "common/net/rights.h"

namespace telenano::net {

/// An IPv6 address (IPv4 as ::ffff:a.b.c.d) and a port in host order. Compared as a whole.
struct Address {
  std::array<std::uint8_t, 16> ip{};
  std::uint16_t port = 0;
  friend bool operator==(const Address&, const Address&) = default;
};

enum class SendStatus : std::uint8_t { kSent, kWouldBlock, kFailed };

struct Received {
  std::size_t size = 0;  ///< bytes of the datagram; larger than the buffer means that it was cut
  Address from;
  std::int64_t age_ns =
      0;                ///< since it reached this machine, where that is known; a reader that polls needs it
  Standing standing{};  ///< what the channel vouches for
};

/// Seam: unreliable datagrams that never wait. Implemented by UDP sockets and by the simulated link.
class Datagram {
 public:
  virtual ~Datagram() = default;
  virtual SendStatus send(std::span<const std::uint8_t> bytes, const Address& to) noexcept = 0;
  /// True when a datagram was put into `buffer` and `received`; false when none is waiting.
  virtual bool receive(std::span<std::uint8_t> buffer, Received& received) noexcept = 0;
  /// Hands over at once what send() may have kept back to send it together with more.
  virtual void flush() noexcept {}
};

}  // namespace telenano::net
