#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/link/messages.h"
#include "telenano/common/link/session_table.h"
#include "telenano/common/link/siphash.h"
#include "telenano/common/link/token_bucket.h"

namespace telenano::link {

struct ServerHandshakeConfig {
  SipKey secret;                                ///< 128 fresh random bits at each start of the server
  std::uint64_t feature_bits = kKnownFeatures;  ///< granted to a station that asks for them
  std::uint64_t required_bits = 0;              ///< of these: a station without them is refused as too old
  std::uint32_t rate_max_hz = 8000;
  double challenges_per_s = 20000;    ///< answers to peers that have not proven their address
  double openings_per_s = 64;         ///< new sessions: each may cost the making of a slave
  double openings_per_party_s = 1e9;  ///< of these, for one key, or in the clear for one IP address
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

/// What the server knows besides the Hello itself.
struct HelloContext {
  bool shutting_down = false;
  bool has_time = true;         ///< else a new session is refused: those that are there take all of it
  bool may_open = true;         ///< else a new session must wait; its Hello comes again
  bool address_proven = false;  ///< by a secure channel: the first Hello is answered by a Welcome
  std::uint64_t owner = 0;      ///< identity of the channel's key; a token resumes only its owner's session
  std::uint8_t rank = 0;        ///< of the right of the channel's key
};

/// The server's side of Hello → Challenge → Hello → Welcome. Nothing is kept for a peer before it has shown,
/// by returning a cookie, that it receives at its address: cookie = SipHash-2-4(secret; address, nonce, 30 s
/// slot), the present and the last slot accepted.
class ServerHandshake {
 public:
  explicit ServerHandshake(const ServerHandshakeConfig& config);

  HelloVerdict on_hello(const Hello& hello, const PeerKey& peer, std::int64_t now_ns, SessionTable& table,
                        const HelloContext& context = {}) noexcept;
  /// May an answer be sent now to somebody who has not proven an address?
  bool may_answer(std::int64_t now_ns) noexcept { return challenges_.take(now_ns); }

  std::uint64_t cookie(const PeerKey& peer, std::uint64_t nonce, std::int64_t time_slot) const noexcept;
  static constexpr std::int64_t kCookieSlotNs = 30'000'000'000;
  /// Of the features that a station wants and a server has, those that both can use together.
  static std::uint64_t granted(std::uint64_t wanted, std::uint64_t offered) noexcept;
  /// May this party have one more slave made now? If so, it counts as an opening.
  bool take_opening(std::uint64_t party, std::int64_t now_ns) noexcept;
  /// Whom a session counts for: the key, or where there is none the address without its port.
  std::uint64_t party_of(const PeerKey& peer, std::uint64_t owner) const noexcept;

 private:
  static constexpr std::size_t kPartyBuckets = 1024;

  ServerHandshakeConfig config_;
  SipKey cookie_key_;
  TokenBucket challenges_;
  TokenBucket openings_;
  std::vector<TokenBucket> party_openings_;
};

}  // namespace telenano::link
