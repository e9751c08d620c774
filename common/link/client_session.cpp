#include "telenano/common/link/client_session.h"

#include <algorithm>

#include "proto/wire_fields.h"
#include "telenano/common/base/random.h"

namespace telenano::link {

const char* name(ClientState state) noexcept {
  switch (state) {
    case ClientState::kIdle:
      return "idle";
    case ClientState::kHelloSent:
      return "hello_sent";
    case ClientState::kChallenged:
      return "challenged";
    case ClientState::kEstablished:
      return "established";
    case ClientState::kLost:
      return "lost";
    case ClientState::kClosed:
      return "closed";
    case ClientState::kRefused:
      return "refused";
  }
  return "?";
}

ClientSession::ClientSession(const ClientConfig& config)
    : config_(config),
      resume_token_(config.resume_token),
      steps_(config.step_ring),
      snapshot_(config.snapshot_bytes) {
  config_.redundancy = std::min(config_.redundancy, kMaxRecent);
  if (config_.redundancy == 0) config_.feature_bits &= ~std::uint64_t{kFeatureRedundancy};
  if (config_.step_ring == 0) config_.feature_bits &= ~std::uint64_t{kFeatureStepLog | kFeatureSharedLog};
}

void ClientSession::set_state(ClientState state, std::int64_t now_ns) noexcept {
  if (state == state_) return;
  state_ = state;
  state_since_ns_ = now_ns;
}

std::uint64_t ClientSession::next_nonce() noexcept {
  std::uint64_t mix = config_.nonce_seed + nonce_counter_++ * 0xd1342543de82ef95ull;
  for (;;) {
    const std::uint64_t nonce = Random::splitmix64(mix);
    if (nonce != 0) return nonce;
  }
}

void ClientSession::new_attempt(std::int64_t now_ns) noexcept {
  nonce_ = next_nonce();
  cookie_ = 0;
  hellos_sent_ = 0;
  attempt_start_ns_ = now_ns;
  next_hello_ns_ = now_ns;
  backoff_ns_ = config_.hello_first_ns;
}

void ClientSession::start(std::int64_t now_ns) noexcept {
  session_alive_ = false;
  new_attempt(now_ns);
  set_state(ClientState::kHelloSent, now_ns);
}

void ClientSession::resume(std::int64_t now_ns) noexcept {
  new_attempt(now_ns);
  set_state(ClientState::kLost, now_ns);
}

std::int64_t ClientSession::silence_limit_ns() const noexcept {
  // A long way must not look like silence: before the first reply the handshake bounds the round trip from
  // above.
  const double explained_ns =
      stats_.samples() > 0 ? std::max(stats_.timeout_ns(), 1.5 * static_cast<double>(stats_.rtt_last_ns()))
                           : static_cast<double>(handshake_ns_);
  return std::max(config_.silence_ns, static_cast<std::int64_t>(2 * explained_ns));
}

std::size_t ClientSession::poll(std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  switch (state_) {
    case ClientState::kIdle:
    case ClientState::kClosed:
    case ClientState::kRefused:
      return 0;
    case ClientState::kEstablished:
      if (!waits_ || now_ns - waits_since_ns_ <= silence_limit_ns()) return poll_switch(now_ns, out);
      new_attempt(now_ns);
      set_state(ClientState::kLost, now_ns);
      break;
    case ClientState::kHelloSent:
    case ClientState::kChallenged:
    case ClientState::kLost:
      break;
  }
  if (now_ns < next_hello_ns_) return 0;
  Hello hello;
  hello.version_min = config_.version_min;
  hello.version_max = config_.version_max;
  hello.feature_bits = config_.feature_bits;
  hello.nonce = nonce_;
  hello.cookie = cookie_;
  hello.resume_token = resume_token_;
  hello.rate_hz = config_.rate_hz;
  ++hellos_sent_;
  next_hello_ns_ = now_ns + backoff_ns_;
  backoff_ns_ = std::min(2 * backoff_ns_, config_.hello_last_ns);
  return codec_.encode(hello, out);
}

bool ClientSession::switch_scene(std::uint64_t scene_hash, std::int64_t now_ns) noexcept {
  if (!session_alive_ || (features() & kFeatureSceneSwitch) == 0 || scene_hash == 0) return false;
  switching_ = SceneSwitching::kAsked;
  switch_nonce_ = next_nonce();
  switch_hash_ = scene_hash;
  switch_start_ns_ = next_switch_ns_ = now_ns;
  switch_backoff_ns_ = config_.hello_first_ns;
  return true;
}

/// As a Hello: again and again, slower. While the server is silent its Hello goes first.
std::size_t ClientSession::poll_switch(std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  if (switch_nonce_ == 0 || !session_alive_ || now_ns < next_switch_ns_) return 0;
  next_switch_ns_ = now_ns + std::max(switch_backoff_ns_, silence_limit_ns() / 2);
  switch_backoff_ns_ = std::min(2 * switch_backoff_ns_, config_.hello_last_ns);
  return codec_.encode(SceneSwitch{welcome_.session_id, switch_nonce_, switch_hash_}, out);
}

/// How long the server may take to say that it has executed something: a round trip, the time between two
/// commands, and what jitter adds; an idle guess before the first reply.
std::int64_t ClientSession::step_wait_ns() const noexcept {
  constexpr double kLeast_ns = 40e6;
  const double explained_ns = stats_.samples() > 0 ? stats_.timeout_ns() : static_cast<double>(handshake_ns_);
  return static_cast<std::int64_t>(explained_ns + kLeast_ns);
}

ClientEvent ClientSession::drop(DropCause cause) noexcept {
  drops_.add(cause);
  last_drop_ = cause;
  return ClientEvent::kDropped;
}

ClientEvent ClientSession::on_datagram(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept {
  overtaken_ = false;
  last_drop_ = DropCause::kNone;
  const DropCause cause = codec_.decode(bytes, incoming_);
  if (cause != DropCause::kNone) return drop(cause);
  switch (incoming_.type) {
    case MessageType::kChallenge:
      return on_challenge(incoming_.challenge, now_ns);
    case MessageType::kWelcome:
      return on_welcome(incoming_.welcome, now_ns);
    case MessageType::kRefuse:
      return on_refuse(incoming_.refuse, now_ns);
    case MessageType::kReply:
      return on_reply(incoming_.reply, now_ns);
    case MessageType::kBye:
      return on_bye(incoming_.bye, now_ns);
    case MessageType::kSnapshotPiece:
      if (!session_alive_ || !logs_steps()) return drop(DropCause::kUnexpected);
      if (incoming_.snapshot_piece.session_id != welcome_.session_id) return drop(DropCause::kUnknownSession);
      if (!snapshot_.take(incoming_.snapshot_piece)) return drop(DropCause::kStale);
      return ClientEvent::kPiece;
    case MessageType::kSceneChunk:
      return on_scene_chunk(incoming_.scene_chunk);
    case MessageType::kSceneListEntry:
      return on_scene_entry(incoming_.scene_list_entry);
    case MessageType::kHello:
    case MessageType::kCommand:
    case MessageType::kSceneListRequest:
    case MessageType::kSceneSwitch:
    case MessageType::kSceneRequest:
    case MessageType::kSnapshotRequest:
    case MessageType::kNone:
      break;
  }
  return drop(DropCause::kUnknownType);  // only a station may send these
}

ClientEvent ClientSession::on_challenge(const Challenge& challenge, std::int64_t now_ns) noexcept {
  const bool asking =
      state_ == ClientState::kHelloSent || state_ == ClientState::kChallenged || state_ == ClientState::kLost;
  if (!asking) return drop(DropCause::kUnexpected);
  if (challenge.nonce != nonce_) return drop(DropCause::kUnauthenticated);
  if (challenge.cookie == cookie_) return drop(DropCause::kDuplicate);
  if (cookie_ ==
      0) {  // answer the first at once, later ones (an expired cookie) with the back-off: no ping-pong
    next_hello_ns_ = now_ns;
    backoff_ns_ = config_.hello_first_ns;
  }
  cookie_ = challenge.cookie;
  if (state_ == ClientState::kHelloSent) set_state(ClientState::kChallenged, now_ns);
  return ClientEvent::kChallenge;
}

ClientEvent ClientSession::on_welcome(const Welcome& welcome, std::int64_t now_ns) noexcept {
  if (sessions_ > 0 && welcome.session_id == welcome_.session_id) return drop(DropCause::kDuplicate);
  const bool switches = switch_nonce_ != 0;
  const bool switched = switches && welcome.nonce == switch_nonce_;
  if ((nonce_ == 0 && !switches) || state_ == ClientState::kIdle || state_ == ClientState::kClosed ||
      state_ == ClientState::kRefused) {
    return drop(DropCause::kUnexpected);
  }
  if (!switched && (nonce_ == 0 || welcome.nonce != nonce_)) return drop(DropCause::kUnauthenticated);
  // Nobody has asked for a third scene.
  if (switched && welcome.scene_hash != switch_hash_) return drop(DropCause::kOutOfRange);
  if (welcome.version < config_.version_min || welcome.version > config_.version_max) {
    return drop(DropCause::kWrongVersion);
  }
  if ((welcome.feature_bits & ~config_.feature_bits) != 0) return drop(DropCause::kOutOfRange);
  if ((features_used(welcome) & ~welcome.feature_bits) != 0) return drop(DropCause::kUnexpected);
  snapshot_.stop();
  steps_.begin(welcome.steps.executed, sessions_ > 0 && welcome.epoch == welcome_.epoch);
  if (sessions_ > 0 && welcome.epoch != welcome_.epoch) {
    epoch_changed_ = true;
    if (!switched) stats_.reset();  // another server, perhaps: another clock
  }
  if (sessions_ == 0 || welcome.epoch != welcome_.epoch) slave_energy_.reset();
  unknown_account_ = sessions_ == 0 && resume_token_ != 0 && welcome.resume_token == resume_token_;
  count(past_);
  sent_.clear();
  welcome_ = welcome;
  ++sessions_;
  session_alive_ = true;
  resume_token_ = welcome.resume_token;
  handshake_ns_ = now_ns - (switched ? switch_start_ns_ : attempt_start_ns_);
  // Its own Welcome may have been lost: the server is there all the same.
  if (switches && welcome.scene_hash == switch_hash_) {
    switching_ = SceneSwitching::kDone;
    switch_nonce_ = 0;
  }
  nonce_ = 0;
  cookie_ = 0;
  command_sequence_ = 0;
  has_energy_base_ = false;
  has_reply_ = false;
  replies_.reset();
  waits_ = false;
  last_news_ns_ = welcome_time_ns_ = now_ns;
  set_state(ClientState::kEstablished, now_ns);
  return ClientEvent::kWelcome;
}

ClientEvent ClientSession::on_refuse(const Refuse& refuse, std::int64_t now_ns) noexcept {
  if (switch_nonce_ != 0 && refuse.nonce == switch_nonce_) {
    refuse_ = refuse;
    switching_ = SceneSwitching::kRefused;
    switch_nonce_ = 0;
    return ClientEvent::kSwitchRefused;
  }
  const bool asking =
      state_ == ClientState::kHelloSent || state_ == ClientState::kChallenged || state_ == ClientState::kLost;
  if (!asking) return drop(DropCause::kUnexpected);
  if (refuse.nonce != nonce_) return drop(DropCause::kUnauthenticated);
  refuse_ = refuse;
  const bool passing = refuse.reason == RefuseReason::kFull || refuse.reason == RefuseReason::kShuttingDown;
  if (passing && sessions_ > 0) {
    // There was a session, and a person holds the handle: keep asking, slowly.
    backoff_ns_ = config_.hello_last_ns;
    next_hello_ns_ = now_ns + backoff_ns_;
  } else {
    session_alive_ = false;
    set_state(ClientState::kRefused, now_ns);
  }
  return ClientEvent::kRefused;
}

ClientEvent ClientSession::on_bye(const Bye& bye, std::int64_t now_ns) noexcept {
  if (!session_alive_) return drop(DropCause::kUnexpected);
  if (bye.session_id != welcome_.session_id) return drop(DropCause::kUnknownSession);
  bye_reason_ = bye.reason;
  session_alive_ = false;
  if (bye.reason == ByeReason::kDone || bye.reason == ByeReason::kStopped) {
    set_state(ClientState::kClosed, now_ns);
    return ClientEvent::kBye;
  }
  if (state_ != ClientState::kLost) {
    if (nonce_ == 0) {
      new_attempt(now_ns);
    } else {
      next_hello_ns_ = now_ns;  // an attempt from before is still open: its Welcome may be on the way
    }
    if (bye.reason == ByeReason::kShuttingDown) next_hello_ns_ = now_ns + config_.hello_first_ns;
    set_state(ClientState::kLost, now_ns);
  }
  return ClientEvent::kBye;
}

ClientEvent ClientSession::on_scene_chunk(const SceneChunk& chunk) noexcept {
  if (!session_alive_) return drop(DropCause::kUnexpected);
  if (chunk.session_id != welcome_.session_id) return drop(DropCause::kUnknownSession);
  if ((features() & kFeatureScene) == 0) return drop(DropCause::kUnexpected);
  const SceneOffer& scene = welcome_.scene;
  const bool fits = chunk.bundle == scene.name() && chunk.size == scene.chunk_bytes(chunk.chunk);
  return fits && chunk.size > 0 ? ClientEvent::kSceneChunk : drop(DropCause::kOutOfRange);
}

ClientEvent ClientSession::on_scene_entry(const SceneListEntry& entry) noexcept {
  if (!session_alive_) return drop(DropCause::kUnexpected);
  if (entry.session_id != welcome_.session_id) return drop(DropCause::kUnknownSession);
  if ((features() & kFeatureSceneSwitch) == 0) return drop(DropCause::kUnexpected);
  return ClientEvent::kSceneEntry;
}

std::size_t ClientSession::make_scene_list_request(std::uint32_t index,
                                                   std::span<std::uint8_t> out) noexcept {
  if (!session_alive_ || (features() & kFeatureSceneSwitch) == 0) return 0;
  return codec_.encode(SceneListRequest{welcome_.session_id, index}, out);
}

std::size_t ClientSession::make_scene_request(std::uint32_t chunk, std::span<std::uint8_t> out) noexcept {
  if (!session_alive_ || (features() & kFeatureScene) == 0 || welcome_.scene.chunk_bytes(chunk) == 0)
    return 0;
  return codec_.encode(SceneRequest{welcome_.session_id, welcome_.scene.name(), chunk}, out);
}

ClientEvent ClientSession::on_reply(const Reply& reply, std::int64_t now_ns) noexcept {
  if (!session_alive_) return drop(DropCause::kUnexpected);
  if (reply.session_id != welcome_.session_id) return drop(DropCause::kUnknownSession);
  if (reply.epoch != welcome_.epoch) return drop(DropCause::kWrongEpoch);
  if (reply.command_sequence > command_sequence_) return drop(DropCause::kOutOfRange);
  if ((features_used(reply) & ~features()) != 0) return drop(DropCause::kUnexpected);
  // Steps that were never sent cannot have been executed.
  if (logs_steps() && (reply.steps.executed > steps_.newest() || reply.steps.executed > reply.steps.newest))
    return drop(DropCause::kOutOfRange);
  // Of the accepted commands up to this one each has a reply with a number, or one that was left out.
  if (reply.sequence > reply.command_sequence ||
      reply.replies_left_out > reply.command_sequence - reply.sequence)
    return drop(DropCause::kOutOfRange);
  const DropCause cause =
      replies_.accept(reply.sequence, SequenceWindow::max_leap(config_.rate_hz, now_ns - last_news_ns_));
  overtaken_ = cause == DropCause::kStale;
  if (cause != DropCause::kNone) return drop(cause);
  if (logs_steps())
    steps_.on_report(reply.steps, now_ns, static_cast<std::int64_t>(stats_.rtt_ns()) + 10'000'000);
  reply_ = reply;
  has_reply_ = true;
  reply_time_ns_ = last_news_ns_ = waits_since_ns_ = now_ns;
  waits_ = reply.command_sequence < command_sequence_;
  slave_energy_.update(reply.energy_in_aj, reply.energy_out_aj);
  // No command was sent before the Welcome: an older echo is wrong, and must not explain any silence to come.
  const auto echo_age_ns =
      static_cast<std::int64_t>(static_cast<std::uint64_t>(now_ns) - reply.command_send_time_ns);
  if (echo_age_ns <= now_ns - welcome_time_ns_) stats_.on_reply(reply, now_ns);
  if (state_ == ClientState::kLost) set_state(ClientState::kEstablished, now_ns);
  return ClientEvent::kReply;
}

std::size_t ClientSession::make_command(Command& command, std::int64_t now_ns,
                                        std::span<std::uint8_t> out) noexcept {
  if (!session_alive_) return 0;
  if (!has_energy_base_) {
    has_energy_base_ = true;
    energy_base_in_j_ = command.energy_in_j;
    energy_base_out_j_ = command.energy_out_j;
    control_base_ = command.control;
  }
  command.session_id = welcome_.session_id;
  command.sequence = ++command_sequence_;
  if (!waits_) waits_since_ns_ = now_ns;
  waits_ = true;
  command.send_time_ns = static_cast<std::uint64_t>(now_ns);
  command.newest_reply = replies_.newest();
  command.epoch = welcome_.epoch;
  command.energy_in_j = std::max(0.0, command.energy_in_j - energy_base_in_j_);
  command.energy_out_j = std::max(0.0, command.energy_out_j - energy_base_out_j_);
  if ((features() & kFeaturePortControl) != 0) {
    PortControl& c = command.control;
    c.energy_sent_j = std::max(0.0, c.energy_sent_j - control_base_.energy_sent_j);
    c.wave_sum -= control_base_.wave_sum;
    c.wave_energy_aj = std::max(0.0, c.wave_energy_aj - control_base_.wave_energy_aj);
  } else {
    command.control = {};
  }
  if ((features() & kFeatureSharing) == 0) {
    command.tip_hold = 0;
    command.flags &= ~(kFlagTakeOver | kFlagHandOver);
  }
  if ((features() & kFeatureReplyDeadband) == 0) command.reply_deadband = {};
  if ((features() & kFeatureUndo) == 0) command.flags &= ~std::uint32_t{kFlagUndo};
  if (logs_steps()) {
    const bool stops = (command.flags & kFlagStop) != 0;
    const std::size_t bytes = steps_.write(step_bytes_, now_ns, step_wait_ns(), stops);
    if (bytes > 0) command.tip_hold = steps_.written_hold();
    // The steps say where the tip goes. What is zero takes no bytes: 54 in each datagram, at 8 kHz a fifth of
    // all that is sent.
    Command beside = command;
    beside.tip_pos_w_nm = beside.tip_vel_w_nm_s = Vec3::Zero();
    return codec_.encode(beside, std::span<const std::uint8_t>(step_bytes_).first(bytes), out);
  }
  if ((features() & kFeatureRedundancy) == 0) return codec_.encode(command, out);
  sent_.before(command, std::min(config_.redundancy, repeats_), recent_);
  sent_.add(command);
  return codec_.encode(command, recent_, out);
}

std::size_t ClientSession::make_snapshot_request(std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  SnapshotRequest request;
  if (!session_alive_ || !logs_steps() || !snapshot_.next(now_ns, step_wait_ns(), request)) return 0;
  request.session_id = welcome_.session_id;
  return codec_.encode(request, out);
}

/// Adds what this session has counted.
void ClientSession::count(LinkQuality& q) const noexcept {
  q.commands_sent += command_sequence_;
  // Every accepted command has one reply, numbered from 1, or one that was left out: the rest had not been
  // accepted.
  if (has_reply_) {
    q.commands_lost += reply_.command_sequence - reply_.sequence - reply_.replies_left_out;
    q.replies_left_out += reply_.replies_left_out;
  }
  q.replies += replies_.received();
  q.replies_lost += replies_.lost();
  q.reordered += replies_.reordered();
  q.duplicates += replies_.duplicate();
}

LinkQuality ClientSession::quality(std::int64_t now_ns) const noexcept {
  LinkQuality q = past_;
  count(q);
  q.dropped = drops_.total();
  q.rtt_us = stats_.rtt_ns() * 1e-3;
  q.rtt_min_us = static_cast<double>(stats_.rtt_min_ns()) * 1e-3;
  q.rtt_last_us = static_cast<double>(stats_.rtt_last_ns()) * 1e-3;
  q.jitter_us = stats_.jitter_ns() * 1e-3;
  q.drift_ppm = stats_.drift_ppm();
  q.drift_error_ppm = stats_.drift_error_ppm();
  q.up_excess_us = stats_.up_excess_ns() * 1e-3;
  q.down_excess_us = stats_.down_excess_ns() * 1e-3;
  if (stats_.samples() > 0) q.offset_us = stats_.offset_ns(now_ns) * 1e-3;
  if (has_reply_) {
    const double age_ns = static_cast<double>(now_ns - reply_time_ns_) + stats_.down_delay_ns() +
                          static_cast<double>(reply_.measurement_age_ns);
    q.force_age_ms = age_ns * 1e-6;
  }
  return q;
}

std::size_t ClientSession::make_bye(ByeReason reason, std::span<std::uint8_t> out) noexcept {
  if (sessions_ == 0) {
    state_ = ClientState::kClosed;
    return 0;
  }
  session_alive_ = false;
  state_ = ClientState::kClosed;
  return codec_.encode(Bye{welcome_.session_id, reason}, out);
}

}  // namespace telenano::link
