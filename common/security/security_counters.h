#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace telenano::security {

/// What a server's secure end has seen. Each datagram that is not used counts under one of the causes.
enum class SecurityEvent : std::uint8_t {
  kOpened,              ///< sealed datagrams opened
  kCookies,             ///< answers to strangers: a cookie, nothing kept
  kHandshakesDone,      ///< associations made
  kHandshakesFailed,    ///< given up: by either side, or too slow (a wrong key looks like that)
  kUnknownKey,          ///< of those failed: the identity is not in the list
  kRefusedCertificate,  ///< of those failed: expired, signed by nobody known, or not in the list
  kRevoked,             ///< associations ended because their key is no longer in the list
  kIdle,                ///< associations ended by silence
  kClosed,              ///< ended by the peer
  kMoved,               ///< associations whose station has come to another address
  // Causes of dropping:
  kNotDtls,      ///< plain or random bytes
  kOversize,     ///< longer than any datagram may be
  kNoHandshake,  ///< sealed, or part of a handshake, from an address with which there is none
  kForged,       ///< seal does not fit; or repeated, or too old
  kRateLimited,  ///< more than a stranger, a handshake or a session may send
  kFull,         ///< no room for one more association
  kCount
};

inline constexpr std::size_t kSecurityEvents = static_cast<std::size_t>(SecurityEvent::kCount);

constexpr const char* name(SecurityEvent event) noexcept {
  constexpr std::array<const char*, kSecurityEvents> kNames = {"opened",       "cookies",
                                                               "handshakes",   "failed handshakes",
                                                               "unknown keys", "refused certificates",
                                                               "revoked",      "idle",
                                                               "closed",       "moved",
                                                               "not DTLS",     "oversize",
                                                               "no handshake", "forged",
                                                               "rate limited", "full"};
  return kNames[static_cast<std::size_t>(event)];
}

/// One thread counts, others may read.
class SecurityCounters {
 public:
  void add(SecurityEvent event) noexcept {
    auto& count = count_[static_cast<std::size_t>(event)];
    count.store(count.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  void add(const SecurityCounters& more) noexcept {
    for (std::size_t i = 0; i < kSecurityEvents; ++i)
      count_[i].fetch_add(more.count_[i].load(std::memory_order_relaxed), std::memory_order_relaxed);
  }
  std::uint64_t operator[](SecurityEvent event) const noexcept {
    return count_[static_cast<std::size_t>(event)].load(std::memory_order_relaxed);
  }
  /// Datagrams that were not used, whatever the cause.
  std::uint64_t dropped() const noexcept {
    std::uint64_t sum = 0;
    for (auto i = static_cast<std::size_t>(SecurityEvent::kNotDtls); i < kSecurityEvents; ++i)
      sum += count_[i].load(std::memory_order_relaxed);
    return sum;
  }

 private:
  std::array<std::atomic<std::uint64_t>, kSecurityEvents> count_{};
};

}  // namespace telenano::security
