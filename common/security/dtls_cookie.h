#pragma once

// Only for the files of this folder.

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "telenano/common/net/datagram.h"

namespace telenano::security {

/// What a stranger must send back before anything is kept for it: an HMAC-SHA-256, under a secret of this
/// start, of its address, its port and the number of the present 30 s.
class CookieMaker {
 public:
  using Cookie = std::array<std::uint8_t, 32>;

  /// Throws RunError if there are no random numbers.
  CookieMaker();

  /// None if OpenSSL has no memory.
  std::optional<Cookie> make(const net::Address& address, std::int64_t now_ns) const noexcept;
  /// Is this the cookie of the present 30 s, or of those before? Compared in constant time, so that a guess is
  /// not told how much of it fits.
  bool fits(std::span<const std::uint8_t> shown, const net::Address& address,
            std::int64_t now_ns) const noexcept;

 private:
  std::optional<Cookie> of_slot(const net::Address& address, std::int64_t slot) const noexcept;

  std::array<std::uint8_t, 32> secret_{};
};

}  // namespace telenano::security
