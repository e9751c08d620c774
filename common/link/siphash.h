#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace telenano::link {

/// 128 secret bits as two little-endian words.
struct SipKey {
  std::uint64_t k0 = 0;
  std::uint64_t k1 = 0;
};

/// SipHash-2-4 (Aumasson & Bernstein, "SipHash: a fast short-input PRF", 2012): a keyed hash that cannot be
/// guessed without the key; enough for cookies and tokens on a path that may be listened to but not written
/// to.
std::uint64_t siphash(const SipKey& key, std::span<const std::uint8_t> bytes) noexcept;
std::uint64_t siphash_words(const SipKey& key, std::span<const std::uint64_t> words) noexcept;

}  // namespace telenano::link
