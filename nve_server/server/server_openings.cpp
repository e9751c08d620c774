#include <algorithm>

#include "telenano/nve_server/server/peer_key.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/server/session_features.h"

namespace telenano::server {

using link::DropCause;

namespace {

/// What took longer was rather the machine that had put the loop aside: nobody is to pay for seconds of that.
constexpr std::int64_t kOpeningMostNs = 100'000'000;

}  // namespace

/// What the handshake's rules say to it. For a new session the slave is made.
link::HelloVerdict Server::judge(const link::Hello& hello, const net::Address& from, std::int64_t now_ns,
                                 const net::Standing& standing) noexcept {
  using Kind = link::HelloVerdict::Kind;
  link::HelloContext context;
  context.shutting_down = shutting_down_;
  OpeningBudget& party = party_opening(from, standing);
  context.has_time = config_.load_most <= 0 || load_.admits(active_hz(), hello.rate_hz);
  context.may_open = openings_.allows(now_ns) && party.allows(now_ns);
  context.address_proven = standing.address_proven;
  context.owner = standing.identity;
  context.rank = static_cast<std::uint8_t>(standing.rights);
  link::HelloVerdict verdict = handshake_.on_hello(hello, peer_key(from), now_ns, table_, context);
  if (verdict.kind == Kind::kOpen) {
    const std::int64_t begin_ns = clock_ != nullptr ? clock_->now_ns() : 0;
    forget(verdict.slot, now_ns);  // a silent session may have given up its slot
    if (!shared() && !make_tip(verdict.slot, 0, now_ns)) {
      table_.release(verdict.slot);
      verdict.kind = Kind::kRefuse;
      verdict.cause = DropCause::kFull;
      verdict.refuse = {hello.nonce, link::RefuseReason::kFull, link::kProtocolVersion,
                        link::kProtocolVersion};
    }
    charge_opening(party, begin_ns);
  }
  return verdict;
}

void Server::open(std::size_t slot) noexcept {
  holder_.begin_session(slot);
  records_[slot].opening = ++counters_.opened;
  begin_log(slot);
}

void Server::resume(std::size_t slot) noexcept {
  records_[slot].control.begin_session();
  table_[slot].feature_bits =
      link::ServerHandshake::granted(table_[slot].wanted_bits, scene_of(slot).feature_bits);
  holder_.resume_session(slot);
  begin_log(slot);
  // What its log still holds was anchored before it takes up its position anew.
  if (shared() && holder_.holds(slot) && logs_steps(table_[slot])) {
    holder_.renew();
    begin_holding(slot);
  }
  ++counters_.resumed;
}

std::size_t Server::on_hello(const link::Hello& hello, const net::Address& from, std::int64_t now_ns,
                             std::span<std::uint8_t> out, const net::Standing& standing) noexcept {
  using Kind = link::HelloVerdict::Kind;
  const link::HelloVerdict verdict = judge(hello, from, now_ns, standing);
  if (verdict.cause != DropCause::kNone) drops_.add(verdict.cause);
  switch (verdict.kind) {
    case Kind::kDrop:
      return 0;
    case Kind::kChallenge:
      return codec_.encode(verdict.challenge, out);
    case Kind::kRefuse:
      audit_refusal(verdict.refuse.reason, from, standing, now_ns);
      return codec_.encode(verdict.refuse, out);
    case Kind::kOpen:
      open(verdict.slot);
      break;
    case Kind::kResume:
      resume(verdict.slot);
      break;
    case Kind::kAgain:
      break;
  }
  SessionRecord& record = records_[verdict.slot];
  record.address = from;
  record.identity = standing.identity;
  record.rights = standing.rights;
  record.open = true;
  if (verdict.kind != Kind::kAgain) {
    audit(verdict.kind == Kind::kOpen ? AuditEvent::Kind::kOpened : AuditEvent::Kind::kResumed, verdict.slot,
          now_ns);
    begin_rate(verdict.slot);
    record.snapshot_pieces = link::TokenBucket(config_.snapshot_pieces_per_s, kPiecesBurst);
    record.scene_chunks = link::TokenBucket(config_.scene_chunks_per_s, kPiecesBurst);
  }
  return welcome(verdict.slot, hello.nonce, out);
}

std::size_t Server::welcome(std::size_t slot, std::uint64_t nonce, std::span<std::uint8_t> out) noexcept {
  const link::Session& session = table_[slot];
  const Tip& tip = tip_of(slot);
  const slave::SlaveLimits& limits = tip.slave->limits();
  link::Welcome w;
  w.feature_bits = session.feature_bits;
  w.nonce = nonce;
  w.session_id = session.session_id;
  w.resume_token = session.resume_token;
  w.epoch = session.epoch;
  w.timeout_ms =
      static_cast<std::uint32_t>(std::max<std::int64_t>(table_.config().timeout_ns / 1'000'000, 1));
  w.slave_rate_max_hz = limits.rate_max_hz;
  const ServedScene& scene = scene_of(slot).scene;
  w.scene_name = scene.name;
  w.scene_hash = scene.hash;
  w.workspace_min_w_nm = limits.workspace_min_w_nm;
  w.workspace_max_w_nm = limits.workspace_max_w_nm;
  // Resuming must not be felt: go on at the command that the slave holds, with its force.
  w.start_pos_w_nm = tip.output.commanded_pos_w_nm;
  w.surface_z_w_nm = limits.surface_z_w_nm;
  w.force_max_nn = limits.force_max_nn;
  w.coupling_stiffness_n_m = limits.coupling_stiffness_n_m;
  w.coupling_damping_n_s_m = limits.coupling_damping_n_s_m;
  if ((session.feature_bits & link::kFeatureWell) != 0 && has_well(limits)) w.well_aj = limits.well_aj;
  if (logs_steps(session)) w.steps = step_report(slot);
  if ((session.feature_bits & link::kFeatureScene) != 0 && scene.to_fetch) w.scene = scene.to_fetch->offer;
  return codec_.encode(w, out);
}

/// What a stall of the network has kept back comes at once: a second of it.
void Server::begin_rate(std::size_t slot) noexcept {
  constexpr double kBurst_s = 1;
  constexpr double kBurstLeast = 64;
  const double rate_hz = table_[slot].rate_hz;
  records_[slot].commands =
      link::TokenBucket(config_.rate_slack * rate_hz, std::max(kBurstLeast, kBurst_s * rate_hz));
}

double Server::active_hz() const noexcept {
  double sum = 0;
  for (std::size_t slot = 0; slot < table_.capacity(); ++slot)
    sum += table_[slot].state == link::SlotState::kActive ? table_[slot].rate_hz : 0;
  return sum;
}

std::uint64_t Server::party_of(const net::Address& from, std::uint64_t owner) const noexcept {
  return handshake_.party_of(peer_key(from), owner);
}

OpeningBudget& Server::party_opening(const net::Address& from, const net::Standing& standing) noexcept {
  return party_openings_[party_of(from, standing.identity) % party_openings_.size()];
}

/// For a slave that was made since then.
void Server::charge_opening(OpeningBudget& party, std::int64_t begin_ns) noexcept {
  const std::int64_t taken_ns = clock_ != nullptr ? std::min(clock_->now_ns() - begin_ns, kOpeningMostNs) : 0;
  openings_.charge(taken_ns);
  party.charge(taken_ns);
}

}  // namespace telenano::server
