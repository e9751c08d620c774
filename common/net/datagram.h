#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/net/rights.h"

namespace telenano::net {

/// An IPv6 address (IPv4 as ::ffff:a.b.c.d) and a port in host order: those two are compared.
struct Address {
  std::array<std::uint8_t, 16> ip{};
  std::uint16_t port = 0;
  /// Which of this machine's addresses the peer has written to, where a socket listens on all of them and
  /// there are several; all zero: not known. An answer to this Address leaves from there: the peer takes it
  /// from nobody else.
  std::array<std::uint8_t, 16> here{};
  /// The encrypted channel that the peer came through, where that knows it wherever it is; 0: none. An answer
  /// to this Address goes to where the channel's peer is by then.
  std::uint64_t channel = 0;
  friend bool operator==(const Address& a, const Address& b) noexcept {
    return a.port == b.port && a.ip == b.ip;
  }
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
