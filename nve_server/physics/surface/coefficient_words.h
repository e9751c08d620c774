#pragma once

#include <bit>
#include <cstdint>

namespace telenano::physics {

/// The product of two words, both halves folded into one.
inline std::uint64_t folded_product(std::uint64_t a, std::uint64_t b) noexcept {
  __extension__ using Wide = unsigned __int128;
  const Wide product = static_cast<Wide>(a) * b;
  return static_cast<std::uint64_t>(product) ^ static_cast<std::uint64_t>(product >> 64);
}

/// Of H and ρ of both levels of a coefficient, or of one level. The place is in it, so that what changes places
/// counts. Odd constants of SplitMix64 and its finaliser (Steele, Lea, Flood 2014).
inline std::uint64_t word_of(std::uint64_t place, const double* value, bool two_levels) noexcept {
  const auto bits = [value](int lane) { return std::bit_cast<std::uint64_t>(value[lane]); };
  const std::uint64_t word =
      folded_product(bits(0) ^ (place + 1) * 0x9e3779b97f4a7c15u, bits(1) ^ 0xbf58476d1ce4e5b9u);
  if (!two_levels) return word;
  return folded_product(word ^ bits(3), bits(4) ^ 0x94d049bb133111ebu);
}

}  // namespace telenano::physics
