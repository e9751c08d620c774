#include "telenano/common/link/server_handshake.h"

#include <algorithm>
#include <array>

namespace telenano::link {

ServerHandshake::ServerHandshake(const ServerHandshakeConfig& config)
    : config_(config),
      challenges_(config.challenges_per_s, std::max(1.0, config.challenges_per_s / 10)),
      openings_(config.openings_per_s, std::max(1.0, config.openings_per_s)),
      party_openings_(kPartyBuckets,
                      {config.openings_per_party_s, std::max(1.0, config.openings_per_party_s)}) {
  const std::uint64_t labels[] = {1, 2};
  cookie_key_ = {siphash_words(config.secret, {labels, 1}), siphash_words(config.secret, {labels + 1, 1})};
}

std::uint64_t ServerHandshake::cookie(const PeerKey& peer, std::uint64_t nonce,
                                      std::int64_t time_slot) const noexcept {
  std::array<std::uint64_t, 5> words{};
  for (std::size_t i = 0; i < peer.bytes.size(); ++i) {
    words[i / 8] |= static_cast<std::uint64_t>(peer.bytes[i]) << (8 * (i % 8));
  }
  words[3] = nonce;
  words[4] = static_cast<std::uint64_t>(time_slot);
  return std::max<std::uint64_t>(siphash_words(cookie_key_, words), 1);  // 0 means "none yet"
}

std::uint64_t ServerHandshake::party_of(const PeerKey& peer, std::uint64_t owner) const noexcept {
  std::array<std::uint64_t, 4> words{6, owner};
  for (std::size_t i = 0; owner == 0 && i < 16; ++i)
    words[2 + i / 8] |= static_cast<std::uint64_t>(peer.bytes[i]) << (8 * (i % 8));
  return siphash_words(cookie_key_, words);
}

/// At a shared tip a log of steps asks for both bits: a station that knows only private ones would mix steps
/// of two holdings. With a log every reply confirms steps: none is left out.
std::uint64_t ServerHandshake::granted(std::uint64_t wanted, std::uint64_t offered) noexcept {
  std::uint64_t bits = wanted & offered;
  const bool shared = (bits & kFeatureSharing) != 0;
  if ((bits & kFeatureStepLog) == 0 || !shared) bits &= ~std::uint64_t{kFeatureSharedLog};
  if (shared && (bits & kFeatureSharedLog) == 0) bits &= ~std::uint64_t{kFeatureStepLog};
  if ((bits & kFeatureStepLog) != 0) bits &= ~std::uint64_t{kFeatureReplyDeadband};
  return bits;
}

bool ServerHandshake::take_opening(std::uint64_t party, std::int64_t now_ns) noexcept {
  return party_openings_[party % kPartyBuckets].take(now_ns) && openings_.take(now_ns);
}

HelloVerdict ServerHandshake::on_hello(const Hello& hello, const PeerKey& peer, std::int64_t now_ns,
                                       SessionTable& table, const HelloContext& context) noexcept {
  using Kind = HelloVerdict::Kind;
  HelloVerdict verdict;
  const auto refuse = [&](RefuseReason reason, DropCause cause) {
    verdict.kind = Kind::kRefuse;
    verdict.cause = cause;
    verdict.refuse = {hello.nonce, reason, kProtocolVersion, kProtocolVersion};
    return verdict;
  };
  const auto drop = [&](DropCause cause) {
    verdict.kind = Kind::kDrop;
    verdict.cause = cause;
    return verdict;
  };

  const std::int64_t time_slot = now_ns / kCookieSlotNs;
  const bool proven = context.address_proven ||
                      (hello.cookie != 0 && (hello.cookie == cookie(peer, hello.nonce, time_slot) ||
                                             hello.cookie == cookie(peer, hello.nonce, time_slot - 1)));
  // Strangers share a bounded rate of answers; it does not starve those who have shown a cookie.
  if (!proven && !challenges_.take(now_ns)) return drop(DropCause::kRateLimited);
  if (hello.version_min > kProtocolVersion || hello.version_max < kProtocolVersion) {
    return refuse(RefuseReason::kVersion, DropCause::kWrongVersion);
  }
  if (context.shutting_down) return refuse(RefuseReason::kShuttingDown, DropCause::kUnexpected);
  if (!proven) {
    verdict.kind = Kind::kChallenge;
    verdict.cause = hello.cookie == 0 ? DropCause::kNone : DropCause::kUnauthenticated;
    verdict.challenge = {hello.nonce, cookie(peer, hello.nonce, time_slot)};
    return verdict;
  }
  if (hello.rate_hz == 0 || hello.rate_hz > config_.rate_max_hz)
    return refuse(RefuseReason::kRate, DropCause::kOutOfRange);
  if ((hello.feature_bits & config_.required_bits) != config_.required_bits)
    return refuse(RefuseReason::kVersion, DropCause::kUnexpected);

  bool newest = false;
  const std::size_t known = table.find_nonce(peer, hello.nonce, newest);
  if (known != SessionTable::kNone) {
    if (!newest || table[known].state == SlotState::kEnding || table[known].owner != context.owner)
      return drop(DropCause::kDuplicate);
    if (table[known].state == SlotState::kActive) {
      verdict.kind = Kind::kAgain;
      verdict.slot = known;
      return verdict;
    }
  }
  const std::size_t old = table.find_token(hello.resume_token, context.owner);
  if (old != SessionTable::kNone) {
    table.resume(old, peer, hello.nonce, hello.rate_hz, now_ns);
    table[old].wanted_bits = hello.feature_bits;
    table[old].feature_bits = granted(hello.feature_bits, config_.feature_bits);
    table[old].rank = context.rank;
    verdict.kind = Kind::kResume;
    verdict.slot = old;
    return verdict;
  }
  // What cannot be had costs the others none of the shared rate.
  const Opener opener{context.owner, party_of(peer, context.owner), context.rank};
  if (!context.has_time || !table.has_room(opener)) return refuse(RefuseReason::kFull, DropCause::kFull);
  if (!context.may_open || !take_opening(opener.party, now_ns)) return drop(DropCause::kRateLimited);
  verdict.slot = table.open(peer, hello.nonce, hello.rate_hz, now_ns, opener);
  if (verdict.slot == SessionTable::kNone) return refuse(RefuseReason::kFull, DropCause::kFull);
  table[verdict.slot].wanted_bits = hello.feature_bits;
  table[verdict.slot].feature_bits = granted(hello.feature_bits, config_.feature_bits);
  verdict.kind = Kind::kOpen;
  return verdict;
}

}  // namespace telenano::link
