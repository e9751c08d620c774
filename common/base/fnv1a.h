#pragma once

#include <cstdint>
#include <string_view>

namespace telenano {

/// FNV-1a, 64 bit (draft-eastlake-fnv): tells scenes apart, protects nothing.
inline std::uint64_t fnv1a(std::string_view bytes, std::uint64_t hash = 0xcbf29ce484222325u) noexcept {
  for (const char c : bytes) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3u;
  }
  return hash;
}

}  // namespace telenano
