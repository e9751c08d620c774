#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

namespace telenano::link {

// Numbers as they stand on the wire: the low byte first.

inline void put(std::uint8_t*& at, std::uint64_t bits, int bytes) noexcept {
  for (int i = 0; i < bytes; ++i) *at++ = static_cast<std::uint8_t>(bits >> (8 * i));
}
inline void put(std::uint8_t*& at, double value) noexcept {
  put(at, std::bit_cast<std::uint64_t>(value), 8);
}
inline std::uint64_t take(const std::uint8_t*& at, int bytes) noexcept {
  std::uint64_t bits = 0;
  for (int i = 0; i < bytes; ++i) bits |= std::uint64_t{*at++} << (8 * i);
  return bits;
}
inline double take(const std::uint8_t*& at) noexcept {
  return std::bit_cast<double>(take(at, 8));
}

/// Of a field of bytes, at most 16383 of them: seven bits a byte, the low ones first.
inline void put_length(std::uint8_t*& at, std::size_t length) noexcept {
  put(at, length < 0x80 ? length : (length & 0x7fu) | 0x80u, 1);
  if (length >= 0x80) put(at, length >> 7, 1);
}
/// Bytes that put_length() takes.
constexpr std::size_t length_bytes(std::size_t length) noexcept {
  return length < 0x80 ? 1 : 2;
}

}  // namespace telenano::link
