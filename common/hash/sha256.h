#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace telenano {

using Sha256 = std::array<std::uint8_t, 32>;

/// SHA-256 (FIPS 180-4) by OpenSSL: names content that comes from strangers. Throws RunError in a build
/// without OpenSSL, of which has_sha256() is false.
Sha256 sha256(std::string_view bytes);
bool has_sha256() noexcept;
/// HMAC-SHA-256 (RFC 2104) under a key of 32 bytes. Throws as sha256().
Sha256 hmac_sha256(const std::array<std::uint8_t, 32>& key, std::string_view text);

/// 64 lower-case hexadecimal digits.
std::string hex(const Sha256& hash);
/// The first eight bytes as a little-endian number: a name that is short enough for each datagram.
std::uint64_t short_name(const Sha256& hash) noexcept;

}  // namespace telenano
