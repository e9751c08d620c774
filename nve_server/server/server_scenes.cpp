// Several scenes: which there are, and another one for a session that asks (PROTOCOL.md, section 17).
#include <algorithm>
#include <utility>

#include "telenano/nve_server/server/peer_key.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {

using link::DropCause;
using link::RefuseReason;

DropCause Server::why_not_own(std::size_t slot, const net::Address& from,
                              std::uint64_t feature) const noexcept {
  if (slot == link::SessionTable::kNone) return DropCause::kUnknownSession;
  const link::Session& session = table_[slot];
  if (!link::is_same_peer(session.peer, peer_key(from)) || session.owner != standing_.identity)
    return DropCause::kUnauthenticated;
  const bool agreed = session.state == link::SlotState::kActive && (session.feature_bits & feature) != 0;
  return agreed ? DropCause::kNone : DropCause::kUnexpected;
}

/// Nothing is kept: each line is asked for by itself, within the bounds of the scene's pieces.
std::size_t Server::on_scene_list_request(const link::SceneListRequest& request, const net::Address& from,
                                          std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  const std::size_t slot = table_.find(request.session_id);
  const DropCause cause = why_not_own(slot, from, link::kFeatureSceneSwitch);
  if (cause != DropCause::kNone) return drop(cause);
  if (request.index >= scenes_.size()) return drop(DropCause::kOutOfRange);
  if (!records_[slot].scene_chunks.take(now_ns) || !scene_chunks_.take(now_ns))
    return drop(DropCause::kRateLimited);
  const ServedScene& scene = scenes_[request.index].scene;
  link::SceneListEntry entry;
  entry.session_id = request.session_id;
  entry.index = request.index;
  entry.count = static_cast<std::uint32_t>(scenes_.size());
  entry.scene_hash = scene.hash;
  entry.scene_name = scene.name;
  return codec_.encode(entry, out);
}

/// A wish that is repeated, since its Welcome was lost, comes with an id which is over: it is known by its nonce, and
/// gets the same Welcome. What there is no time for now is left out: the station asks again.
std::size_t Server::on_scene_switch(const link::SceneSwitch& wish, const net::Address& from,
                                    std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  std::size_t slot = table_.find(wish.session_id);
  if (slot == link::SessionTable::kNone) {
    bool newest = false;
    slot = table_.find_nonce(peer_key(from), wish.nonce, newest);
    const DropCause cause = why_not_own(slot, from, link::kFeatureSceneSwitch);
    if (cause != DropCause::kNone) return drop(cause);
    if (!newest) return drop(DropCause::kDuplicate);
    if (!records_[slot].scene_chunks.take(now_ns) || !scene_chunks_.take(now_ns))
      return drop(DropCause::kRateLimited);
    return welcome(slot, wish.nonce, out);
  }
  const DropCause cause = why_not_own(slot, from, link::kFeatureSceneSwitch);
  if (cause != DropCause::kNone) return drop(cause);
  const auto refuse = [&](RefuseReason reason, DropCause why) {
    drops_.add(why);
    audit_refusal(reason, from, standing_, now_ns);
    return codec_.encode(link::Refuse{wish.nonce, reason, link::kProtocolVersion, link::kProtocolVersion},
                         out);
  };
  if (!records_[slot].scene_chunks.take(now_ns) || !scene_chunks_.take(now_ns))
    return drop(DropCause::kRateLimited);
  if (shutting_down_) return refuse(RefuseReason::kShuttingDown, DropCause::kUnexpected);
  const auto wanted = std::find_if(scenes_.begin(), scenes_.end(),
                                   [&](const Offered& one) { return one.scene.hash == wish.scene_hash; });
  if (wanted == scenes_.end()) return refuse(RefuseReason::kScene, DropCause::kOutOfRange);
  if (table_[slot].rate_hz > wanted->limits.rate_max_hz)
    return refuse(RefuseReason::kRate, DropCause::kOutOfRange);
  OpeningBudget& party = party_opening(from, standing_);
  const bool may = openings_.allows(now_ns) && party.allows(now_ns) &&
                   handshake_.take_opening(party_of(from, standing_.identity), now_ns);
  if (!may) return drop(DropCause::kRateLimited);
  const std::int64_t begin_ns = clock_ != nullptr ? clock_->now_ns() : 0;
  const bool made =
      switch_scene(slot, static_cast<std::size_t>(wanted - scenes_.begin()), wish.nonce, now_ns);
  charge_opening(party, begin_ns);
  if (!made) return refuse(RefuseReason::kScene, DropCause::kFull);
  ++counters_.switched;
  audit(AuditEvent::Kind::kSwitched, slot, now_ns);
  return welcome(slot, wish.nonce, out);
}

/// The session stays whose it is, with its token, its share of the server and its number. All that was said of the
/// other slave is over: its account, its steps, a state of it that was being fetched.
bool Server::switch_scene(std::size_t slot, std::size_t scene, std::uint64_t nonce,
                          std::int64_t now_ns) noexcept {
  Tip before = std::move(tips_[slot]);
  if (!make_tip(slot, scene, now_ns)) {
    tips_[slot] = std::move(before);
    return false;
  }
  table_.begin_anew(slot, nonce, now_ns);
  SessionRecord& record = records_[slot];
  record.scene = scene;
  table_[slot].feature_bits =
      link::ServerHandshake::granted(table_[slot].wanted_bits, scenes_[scene].feature_bits);
  record.control = {};
  record.account = {};
  record.frozen = {};
  record.steps = {};
  record.last_control = {};
  record.undo_asked = false;
  record.undo_faults = 0;
  record.behind_s = 0;
  record.command_flags = 0;
  begin_log(slot);
  return true;
}

}  // namespace telenano::server
