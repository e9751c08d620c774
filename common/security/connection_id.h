#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

/// How a server knows an association whose station has come to another address (PROTOCOL.md 10): what the
/// station seals begins with the name that the server gave it in the handshake. RFC 9146 does this within the
/// record; OpenSSL 3.0 does not speak that. The name proves nothing: only what opens under the association's
/// keys does.
namespace telenano::security {

/// Begins a datagram that shows a connection id. No DTLS record does (those begin with 20 to 25), and no
/// datagram of the protocol itself ('T').
inline constexpr std::uint8_t kConnectionMark = 0x43;
/// TLS extension, of those for private use (RFC 8446, 11): empty in the ClientHello, the id in the
/// ServerHello.
inline constexpr unsigned kConnectionExtension = 0xff54;

/// Seven bytes on the wire after the mark: a byte that is 0, which association, and a random
/// number, so that the name of an association that is gone is not the next one's.
struct ConnectionId {
  static constexpr std::size_t kBytes = 7;
  std::uint8_t worker = 0;
  std::uint16_t slot = 0;
  std::uint32_t random = 0;

  friend bool operator==(const ConnectionId&, const ConnectionId&) = default;

  /// As one number that is never 0: net::Address::channel.
  constexpr std::uint64_t number() const noexcept {
    return (std::uint64_t{1} << 56) | (std::uint64_t{worker} << 48) | (std::uint64_t{slot} << 32) | random;
  }
  static constexpr ConnectionId of(std::uint64_t number) noexcept {
    return {static_cast<std::uint8_t>(number >> 48), static_cast<std::uint16_t>(number >> 32),
            static_cast<std::uint32_t>(number)};
  }
  constexpr std::array<std::uint8_t, kBytes> bytes() const noexcept {
    std::array<std::uint8_t, kBytes> out{};
    for (std::size_t i = 0; i < kBytes; ++i)
      out[i] = static_cast<std::uint8_t>(number() >> (8 * (kBytes - 1 - i)));
    return out;
  }
  /// `in`: kBytes or more.
  static constexpr ConnectionId read(std::span<const std::uint8_t> in) noexcept {
    std::uint64_t number = 0;
    for (std::size_t i = 0; i < kBytes; ++i) number = (number << 8) | in[i];
    return of(number);
  }
};

/// What the station writes before each record.
using ConnectionPrefix = std::array<std::uint8_t, 1 + ConnectionId::kBytes>;

/// Asks a station whether it is where its datagrams seem to come from, and is the answer: sealed, beginning
/// so; then 8 random bytes, which the answer repeats. No datagram of the protocol begins so.
inline constexpr std::array<std::uint8_t, 8> kAddressQuestion = {'T', 'L', 'N', 'A', 1, 1, 0, 0};
inline constexpr std::array<std::uint8_t, 8> kAddressAnswer = {'T', 'L', 'N', 'A', 1, 2, 0, 0};
using AddressProof = std::array<std::uint8_t, 16>;

}  // namespace telenano::security
