#include "nve_server/server/server.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/error.h"

namespace telenano::server {

using link::DropCause;

namespace {

link::PeerKey peer_key(const net::Address& address) noexcept {
  link::PeerKey key;
  std::copy(address.ip.begin(), address.ip.end(), key.bytes.begin());
  key.bytes[16] = static_cast<std::uint8_t>(address.port & 0xff);
  key.bytes[17] = static_cast<std::uint8_t>(address.port >> 8);
  return key;
}

/// The shortest step that a slave is given: two commands of a station that catches up may lie that close
/// together.
constexpr double kStepMinS = 1e-6;

bool is_finite(const slave::SlaveOutput& o) noexcept {
  return telenano::is_finite(o.force_w_nn) && telenano::is_finite(o.tip_pos_w_nm) &&
         telenano::is_finite(o.commanded_pos_w_nm) && std::isfinite(o.deflection_nm) &&
         std::isfinite(o.energy_in_aj) && std::isfinite(o.energy_out_aj);
}

/// A slave that goes wrong must not be felt: zero force, a named fault, everything else as it was last.
void step_guarded(slave::Slave& slave, const slave::SlaveInput& input, double dt_s,
                  slave::SlaveOutput& output) noexcept {
  slave::SlaveOutput next = output;
  slave.step(input, dt_s, next);
  if (!link::is_finite(next.model)) next.model = {};  // the force may be right all the same
  if (is_finite(next)) {
    output = next;
    return;
  }
  output.force_w_nn.setZero();
  output.fault_bits |= link::kFaultNonFinite;
}

bool wants_model(const link::Session& session, const link::Command& command) noexcept {
  return (session.feature_bits & link::kFeatureLocalModel) != 0 &&
         command.control.method == link::kMethodModel;
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

}  // namespace

link::SceneName scene_name(const std::string& text) noexcept {
  link::SceneName name;
  std::copy_n(text.begin(), std::min(text.size(), link::kSceneNameBytes), name.text.begin());
  return name;
}

Server::Server(const ServerConfig& config, ServedScene scene)
    : config_(config),
      scene_(std::move(scene)),
      spare_(first_slave(scene_)),
      limits_(spare_->limits()),
      table_(config.table, config.secret),
      handshake_({config.secret, config.feature_bits, limits_.rate_max_hz, config.challenges_per_s,
                  config.openings_per_s}),
      ports_(table_.capacity()) {}

std::size_t Server::drop(DropCause cause) noexcept {
  drops_.add(cause);
  return 0;
}

std::size_t Server::on_datagram(std::span<const std::uint8_t> bytes, const net::Address& from,
                                std::int64_t now_ns, std::span<std::uint8_t> out, const rt::Clock* clock,
                                const net::Standing& standing) noexcept {
  ++counters_.datagrams;
  const DropCause cause = codec_.decode(bytes, incoming_);
  if (cause != DropCause::kNone) return drop(cause);
  may_operate_ = standing.rights >= net::Rights::kOperate;
  switch (incoming_.type) {
    case link::MessageType::kCommand:
      return on_command(incoming_.command, from, now_ns, out, clock);
    case link::MessageType::kHello:
      return on_hello(incoming_.hello, from, now_ns, out, standing);
    case link::MessageType::kBye:
      on_bye(incoming_.bye, from, now_ns);
      return 0;
    default:
      return drop(DropCause::kUnknownType);  // only a server may send these
  }
}

bool Server::make_port(std::size_t slot, std::int64_t now_ns) noexcept {
  Port& port = ports_[slot];
  port = {};
  if (spare_) {
    port.slave = std::move(spare_);
  } else {
    try {
      port.slave = scene_.make_slave();
    } catch (...) {  // out of memory, or a scene file that has vanished: no session, but those that run go on
      port.slave = nullptr;
    }
  }
  if (!port.slave) return false;
  port.output.tip_pos_w_nm = port.output.commanded_pos_w_nm = port.slave->limits().start_pos_w_nm;
  port.last_target_w_nm = port.slave->limits().start_pos_w_nm;
  port.last_step_ns = now_ns;
  return true;
}

std::size_t Server::welcome(std::size_t slot, std::uint64_t nonce, std::span<std::uint8_t> out) noexcept {
  const link::Session& session = table_[slot];
  const slave::SlaveLimits& limits = ports_[slot].slave->limits();
  link::Welcome w;
  w.feature_bits = session.feature_bits;
  w.nonce = nonce;
  w.session_id = session.session_id;
  w.resume_token = session.resume_token;
  w.epoch = session.epoch;
  w.timeout_ms =
      static_cast<std::uint32_t>(std::max<std::int64_t>(table_.config().timeout_ns / 1'000'000, 1));
  w.slave_rate_max_hz = limits.rate_max_hz;
  w.scene_name = scene_.name;
  w.scene_hash = scene_.hash;
  w.workspace_min_w_nm = limits.workspace_min_w_nm;
  w.workspace_max_w_nm = limits.workspace_max_w_nm;
  // Resuming must not be felt: go on at the command that the slave holds, with its force.
  w.start_pos_w_nm = ports_[slot].output.commanded_pos_w_nm;
  w.surface_z_w_nm = limits.surface_z_w_nm;
  w.force_max_nn = limits.force_max_nn;
  w.coupling_stiffness_n_m = limits.coupling_stiffness_n_m;
  w.coupling_damping_n_s_m = limits.coupling_damping_n_s_m;
  return codec_.encode(w, out);
}

std::size_t Server::on_hello(const link::Hello& hello, const net::Address& from, std::int64_t now_ns,
                             std::span<std::uint8_t> out, const net::Standing& standing) noexcept {
  using Kind = link::HelloVerdict::Kind;
  link::HelloVerdict verdict =
      handshake_.on_hello(hello, peer_key(from), now_ns, table_, shutting_down_, standing.address_proven);
  if (verdict.kind == Kind::kOpen && !make_port(verdict.slot, now_ns)) {
    table_.release(verdict.slot);
    verdict.kind = Kind::kRefuse;
    verdict.cause = DropCause::kFull;
    verdict.refuse = {hello.nonce, link::RefuseReason::kFull, link::kProtocolVersion, link::kProtocolVersion};
  }
  if (verdict.cause != DropCause::kNone) drops_.add(verdict.cause);
  switch (verdict.kind) {
    case Kind::kDrop:
      return 0;
    case Kind::kChallenge:
      return codec_.encode(verdict.challenge, out);
    case Kind::kRefuse:
      return codec_.encode(verdict.refuse, out);
    case Kind::kOpen:
      ++counters_.opened;
      break;
    case Kind::kResume:
      ports_[verdict.slot].control.begin_session();
      ++counters_.resumed;
      break;
    case Kind::kAgain:
      break;
  }
  ports_[verdict.slot].address = from;
  return welcome(verdict.slot, hello.nonce, out);
}

std::size_t Server::on_command(const link::Command& command, const net::Address& from, std::int64_t now_ns,
                               std::span<std::uint8_t> out, const rt::Clock* clock) noexcept {
  std::size_t slot = link::SessionTable::kNone;
  const DropCause cause = table_.accept(command, peer_key(from), now_ns, slot, incoming_.recent.count > 0);
  if (cause != DropCause::kNone) {
    drops_.add(cause);
    // A station that talks to a session which is gone or asleep is told, so that it resumes without waiting.
    const bool gone = cause == DropCause::kUnknownSession;
    const bool asleep = cause == DropCause::kUnexpected && table_[slot].state == link::SlotState::kSilent;
    if ((!gone && !asleep) || !handshake_.may_answer(now_ns) || command.session_id == 0) return 0;
    const auto reason = gone ? link::ByeReason::kUnknownSession : link::ByeReason::kIdle;
    return codec_.encode(link::Bye{command.session_id, reason}, out);
  }

  link::Session& session = table_[slot];
  Port& port = ports_[slot];
  play(slot, command, incoming_.recent);
  port.last_step_ns = now_ns;
  const bool controls = (session.feature_bits & link::kFeaturePortControl) != 0;

  link::Reply reply;
  reply.session_id = session.session_id;
  reply.sequence = ++session.reply_sequence;
  reply.command_sequence = command.sequence;
  reply.command_send_time_ns = command.send_time_ns;
  reply.epoch = session.epoch;
  reply.contact_state = port.output.contact_state;
  reply.fault_bits = port.output.fault_bits;
  reply.force_w_nn = port.output.force_w_nn;
  reply.tip_pos_w_nm = port.output.tip_pos_w_nm;
  reply.deflection_nm = port.output.deflection_nm;
  reply.energy_in_aj = port.output.energy_in_aj;
  reply.energy_out_aj = port.output.energy_out_aj;
  if (controls) reply.port = port.control.answer();
  if (wants_model(session, command)) reply.model = port.output.model;
  const std::int64_t sent_ns = clock != nullptr ? std::max(clock->now_ns(), now_ns) : now_ns;
  reply.server_time_ns = static_cast<std::uint64_t>(sent_ns);
  reply.hold_time_ns = static_cast<std::uint64_t>(sent_ns - now_ns);
  reply.measurement_age_ns =
      static_cast<std::uint64_t>(std::max<std::int64_t>(port.output.measurement_age_ns, 0));
  if (clock != nullptr) service_.add(sent_ns - now_ns);
  session.peer_stats.on_reply(reply.sequence, sent_ns);
  ++counters_.exchanges;
  return codec_.encode(reply, out);
}

void Server::play_one(Port& port, const link::Session& session, const link::Command& command,
                      double spacing_s) noexcept {
  slave::SlaveInput input;
  input.tip_target_pos_w_nm = command.tip_pos_w_nm;
  input.tip_target_vel_w_nm_s = command.tip_vel_w_nm_s;
  input.retract = may_operate_ && (command.flags & link::kFlagStop) != 0;
  constexpr std::uint32_t kEngaged = link::kFlagClutch | link::kFlagDeadman;
  input.follow = may_operate_ && !input.retract && (command.flags & kEngaged) == kEngaged;
  input.wants_model = wants_model(session, command);
  const double dt_s = std::clamp(spacing_s, kStepMinS, config_.step_max_s);
  const slave::SlaveOutput last = port.output;
  const bool controls = (session.feature_bits & link::kFeaturePortControl) != 0;
  if (controls) input = port.control.before(command, input, last, port.slave->limits(), dt_s);
  step_guarded(*port.slave, input, dt_s, port.output);
  if (controls) port.control.after(last, port.output, dt_s);
  port.last_target_w_nm = command.tip_pos_w_nm;
}

void Server::play(std::size_t slot, const link::Command& command,
                  const link::RecentCommands& recent) noexcept {
  Port& port = ports_[slot];
  const link::Session& session = table_[slot];
  link::MissedSteps plan;
  link::plan_steps(recent, session.missed, session.spacing_s, 1.0 / session.rate_hz, plan);
  for (std::size_t i = 0; i < plan.count; ++i) {
    const link::MissedSteps::Step& step = plan.step[i];
    const Vec3 vel_w_nm_s = (step.command.tip_pos_w_nm - port.last_target_w_nm) / step.spacing_s;
    play_one(port, session, link::with_recent(command, step.command, vel_w_nm_s), step.spacing_s);
  }
  counters_.recovered += plan.count;
  play_one(port, session, command, plan.last_spacing_s);
}

void Server::on_bye(const link::Bye& bye, const net::Address& from, std::int64_t now_ns) noexcept {
  const std::size_t slot = table_.find(bye.session_id);
  if (slot == link::SessionTable::kNone) {
    drops_.add(DropCause::kUnknownSession);
  } else if (!(table_[slot].peer == peer_key(from))) {
    drops_.add(DropCause::kUnauthenticated);
  } else if (table_[slot].state == link::SlotState::kEnding) {
    drops_.add(DropCause::kDuplicate);  // Byes are sent more than once
  } else {
    table_.end(slot, now_ns);
    ++counters_.ended;
  }
}

void Server::retract(std::size_t slot, std::int64_t now_ns) noexcept {
  Port& port = ports_[slot];
  slave::SlaveInput input;
  input.follow = false;
  input.retract = true;
  input.tip_target_pos_w_nm = port.output.commanded_pos_w_nm;
  const double dt_s =
      std::clamp(1e-9 * static_cast<double>(now_ns - port.last_step_ns), kStepMinS, config_.step_max_s);
  const slave::SlaveOutput last = port.output;
  step_guarded(*port.slave, input, dt_s, port.output);
  port.control.after(last, port.output, dt_s);
  port.last_step_ns = now_ns;
}

void Server::poll(std::int64_t now_ns) noexcept {
  table_.expire(now_ns, [&](std::size_t slot, link::SlotState state) {
    if (state == link::SlotState::kSilent) {
      ++counters_.timed_out;
      ports_[slot].last_step_ns = now_ns;
    }
    if (state == link::SlotState::kFree) ports_[slot] = {};
  });
  for (std::size_t slot = 0; slot < ports_.size(); ++slot) {
    const link::Session& session = table_[slot];
    const bool leaving =
        session.state == link::SlotState::kSilent || session.state == link::SlotState::kEnding;
    if (leaving && ports_[slot].slave && now_ns - session.state_since_ns <= table_.config().ending_ns) {
      retract(slot, now_ns);
    }
  }
}

std::size_t Server::next_bye(std::int64_t now_ns, std::span<std::uint8_t> out, net::Address& to) noexcept {
  shutting_down_ = true;
  for (std::size_t slot = 0; slot < ports_.size(); ++slot) {
    if (table_[slot].state != link::SlotState::kActive) continue;
    table_.end(slot, now_ns);
    to = ports_[slot].address;
    return codec_.encode(link::Bye{table_[slot].session_id, link::ByeReason::kShuttingDown}, out);
  }
  return 0;
}

}  // namespace telenano::server
