#include "telenano/nve_server/server/server.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/server/guarded_step.h"
#include "telenano/nve_server/server/peer_key.h"
#include "telenano/nve_server/server/session_features.h"

namespace telenano::server {

using link::DropCause;

namespace {

/// A slave that has not moved for so long on its way up has arrived: it may have a rate of its own.
constexpr std::int64_t kRestNs = 50'000'000;

constexpr std::int64_t kFreezeEveryNs = 100'000'000;
/// Openings at once; the sessions that run wait for so long at most.
constexpr std::int64_t kOpeningBurstNs = 10'000'000;
constexpr std::size_t kPartyOpenings = 1024;
/// What took longer was rather the machine that had put the loop aside: nobody is to pay for seconds of that.
constexpr std::int64_t kOpeningMostNs = 100'000'000;
/// Pieces of the scene that a session may have at once.
constexpr double kSceneBurst = 64;

/// Who moved a shared tip last is no longer known: nobody who comes.
constexpr std::size_t kForgotten = SIZE_MAX - 1;

/// What was computed is true until the tip moves: it has no age. What was measured has grown older since.
std::uint64_t age_of_force_ns(const slave::SlaveOutput& output, std::int64_t since_step_ns) noexcept {
  if (output.measurement_age_ns == slave::kNeverMeasuredNs) return link::kNeverMeasuredNs;
  if (output.measurement_age_ns <= 0) return 0;
  return static_cast<std::uint64_t>(output.measurement_age_ns + std::max<std::int64_t>(since_step_ns, 0));
}

/// A name that fills its place has no zero at its end.
std::string text_of(const link::SceneName& name) {
  return {name.text.begin(), std::find(name.text.begin(), name.text.end(), '\0')};
}

std::unique_ptr<slave::Slave> first_slave(const ServedScene& scene) {
  auto slave = scene.make_slave ? scene.make_slave() : nullptr;
  if (!slave) throw RunError("the scene '" + text_of(scene.name) + "' made no slave");
  return slave;
}

/// A station knows a scene by its hash, a person by its name.
void require_apart(const std::vector<ServedScene>& scenes) {
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (scenes[i].hash != scenes[k].hash && !(scenes[i].name == scenes[k].name)) continue;
      throw UserError("the scene '" + text_of(scenes[i].name) +
                      "' is served twice: give each --scene once, and each file a name of its own");
    }
  }
}

bool has_well(const slave::SlaveLimits& limits) noexcept {
  return limits.well_aj > 0 && std::isfinite(limits.well_aj);
}

/// The n-th session that this worker opens; no other worker's has the same number.
std::uint64_t opening_number(std::uint64_t n, const ServerConfig& config) noexcept {
  if (config.mail == nullptr) return n;
  return (n - 1) * config.mail->workers() + config.worker + 1;
}

link::SessionTableConfig table_of(const ServerConfig& config) noexcept {
  link::SessionTableConfig table = config.table;
  if (config.mail != nullptr) {
    table.shard = static_cast<std::uint32_t>(config.worker);
    table.shards = static_cast<std::uint32_t>(config.mail->workers());
  }
  return table;
}

/// Sharing is offered where there is something to share, and asked for there; a particle and a well where
/// there is one.
std::uint64_t features_of(const ServerConfig& config, const slave::SlaveLimits& limits, bool knows_state,
                          const ServedScene& scene, std::size_t scenes) {
  std::uint64_t bits = config.feature_bits & ~std::uint64_t{link::kFeatureSharing};
  if (config.share == Share::kOneTip) bits |= link::kFeatureSharing;
  if (!limits.has_particle) bits &= ~std::uint64_t{link::kFeatureParticle};
  if (!scene.to_fetch) bits &= ~std::uint64_t{link::kFeatureScene};
  if (!limits.keeps_marks) bits &= ~std::uint64_t{link::kFeatureUndo};
  if (!has_well(limits)) bits &= ~std::uint64_t{link::kFeatureWell};
  if (scenes < 2) bits &= ~std::uint64_t{link::kFeatureSceneSwitch};
  // A log of steps asks for a slave whose state they make.
  constexpr std::uint64_t kLogs = link::kFeatureStepLog | link::kFeatureSharedLog;
  if (!knows_state) bits &= ~kLogs;
  if (config.share != Share::kOneTip) bits &= ~std::uint64_t{link::kFeatureSharedLog};
  return bits;
}

link::ServerHandshakeConfig handshake_config(const ServerConfig& config, std::uint64_t feature_bits,
                                             std::uint32_t rate_max_hz) {
  link::ServerHandshakeConfig handshake;
  handshake.secret = config.secret;
  handshake.feature_bits = feature_bits;
  if (config.share == Share::kOneTip) handshake.required_bits = link::kFeatureSharing;
  handshake.rate_max_hz = rate_max_hz;
  handshake.challenges_per_s = config.challenges_per_s;
  handshake.openings_per_s = config.openings_per_s;
  handshake.openings_per_party_s = std::min(config.openings_per_party_s, config.openings_per_s);
  return handshake;
}

}  // namespace

link::SceneName scene_name(const std::string& text) noexcept {
  link::SceneName name;
  std::copy_n(text.begin(), std::min(text.size(), link::kSceneNameBytes), name.text.begin());
  return name;
}

std::vector<Server::Offered> Server::offered(const ServerConfig& config, std::vector<ServedScene> scenes) {
  if (scenes.empty()) throw UserError("a server needs a scene");
  if (scenes.size() > 1 && config.share == Share::kOneTip)
    throw UserError(
        "several scenes need a tip for each session: leave out --share one-tip, or serve one scene");
  if (scenes.size() > 1 && config.checkpoints != nullptr)
    throw UserError("--checkpoint: keeps sessions of one scene; serve one scene, or leave it out");
  require_apart(scenes);
  std::vector<Offered> all;
  for (ServedScene& scene : scenes) {
    Offered one;
    one.spare = first_slave(scene);
    one.limits = one.spare->limits();
    one.feature_bits = features_of(config, one.limits, one.spare->state_hash() != 0, scene, scenes.size());
    one.scene = std::move(scene);
    all.push_back(std::move(one));
  }
  return all;
}

namespace {
std::vector<ServedScene> only(ServedScene scene) {
  std::vector<ServedScene> one;
  one.push_back(std::move(scene));
  return one;
}
}  // namespace

Server::Server(const ServerConfig& config, ServedScene scene) : Server(config, only(std::move(scene))) {}

Server::Server(const ServerConfig& config, std::vector<ServedScene> scenes)
    : config_(config),
      scenes_(offered(config, std::move(scenes))),
      table_(table_of(config), config.secret),
      handshake_(handshake_config(config, scenes_[0].feature_bits, scenes_[0].limits.rate_max_hz)),
      tips_(config.share == Share::kOneTip ? 1 : table_.capacity()),
      records_(table_.capacity()),
      parties_(config.work.enforced ? table_.capacity() + 1 : 0),
      is_behind_(table_.capacity(), 0),
      holder_(table_.capacity()),
      search_(config.mail, config.worker),
      load_(config.load_most),
      openings_(config.openings_share, kOpeningBurstNs),
      party_openings_(kPartyOpenings, {config.openings_share *
                                           std::min(1.0, config.openings_per_party_s / config.openings_per_s),
                                       kOpeningBurstNs}),
      scene_chunks_(config.scene_chunks_all_per_s, kSceneBurst) {
  behind_.reserve(table_.capacity());
  if (shared()) {
    if (search_.has_others()) throw UserError("--share one-tip works with one worker: leave --workers at 1");
    make_tip(0, 0, 0);
    return;
  }
  for (const Offered& one : scenes_) {
    if (!one.scene.one_tip_only) continue;
    throw UserError(
        "the scene '" + text_of(one.scene.name) +
        "' has only one tip: it cannot be private to each session; serve it with --share one-tip");
  }
}

std::size_t Server::drop(DropCause cause) noexcept {
  drops_.add(cause);
  return 0;
}

std::size_t Server::on_datagram(std::span<const std::uint8_t> bytes, const net::Address& from,
                                std::int64_t now_ns, std::span<std::uint8_t> out, const rt::Clock* clock,
                                const net::Standing& standing, bool superseded) noexcept {
  ++counters_.datagrams;
  const DropCause cause = codec_.decode(bytes, incoming_);
  if (cause != DropCause::kNone) return drop(cause);
  standing_ = standing;
  now_ns_ = now_ns;
  clock_ = clock;
  superseded_ = superseded;
  switch (incoming_.type) {
    case link::MessageType::kCommand:
      return on_command(incoming_.command, from, now_ns, out, clock);
    case link::MessageType::kHello:
      return on_hello(incoming_.hello, from, now_ns, out, standing_);
    case link::MessageType::kSnapshotRequest:
      return on_snapshot_request(incoming_.snapshot_request, from, now_ns, out);
    case link::MessageType::kSceneRequest:
      return on_scene_request(incoming_.scene_request, from, now_ns, out);
    case link::MessageType::kSceneListRequest:
      return on_scene_list_request(incoming_.scene_list_request, from, now_ns, out);
    case link::MessageType::kSceneSwitch:
      return on_scene_switch(incoming_.scene_switch, from, now_ns, out);
    case link::MessageType::kBye:
      on_bye(incoming_.bye, from, now_ns);
      return 0;
    default:
      return drop(DropCause::kUnknownType);  // only a server may send these
  }
}

bool Server::make_tip(std::size_t slot, std::size_t scene, std::int64_t now_ns) noexcept {
  Tip& tip = tips_[slot];
  tip = {};
  Offered& of = scenes_[scene];
  if (of.spare) {
    tip.slave = std::move(of.spare);
  } else {
    try {
      tip.slave = of.scene.make_slave();
    } catch (...) {  // out of memory, or a scene file that has vanished: no session, but those that run go on
      tip.slave = nullptr;
    }
  }
  if (!tip.slave) return false;
  tip.output.tip_pos_w_nm = tip.output.commanded_pos_w_nm = tip.slave->limits().start_pos_w_nm;
  tip.last_target_w_nm = tip.slave->limits().start_pos_w_nm;
  tip.last_step_ns = now_ns;
  // Nothing has been read before the first step.
  if (tip.slave->limits().measures) tip.output.measurement_age_ns = slave::kNeverMeasuredNs;
  return true;
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

/// Only its own station's commands count. One that is beyond is as lost as by the network.
bool Server::within_rate(std::size_t slot, const net::Address& from, std::int64_t now_ns) noexcept {
  if (config_.rate_slack <= 0 || slot == link::SessionTable::kNone) return true;
  const link::Session& session = table_[slot];
  const bool own = link::is_same_peer(session.peer, peer_key(from)) && session.owner == standing_.identity;
  return !own || records_[slot].commands.take(now_ns);
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
  return party_openings_[party_of(from, standing.identity) % kPartyOpenings];
}

/// For a slave that was made since then.
void Server::charge_opening(OpeningBudget& party, std::int64_t begin_ns) noexcept {
  const std::int64_t taken_ns = clock_ != nullptr ? std::min(clock_->now_ns() - begin_ns, kOpeningMostNs) : 0;
  openings_.charge(taken_ns);
  party.charge(taken_ns);
}

std::size_t Server::on_hello(const link::Hello& hello, const net::Address& from, std::int64_t now_ns,
                             std::span<std::uint8_t> out, const net::Standing& standing,
                             bool others) noexcept {
  using Kind = link::HelloVerdict::Kind;
  link::HelloContext context;
  context.shutting_down = shutting_down_;
  context.draining = draining_;
  OpeningBudget& party = party_opening(from, standing);
  context.has_time = config_.load_most <= 0 || load_.admits(active_hz(), hello.rate_hz);
  context.may_open = openings_.allows(now_ns) && party.allows(now_ns);
  context.address_proven = standing.address_proven;
  context.owner = standing.identity;
  context.rank = static_cast<std::uint8_t>(standing.rights);
  context.others = others && search_.has_others();
  if (config_.cap != nullptr) {
    context.of = this;
    context.take_place = [](void* of) noexcept {
      auto& self = *static_cast<Server*>(of);
      const bool taken = self.config_.cap->take();
      self.cap_held_ += taken ? 1 : 0;
      return taken;
    };
  }
  link::HelloVerdict verdict = handshake_.on_hello(hello, peer_key(from), now_ns, table_, context);
  if (verdict.kind == Kind::kAskOthers) {
    verdict.kind = Kind::kDrop;
    verdict.cause = search_.ask(hello, from, standing, now_ns);
  }
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
  settle_cap();
  if (verdict.cause != DropCause::kNone) drops_.add(verdict.cause);
  switch (verdict.kind) {
    case Kind::kDrop:
    case Kind::kAskOthers:
      return 0;
    case Kind::kChallenge:
      return codec_.encode(verdict.challenge, out);
    case Kind::kRefuse:
      audit_refusal(verdict.refuse.reason, from, standing, now_ns);
      return codec_.encode(verdict.refuse, out);
    case Kind::kOpen:
      holder_.begin_session(verdict.slot);
      records_[verdict.slot].opening = opening_number(++counters_.opened, config_);
      begin_log(verdict.slot);
      break;
    case Kind::kResume:
      records_[verdict.slot].control.begin_session();
      table_[verdict.slot].feature_bits = link::ServerHandshake::granted(table_[verdict.slot].wanted_bits,
                                                                         scene_of(verdict.slot).feature_bits);
      holder_.resume_session(verdict.slot);
      begin_log(verdict.slot);
      // What its log still holds was anchored before it takes up its position anew.
      if (shared() && holder_.holds(verdict.slot) && logs_steps(table_[verdict.slot])) {
        holder_.renew();
        begin_holding(verdict.slot);
      }
      ++counters_.resumed;
      break;
    case Kind::kAgain:
      break;
  }
  records_[verdict.slot].address = from;
  records_[verdict.slot].identity = standing.identity;
  records_[verdict.slot].rights = standing.rights;
  records_[verdict.slot].open = true;
  records_[verdict.slot].restored = false;
  if (verdict.kind != Kind::kAgain)
    audit(verdict.kind == Kind::kOpen ? AuditEvent::Kind::kOpened : AuditEvent::Kind::kResumed, verdict.slot,
          now_ns);
  if (verdict.kind != Kind::kAgain) begin_rate(verdict.slot);
  if (verdict.kind != Kind::kAgain) {
    records_[verdict.slot].snapshot_pieces = link::TokenBucket(config_.snapshot_pieces_per_s, kSceneBurst);
    records_[verdict.slot].scene_chunks = link::TokenBucket(config_.scene_chunks_per_s, kSceneBurst);
  }
  return welcome(verdict.slot, hello.nonce, out);
}

/// A station that talks to a session which is gone, asleep or shutting down is told, so that it need not wait
/// for its own time-out.
std::size_t Server::on_unusable_command(const link::Command& command, DropCause cause, std::size_t slot,
                                        std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  drops_.add(cause);
  link::ByeReason reason = link::ByeReason::kUnknownSession;
  if (cause == DropCause::kUnexpected && table_[slot].state == link::SlotState::kSilent) {
    reason = link::ByeReason::kIdle;
  } else if (cause == DropCause::kUnexpected && shutting_down_) {
    reason = link::ByeReason::kShuttingDown;
  } else if (cause != DropCause::kUnknownSession) {
    return 0;
  }
  if (command.session_id == 0 || !handshake_.may_answer(now_ns)) return 0;
  return codec_.encode(link::Bye{command.session_id, reason}, out);
}

std::size_t Server::on_command(const link::Command& command, const net::Address& from, std::int64_t now_ns,
                               std::span<std::uint8_t> out, const rt::Clock* clock) noexcept {
  std::size_t slot = link::SessionTable::kNone;
  const std::size_t of = table_.find(command.session_id);
  if (!within_rate(of, from, now_ns)) return drop(DropCause::kRateLimited);
  const bool logs = of != link::SessionTable::kNone && logs_steps(table_[of]);
  if (!logs && (incoming_.steps.count > 0 || command.control.method == link::kMethodTwin) &&
      of != link::SessionTable::kNone)
    return drop(DropCause::kUnexpected);
  const DropCause cause =
      table_.accept(command, peer_key(from), now_ns, slot, incoming_.recent.count > 0, standing_.identity);
  if (cause != DropCause::kNone) return on_unusable_command(command, cause, slot, now_ns, out);

  link::Session& session = table_[slot];
  SessionRecord& record = records_[slot];
  note_address(slot, from, now_ns);
  const Tip& tip = tip_of(slot);
  const bool controls = (session.feature_bits & link::kFeaturePortControl) != 0;
  if (shared()) share_tip(slot, command, now_ns);
  const bool moves = !shared() || holder_.holds(slot);
  if (logs_steps(session)) {
    move_by_log(slot, command, now_ns);
  } else if (moves) {
    move_tip(slot, command, incoming_.recent, now_ns);
  } else if (controls) {
    record.control.observe(command.control);
  }

  const std::uint32_t undo_faults = undo(slot, command);

  link::Reply reply;
  reply.session_id = session.session_id;
  reply.command_sequence = command.sequence;
  reply.command_send_time_ns = command.send_time_ns;
  reply.epoch = session.epoch;
  reply.contact_state = tip.output.contact_state;
  reply.fault_bits = tip.output.fault_bits | undo_faults;
  reply.force_w_nn = tip.output.force_w_nn;
  reply.tip_pos_w_nm = tip.output.tip_pos_w_nm;
  reply.deflection_nm = tip.output.deflection_nm;
  reply.energy_in_aj = shared() ? record.account.in_aj() : tip.output.energy_in_aj;
  reply.energy_out_aj = shared() ? record.account.out_aj() : tip.output.energy_out_aj;
  if (controls) reply.port = record.control.answer();
  if (moves && wants_model(session, command)) reply.model = tip.output.model;
  if ((session.feature_bits & link::kFeatureStepHistory) != 0) reply.steps_before = session.steps_before;
  if ((session.feature_bits & link::kFeatureParticle) != 0) reply.particle = tip.output.particle;
  if (logs_steps(session)) reply.steps = step_report(slot);
  if (shared()) reply.tip = {moves ? holder_.number() : 0, tip.output.commanded_pos_w_nm};
  const std::int64_t sent_ns = clock != nullptr ? std::max(clock->now_ns(), now_ns) : now_ns;
  reply.server_time_ns = static_cast<std::uint64_t>(sent_ns);
  reply.hold_time_ns = static_cast<std::uint64_t>(sent_ns - now_ns);
  reply.measurement_age_ns = age_of_force_ns(tip.output, moves ? 0 : sent_ns - tip.last_step_ns);
  if (clock != nullptr) service_.add(sent_ns - now_ns);
  ++counters_.exchanges;
  if ((session.feature_bits & link::kFeatureReplyDeadband) != 0) {
    if (!record.replies.wants(reply, command, session.spacing_s)) {
      ++counters_.left_out;
      return 0;
    }
    reply.replies_left_out = record.replies.left_out();
  }
  reply.sequence = ++session.reply_sequence;
  session.peer_stats.on_reply(reply.sequence, sent_ns);
  return codec_.encode(reply, out);
}

/// Where the station of this session is now.
void Server::note_address(std::size_t slot, const net::Address& from, std::int64_t now_ns) noexcept {
  const bool elsewhere = !(records_[slot].address == from);
  records_[slot].address = from;
  if (elsewhere) audit(AuditEvent::Kind::kMoved, slot, now_ns);
}

/// A piece of the slave's state. Another number than the last freezes it anew, not more often than
/// kFreezeEveryNs: where marks stay that looks at every node of the surface.
std::size_t Server::on_snapshot_request(const link::SnapshotRequest& request, const net::Address& from,
                                        std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  const std::size_t slot = table_.find(request.session_id);
  const DropCause cause = why_not_own(slot, from, link::kFeatureStepLog);
  if (cause != DropCause::kNone) return drop(cause);
  if (!records_[slot].snapshot_pieces.take(now_ns)) return drop(DropCause::kRateLimited);
  link::FrozenState& frozen = records_[slot].frozen;
  if (request.snapshot != frozen.id) {
    if (frozen.id != 0 && now_ns - frozen.at_ns < kFreezeEveryNs) return drop(DropCause::kRateLimited);
    const link::StepReport report = step_report(slot);
    frozen.id = request.snapshot;
    frozen.step = report.executed;
    frozen.state_hash = report.state_hash;
    frozen.breaks = report.breaks;
    frozen.at_ns = now_ns;
    frozen.size = tip_of(slot).slave->save(frozen.bytes);
  }
  link::SnapshotPiece piece;
  if (!frozen.piece(request.piece, piece)) return drop(DropCause::kOutOfRange);
  piece.session_id = request.session_id;
  return codec_.encode(piece, out);
}

/// Nothing is kept but how much was sent: what is asked for again is sent again, within the same bounds.
std::size_t Server::on_scene_request(const link::SceneRequest& request, const net::Address& from,
                                     std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  const std::size_t slot = table_.find(request.session_id);
  const DropCause cause = why_not_own(slot, from, link::kFeatureScene);
  if (cause != DropCause::kNone) return drop(cause);
  const SceneToFetch& scene = *scene_of(slot).scene.to_fetch;
  const std::size_t size = scene.offer.chunk_bytes(request.chunk);
  if (request.bundle != scene.offer.name() || size == 0) return drop(DropCause::kOutOfRange);
  if (!records_[slot].scene_chunks.take(now_ns) || !scene_chunks_.take(now_ns))
    return drop(DropCause::kRateLimited);
  link::SceneChunk& chunk = chunk_;
  chunk.session_id = request.session_id;
  chunk.bundle = request.bundle;
  chunk.chunk = request.chunk;
  chunk.size = static_cast<std::uint32_t>(size);
  std::memcpy(chunk.data.data(), scene.bytes.data() + std::size_t{request.chunk} * link::kSceneChunkBytes,
              size);
  ++counters_.scene_chunks;
  return codec_.encode(chunk, out);
}

void Server::on_bye(const link::Bye& bye, const net::Address& from, std::int64_t now_ns) noexcept {
  const std::size_t slot = table_.find(bye.session_id);
  if (slot == link::SessionTable::kNone) {
    drops_.add(DropCause::kUnknownSession);
  } else if (!link::is_same_peer(table_[slot].peer, peer_key(from)) ||
             table_[slot].owner != standing_.identity) {
    drops_.add(DropCause::kUnauthenticated);
  } else if (table_[slot].state == link::SlotState::kEnding) {
    drops_.add(DropCause::kDuplicate);  // Byes are sent more than once
  } else {
    end(slot, bye.reason, now_ns);
    ++counters_.ended;
  }
}

void Server::end(std::size_t slot, link::ByeReason reason, std::int64_t now_ns) noexcept {
  leave_tip(slot, now_ns);
  audit(AuditEvent::Kind::kEnded, slot, now_ns, static_cast<std::uint32_t>(reason));
  records_[slot].open = false;
  end_checkpoints(records_[slot]);
  table_.end(slot, now_ns);
  settle_cap();
}

void Server::leave_tip(std::size_t slot, std::int64_t now_ns) noexcept {
  const std::size_t before = holder_.holder();
  holder_.leave(slot, now_ns);
  audit_holder(before, now_ns);
}

/// Nothing is left of the session in this slot.
void Server::forget(std::size_t slot, std::int64_t now_ns) noexcept {
  leave_tip(slot, now_ns);
  if (records_[slot].open) audit(AuditEvent::Kind::kForgotten, slot, now_ns);
  end_checkpoints(records_[slot]);
  records_[slot] = {};
  if (!shared()) {
    tips_[slot] = {};
  } else if (tips_[0].moved_by == slot) {
    tips_[0].moved_by = kForgotten;
  }
}

void Server::retract(Tip& tip, PortControl* control, std::int64_t now_ns) noexcept {
  slave::SlaveInput input;
  input.follow = false;
  input.retract = true;
  if (config_.work.enforced) input.work_most = static_cast<std::uint32_t>(config_.work.a_datagram);
  input.tip_target_pos_w_nm = tip.output.commanded_pos_w_nm;
  const double dt_s =
      std::clamp(1e-9 * static_cast<double>(now_ns - tip.last_step_ns), kStepMinS, config_.step_max_s);
  const slave::SlaveOutput last = tip.output;
  step_guarded(*tip.slave, input, dt_s, last, tip.output);
  if (control != nullptr) control->after(last, tip.output, dt_s);
  tip.last_step_ns = now_ns;
  const bool stuck = (tip.output.fault_bits & link::kFaultNoEquilibrium) != 0;
  if (stuck || tip.output.commanded_pos_w_nm != last.commanded_pos_w_nm) tip.moved_ns = now_ns;
  tip.at_rest = now_ns - tip.moved_ns >= kRestNs;
}

void Server::poll(std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  table_.expire(now_ns, [&](std::size_t slot, link::SlotState state) {
    leave_tip(slot, now_ns);
    if (state == link::SlotState::kSilent) {
      ++counters_.timed_out;
      audit(AuditEvent::Kind::kTimedOut, slot, now_ns);
      if (!shared()) tips_[slot].last_step_ns = now_ns;
      if (records_[slot].steps.enabled()) records_[slot].steps.declare_break(link::kBreakSilence);
    }
    if (state == link::SlotState::kFree) forget(slot, now_ns);
  });
  settle_cap();
  search_.forget_old(now_ns);
  active_parties_ =
      static_cast<std::size_t>(std::count_if(parties_.begin(), parties_.end(), [&](const PartyWork& p) {
        return p.used_ns >= now_ns - kPartyActiveNs;
      }));
  for (std::size_t n = behind_.size(); n > 0 && catch_up(now_ns); --n) {
  }
  if (shared()) return withdraw_shared_tip(now_ns);
  write_checkpoints(now_ns);
  if (table_.occupied() == table_.active()) return;  // nobody leaves
  for (std::size_t slot = 0; slot < tips_.size(); ++slot) {
    const link::Session& session = table_[slot];
    const bool leaving =
        session.state == link::SlotState::kSilent || session.state == link::SlotState::kEnding;
    if (leaving && tips_[slot].slave && now_ns - session.state_since_ns <= table_.config().ending_ns) {
      retract(tips_[slot], &records_[slot].control, now_ns);
      records_[slot].changed = true;
    }
  }
}

void Server::withdraw_shared_tip(std::int64_t now_ns) noexcept {
  const bool was_withdrawing = std::exchange(
      withdrawing_, holder_.must_withdraw(now_ns, shutting_down_ ? 0 : table_.config().timeout_ns));
  if (!withdrawing_) return;
  Tip& tip = tips_[0];
  if (!was_withdrawing)
    tip.last_step_ns = tip.moved_ns = now_ns;  // not all at once what was not moved until now
  retract(tip, nullptr, now_ns);               // nobody's energy
  if (tip.at_rest) holder_.withdrawn();
}

std::size_t Server::next_bye(std::int64_t now_ns, std::span<std::uint8_t> out, net::Address& to) noexcept {
  shutting_down_ = true;
  for (std::size_t slot = 0; slot < records_.size(); ++slot) {
    if (table_[slot].state != link::SlotState::kActive) continue;
    end(slot, link::ByeReason::kShuttingDown, now_ns);
    to = records_[slot].address;
    return codec_.encode(link::Bye{table_[slot].session_id, link::ByeReason::kShuttingDown}, out);
  }
  return 0;
}

bool Server::at_rest() const noexcept {
  return std::all_of(tips_.begin(), tips_.end(), [](const Tip& tip) { return !tip.slave || tip.at_rest; });
}

}  // namespace telenano::server
