#pragma once

#include <cstddef>
#include <cstdint>

#include "common/link/messages.h"
#include "common/link/session_table.h"
#include "common/link/siphash.h"
#include "common/link/token_bucket.h"

namespace telenano::link {

struct ServerHandshakeConfig {
  SipKey secret;                                ///< 128 fresh random bits at each start of the server
  std::uint64_t feature_bits = kKnownFeatures;  ///< granted to a station that asks for them
  std::uint64_t required_bits = 0;              ///< of these: a station without them is refused as too old
  std::uint32_t rate_max_hz = 8000;
  double challenges_per_s = 20000;  ///< answers to peers that have not proven their address
  double openings_per_s = 64;       ///< new sessions: each may cost the making of a slave
};

/// What to do with a Hello. kOpen, kResume: the table has the session; kAgain: the same Welcome once more.
struct HelloVerdict {
  enum class Kind : std::uint8_t { kDrop, kChallenge, kRefuse, kOpen, kResume, kAgain };
  Kind kind = Kind::kDrop;
  DropCause cause = DropCause::kNone;  ///< of kDrop, and of a kChallenge or kRefuse that counts as a drop
  std::size_t slot = SessionTable::kNone;
  Challenge challenge;
  Refuse refuse;
};

/// The server's side of Hello → Challenge → Hello → Welcome. Nothing is kept for a peer before it has shown,
/// by returning a cookie, that it receives at its address: cookie = SipHash-2-4(secret; address, nonce, 30 s
/// slot), the present and the last slot accepted. `address_proven`: a secure channel has done that already,
/// and the first Hello is answered by a Welcome.
class ServerHandshake {
 public:
  explicit ServerHandshake(const ServerHandshakeConfig& config) noexcept;

  /// `owner`: identity of the channel's key (net::Standing); a token resumes only its owner's session.
  HelloVerdict on_hello(const Hello& hello, const PeerKey& peer, std::int64_t now_ns, SessionTable& table,
                        bool shutting_down = false, bool address_proven = false,
                        std::uint64_t owner = 0) noexcept;
  /// May an answer be sent now to somebody who has not proven an address?
  bool may_answer(std::int64_t now_ns) noexcept { return challenges_.take(now_ns); }

  std::uint64_t cookie(const PeerKey& peer, std::uint64_t nonce, std::int64_t time_slot) const noexcept;
  static constexpr std::int64_t kCookieSlotNs = 30'000'000'000;

 private:
  ServerHandshakeConfig config_;
  SipKey cookie_key_;
  TokenBucket challenges_;
  TokenBucket openings_;
};

}  // namespace telenano::link
