#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

/// What can be read of a DTLS 1.2 datagram (RFC 6347) without a key: enough to know whom it concerns.
namespace telenano::security {

enum class RecordKind : std::uint8_t {
  kNotDtls,      ///< not whole records
  kClientHello,  ///< in the clear: the beginning of a handshake, or a repetition of it
  kHandshake,    ///< any other part of a handshake, in the clear or sealed
  kAlert,        ///< in the clear or sealed
  kData          ///< sealed application data
};

inline constexpr std::size_t kRecordHeaderBytes = 13;  // type, version 2, epoch 2, sequence 6, length 2
/// What sealing adds to a record beside its header: with AES-GCM nonce and tag, with ChaCha20-Poly1305 a tag.
inline constexpr std::size_t kAesGcmSealBytes = 8 + 16;
inline constexpr std::size_t kChaChaSealBytes = 16;
/// Larger than any datagram of a handshake, which stay below kHandshakeMtu.
inline constexpr std::size_t kMaxWireBytes = 2048;
/// Bytes of a handshake's datagrams: IPv6's smallest path of 1280, without IP and UDP headers.
inline constexpr std::size_t kHandshakeMtu = 1200;
/// Most datagrams that one call to receive() looks at: what is not for the loop behind must not keep it from its time-outs for long.
inline constexpr int kDatagramsPerReceive = 64;

/// Are these whole records, one after the other, that may be shown to OpenSSL? A sealed one that is too short
/// for its seal must not: OpenSSL 3.0.19 answers it with a fatal alert before it looks at the seal, and
/// anybody who knows two addresses could end a session with 14 bytes (3.0.22 does not, but machines differ).
constexpr bool well_formed(std::span<const std::uint8_t> bytes, std::size_t seal_bytes) noexcept {
  while (!bytes.empty()) {
    if (bytes.size() < kRecordHeaderBytes) return false;
    // ff is 1.0, which every first ClientHello names; fd is 1.2.
    if (bytes[1] != 0xfe || (bytes[2] != 0xff && bytes[2] != 0xfd)) return false;
    const std::size_t length = (std::size_t{bytes[11]} << 8) | bytes[12];
    const bool sealed = bytes[3] != 0 || bytes[4] != 0;
    if (length < (sealed ? seal_bytes : 1)) return false;
    if (bytes.size() < kRecordHeaderBytes + length) return false;
    bytes = bytes.subspan(kRecordHeaderBytes + length);
  }
  return true;
}

/// By the first record. How short a sealed one may be, its association knows (DtlsChannel); here the least.
constexpr RecordKind kind_of(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.empty() || !well_formed(bytes, kChaChaSealBytes)) return RecordKind::kNotDtls;
  const bool in_clear = bytes[3] == 0 && bytes[4] == 0;
  switch (bytes[0]) {
    case 20:  // ChangeCipherSpec
      return RecordKind::kHandshake;
    case 21:
      return RecordKind::kAlert;
    case 22:
      return in_clear && bytes[kRecordHeaderBytes] == 1 ? RecordKind::kClientHello : RecordKind::kHandshake;
    case 23:
      return in_clear ? RecordKind::kNotDtls : RecordKind::kData;
    default:
      return RecordKind::kNotDtls;
  }
}

/// Epoch and number of the first record, which its seal covers: greater is newer. `bytes`: of any kind but
/// kNotDtls.
constexpr std::uint64_t record_number(std::span<const std::uint8_t> bytes) noexcept {
  std::uint64_t number = 0;
  for (std::size_t i = 3; i < 11; ++i) number = (number << 8) | bytes[i];
  return number;
}

/// A ClientHello's random number, which stays the same when it is repeated, with or without a cookie; and
/// whether it shows a cookie. Layout: record header 13, handshake header 12, version 2, random 32, session id
/// 1 + n, cookie 1 + n.
struct ClientHelloView {
  std::array<std::uint8_t, 32> random{};
  bool has_cookie = false;
};

constexpr bool parse_client_hello(std::span<const std::uint8_t> bytes, ClientHelloView& view) noexcept {
  constexpr std::size_t kRandom = kRecordHeaderBytes + 12 + 2;
  constexpr std::size_t kSessionId = kRandom + 32;
  if (bytes.size() <= kSessionId) return false;
  const std::size_t cookie = kSessionId + 1 + bytes[kSessionId];
  if (bytes.size() <= cookie) return false;
  std::copy_n(bytes.begin() + kRandom, view.random.size(), view.random.begin());
  view.has_cookie = bytes[cookie] != 0;
  return true;
}

}  // namespace telenano::security
