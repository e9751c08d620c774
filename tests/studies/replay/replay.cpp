#include "tests/studies/replay/replay.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/link/step_log.h"
#include "telenano/master/loop/station_loop.h"
#include "telenano/master/twin/scene_twin.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/studies/replay/scripted_wire.h"

namespace telenano::studies {
namespace {

using recording::Column;
using recording::Sample;

/// What the replay computes anew. Left out: what is told to it (hand, times, buttons, what the device
/// applied) and what only describes the link.
constexpr const char* kCompared[] = {"tip_target_w_nm",
                                     "tip_pos_w_nm",
                                     "force_w_nn",
                                     "hand_force_scaled_h_n",
                                     "hand_force_rendered_h_n",
                                     "hand_force_commanded_h_n",
                                     "damper_n_s_m",
                                     "clamp_n",
                                     "energy_j",
                                     "energy_bound_j",
                                     "energy_in_j",
                                     "energy_out_j",
                                     "account_j",
                                     "slave_energy_in_aj",
                                     "slave_energy_out_aj",
                                     "deflection_nm",
                                     "velocity_scale",
                                     "force_scale",
                                     "contact_state",
                                     "fault_bits",
                                     "station_mode",
                                     "limit_flags",
                                     "station_faults",
                                     "method",
                                     "model_version"};

/// The hand where it was, a device that applied what it did.
class RecordedDevice final : public device::HapticDevice {
 public:
  RecordedDevice(device::DeviceInfo info, RecordedClock& clock) : info_(std::move(info)), clock_(clock) {}
  const device::DeviceInfo& info() const noexcept override { return info_; }
  void set(const Sample& row) noexcept { row_ = &row; }
  void read(device::DeviceReading& reading) noexcept override {
    reading.status = static_cast<device::DeviceStatus>(row_->device_status);
    reading.hand_pos_h_m = Vec3(row_->hand_pos_h_m[0], row_->hand_pos_h_m[1], row_->hand_pos_h_m[2]);
    reading.buttons = row_->buttons;
  }
  Vec3 write_force(const Vec3&) noexcept override {
    // What follows in a tick is the command's departure.
    if (row_->sent_ns != 0) clock_.set(row_->sent_ns);
    const auto& f = row_->hand_force_applied_h_n;
    return {f[0], f[1], f[2]};
  }

 private:
  device::DeviceInfo info_;
  RecordedClock& clock_;
  const Sample* row_ = nullptr;
};

double value_of(const Sample& row, const Column& column, std::size_t component) {
  const char* at = reinterpret_cast<const char*>(&row) + column.offset + component * column.element_bytes();
  if (column.type == recording::ColumnType::kUint32) {
    std::uint32_t value = 0;
    std::memcpy(&value, at, sizeof value);
    return value;
  }
  double value = 0;
  std::memcpy(&value, at, sizeof value);
  return value;
}

std::vector<const Column*> compared_columns() {
  std::vector<const Column*> columns;
  for (const char* name : kCompared) {
    for (const Column& column : recording::sample_columns())
      if (std::strcmp(column.name, name) == 0) columns.push_back(&column);
  }
  return columns;
}

/// True if equal, bit for bit; else says where, if it is the first time.
bool compare(const Sample& recorded, const Sample& replayed, const std::vector<const Column*>& columns,
             ReplayResult& result) {
  for (const Column* column : columns) {
    const auto* a = reinterpret_cast<const char*>(&recorded) + column->offset;
    const auto* b = reinterpret_cast<const char*>(&replayed) + column->offset;
    if (std::memcmp(a, b, column->bytes()) == 0) continue;
    if (result.first_difference >= 0) return false;
    result.first_difference = recorded.tick;
    result.column = column->name;
    for (std::size_t i = 0; i < column->components; ++i) {
      result.recorded = value_of(recorded, *column, i);
      result.replayed = value_of(replayed, *column, i);
      if (std::bit_cast<std::uint64_t>(result.recorded) != std::bit_cast<std::uint64_t>(result.replayed))
        break;
    }
    return false;
  }
  return true;
}

bool shares_tip(const RecordedSession& recorded) {
  return (recorded.features & link::kFeatureSharing) != 0;
}

/// A Welcome to a shared tip, which stood wherever others had left it: by its first row the recording says where. Empty: it
/// is none.
std::vector<std::uint8_t> welcome_as_then(const RecordedSession& recorded,
                                          std::span<const std::uint8_t> bytes) {
  link::Codec codec;
  link::Incoming incoming;
  if (!shares_tip(recorded) || codec.decode(bytes, incoming) != link::DropCause::kNone ||
      incoming.type != link::MessageType::kWelcome)
    return {};
  const auto& target = recorded.samples.front().tip_target_w_nm;
  link::Welcome welcome = incoming.welcome;
  welcome.start_pos_w_nm = Vec3(target[0], target[1], target[2]);
  std::vector<std::uint8_t> as_then(link::kMaxDatagramBytes);
  as_then.resize(codec.encode(welcome, as_then));
  return as_then;
}

/// The session up to the recording's first tick: the handshake, and the idle commands by which the station
/// had measured its link.
void prime(const RecordedSession& recorded, std::span<const recording::DatagramRow> rows,
           link::ClientSession& client, ScriptedWire& wire, RecordedClock& clock) {
  const Sample& first = recorded.samples.front();
  const auto period_ns = std::llround(1e9 / recorded.station.rate_hz);
  const std::int64_t probes = first.commands_sent - (first.sent_ns != 0 ? 1 : 0);
  clock.set(first.now_ns - (probes + 10) * period_ns);
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer;
  client.start(clock.now_ns());
  for (int i = 0; i < 10 && client.state() != link::ClientState::kEstablished; ++i) {
    if (const std::size_t n = client.poll(clock.now_ns(), buffer))
      wire.send(std::span(buffer).first(n), wire.address());
    net::Received received;
    while (wire.receive(buffer, received)) {
      auto bytes = std::span(buffer).first(received.size);
      const std::vector<std::uint8_t> as_then = welcome_as_then(recorded, bytes);
      client.on_datagram(as_then.empty() ? bytes : std::span<const std::uint8_t>(as_then), clock.now_ns());
    }
    clock.set(clock.now_ns() + 1);
  }
  if (client.state() != link::ClientState::kEstablished)
    throw RunError("the replay's session was not established");
  wire.open_to_all(false);
  std::set<std::uint64_t> come_later;
  for (const auto& row : rows) come_later.insert(row.answers);
  // A machine with too much to do may have answered none of them by then.
  const bool any = first.rtt_smoothed_us > 0;
  const std::uint64_t answered = newest_answered_before(recorded.datagrams, any);
  // By the round trip a sender of logged steps knows for how long to wait before it sends them again.
  const bool logs_steps = (recorded.features & link::kFeatureStepLog) != 0;
  const std::int64_t round_trip_ns = std::llround(1e3 * first.rtt_smoothed_us);
  std::vector<std::pair<std::int64_t, const std::vector<std::uint8_t>*>> measured;
  for (std::int64_t k = 1; k <= probes; ++k) {
    clock.set(first.now_ns - (probes - k + 1) * period_ns);
    link::Command command;
    command.tip_pos_w_nm = client.welcome().start_pos_w_nm;
    if (shares_tip(recorded)) command.flags = link::kFlagHandOver;  // who gets ready takes no shared tip
    const std::size_t n = client.make_command(command, clock.now_ns(), buffer);
    wire.send(std::span(buffer).first(n), wire.address());
    if (logs_steps) wire.end_tick(0, {});
    const auto number = static_cast<std::uint64_t>(k);
    const auto* reply = wire.reply_to(number);
    if (reply == nullptr || come_later.contains(number) || number > answered) continue;
    if (logs_steps) {
      measured.emplace_back(clock.now_ns() + round_trip_ns, reply);
    } else {
      client.on_datagram(*reply, clock.now_ns());
    }
  }
  for (const auto& [at_ns, reply] : measured) client.on_datagram(*reply, at_ns);
}

bool is_accepted(const recording::DatagramRow& row, link::MessageType type) {
  return row.type == static_cast<std::uint32_t>(type) && row.drop == 0;
}

/// A machine that stood still between the Welcome and the first tick has cost the station its session: the
/// recording begins without one, and the first that comes is another Welcome.
bool begins_without_session(const RecordedSession& recorded) {
  if (recorded.samples.front().sent_ns != 0) return false;
  for (const auto& row : recorded.datagrams) {
    if (is_accepted(row, link::MessageType::kReply)) return false;
    if (is_accepted(row, link::MessageType::kWelcome)) return true;
  }
  return false;
}

link::StepReport report_of(const recording::DatagramRow& row) {
  return {row.executed, row.state_hash, row.newest, row.breaks, row.break_reason, row.break_step};
}

bool observes(const Sample& row) {
  return (row.limit_flags & recording::kLimitObserves) != 0;
}

/// Null: the recording has no such tick.
const Sample* sample_at(const RecordedSession& recorded, std::int64_t tick) {
  const std::int64_t at = tick - recorded.samples.front().tick;
  const bool known = at >= 0 && at < std::ssize(recorded.samples);
  return known ? &recorded.samples[static_cast<std::size_t>(at)] : nullptr;
}

/// From one Welcome to the next: commands, replies and what they say of the log are numbered anew.
struct Session {
  Script script;
  std::uint64_t unknown_from = UINT64_MAX;
  std::set<std::uint64_t> stepped;
};

/// The rows of the session that begins with the first of these.
std::span<const recording::DatagramRow> rows_of_session(std::span<const recording::DatagramRow> rows) {
  std::size_t count = rows.empty() ? 0 : 1;
  while (count < rows.size() && !is_accepted(rows[count], link::MessageType::kWelcome)) ++count;
  return rows.first(count);
}

Session session_of(const RecordedSession& recorded, std::span<const recording::DatagramRow> rows) {
  std::vector<recording::DatagramRow> own;
  for (const auto& row : rows) {
    if (row.drop != static_cast<std::uint32_t>(link::DropCause::kUnknownSession)) own.push_back(row);
  }
  Session session;
  StepOrder order = step_order(own);
  session.unknown_from = order.unknown_from;
  session.stepped = order.commands;
  session.script.order = std::move(order);
  session.script.shares_tip = shares_tip(recorded);
  if ((recorded.features & link::kFeatureStepLog) == 0) return session;
  for (const auto& row : own) {
    if (!is_accepted(row, link::MessageType::kReply)) continue;
    ToldLog told{report_of(row)};
    if (const Sample* const then = sample_at(recorded, row.tick);
        then != nullptr && session.script.shares_tip) {
      told.observes = observes(*then);
      told.energy_in_aj = then->slave_energy_in_aj;
      told.energy_out_aj = then->slave_energy_out_aj;
    }
    session.script.told[row.answers] = told;
  }
  // Found apart, and not for a break: what the server says is not what its own steps make of the sample.
  std::uint32_t breaks = own.empty() ? 0 : own.front().breaks;
  for (const auto& row : own) {
    if (!is_accepted(row, link::MessageType::kReply)) continue;
    session.script.told[row.answers].parts = row.breaks == breaks && recorded.apart_at.contains(row.tick);
    breaks = row.breaks;
  }
  return session;
}

/// Asks for the session again, and is answered at once: the Welcome, which the client has not heard yet.
std::vector<std::uint8_t> resume(link::ClientSession& client, ScriptedWire& wire, RecordedClock& clock) {
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer;
  link::Codec codec;
  link::Incoming incoming;
  wire.open_to_all(true);
  client.resume(clock.now_ns());
  std::vector<std::uint8_t> welcome;
  for (int i = 0; i < 10 && welcome.empty(); ++i) {
    if (const std::size_t n = client.poll(clock.now_ns(), buffer))
      wire.send(std::span(buffer).first(n), wire.address());
    net::Received received;
    while (wire.receive(buffer, received)) {
      const auto bytes = std::span(buffer).first(received.size);
      const bool good = codec.decode(bytes, incoming) == link::DropCause::kNone;
      if (good && incoming.type == link::MessageType::kWelcome) {
        welcome.assign(bytes.begin(), bytes.end());
      } else {
        client.on_datagram(bytes, clock.now_ns());
      }
    }
  }
  wire.open_to_all(false);
  if (welcome.empty()) throw RunError("the replay's session was not resumed");
  return welcome;
}

/// What the recording does not hold, at this row; empty: it goes on. `command`: number within its session.
std::string why_it_ends(const RecordedSession& recorded, std::size_t k, std::uint64_t command,
                        std::uint64_t unknown_from, std::span<const recording::DatagramRow> rows) {
  const Sample& row = recorded.samples[k];
  if (k == 0 && begins_without_session(recorded))
    return "the session was lost before the first tick: what the slave did until then is not recorded";
  const bool tells_of_log = recorded.tells_of_log && (recorded.features & link::kFeatureStepLog) != 0;
  if (k > 0 && row.tick != recorded.samples[k - 1].tick + 1) return "rows are missing in the recording";
  if (row.sent_ns != 0 && command >= unknown_from && !tells_of_log)
    return "more than 64 commands were lost in part: the order of the slave's steps is not known";
  if (!tells_of_log && !recorded.apart_at.empty() && row.tick >= *recorded.apart_at.begin())
    return "the twin was apart from the server's slave, whose state it then took up: that is not recorded";
  if (shares_tip(recorded) && observes(row)) {
    const bool twin = row.method == static_cast<std::uint32_t>(control::Method::kTwin);
    if (!tells_of_log || !twin) return "another session held the shared tip: what it did is not recorded";
  }
  for (const auto& datagram : rows) {
    if (datagram.drop != 0) continue;
    if (datagram.type == static_cast<std::uint32_t>(link::MessageType::kWelcome) && !tells_of_log)
      return "the session was resumed: what the slave did while the station was away is not recorded";
    const auto reason = static_cast<link::ByeReason>(datagram.break_reason);
    const bool for_good = reason == link::ByeReason::kDone || reason == link::ByeReason::kStopped;
    if (datagram.type == static_cast<std::uint32_t>(link::MessageType::kBye) && (!tells_of_log || for_good))
      return "the server ended the session";
  }
  return "";
}

/// What the station's step of this tick says, besides where to (Station::command_flags of a tip of its own).
std::uint32_t step_flags(const RecordedSession& recorded, const Sample& row, const Sample& replayed) {
  std::uint32_t flags = 0;
  const auto mode = static_cast<station::Mode>(replayed.station_mode);
  if (mode == station::Mode::kEngaged) flags |= link::kFlagClutch;
  if (!recorded.station.require_deadman || (row.buttons & device::kButtonDeadman) != 0)
    flags |= link::kFlagDeadman;
  if (mode == station::Mode::kStopped) flags |= link::kFlagStop;
  return flags;
}

}  // namespace

ReplayResult replay(const RecordedSession& recorded, const std::shared_ptr<const scene::Scene>& scene) {
  server::ServerConfig server_config;
  server_config.secret = link::SipKey{1, 2};
  server_config.table.capacity = 1;
  server_config.feature_bits = recorded.features;
  const bool logs_steps = (recorded.features & link::kFeatureStepLog) != 0;
  if (logs_steps) server_config.table.timeout_ns = recorded.slave_timeout_ns;
  if (shares_tip(recorded)) server_config.share = server::Share::kOneTip;
  server::ServedScene served;
  served.name = server::scene_name(scene->name);
  served.hash = scene->hash;
  served.make_slave = [scene] { return std::make_unique<slave::NveSlave>(scene); };
  // More than one where the recorded one was restarted.
  std::vector<std::unique_ptr<server::Server>> servers;
  servers.push_back(std::make_unique<server::Server>(server_config, served));

  RecordedClock clock;
  std::span<const recording::DatagramRow> datagrams(recorded.datagrams);
  const auto first_rows = rows_of_session(datagrams);
  Session session = session_of(recorded, first_rows);
  std::int64_t commands_before = 0;  // of earlier sessions
  std::uint64_t epoch = 0;
  for (const auto& row : recorded.datagrams)
    if (epoch == 0 && row.type == static_cast<std::uint32_t>(link::MessageType::kReply)) epoch = row.epoch;
  ScriptedWire wire(*servers.back(), clock, session.script, served.make_slave()->state_hash());
  wire.set_states(&recorded.states);
  wire.set_pieces(recorded.state_pieces);
  std::size_t pieces_come = 0;
  link::ClientConfig client_config;
  client_config.rate_hz = static_cast<std::uint32_t>(recorded.station.rate_hz);
  client_config.redundancy = recorded.redundancy;
  if (logs_steps) {
    client_config.step_ring = static_cast<std::size_t>(recorded.twin_ring_s * recorded.station.rate_hz);
    client_config.snapshot_bytes = twin::SceneTwin(scene).snapshot_bytes_max();
  }
  link::ClientSession client(client_config);
  prime(recorded, first_rows, client, wire, clock);

  RecordedDevice device(recorded.device, clock);
  const link::Welcome& welcome = client.welcome();
  station::Station station(
      recorded.station, device.info(),
      {welcome.coupling_stiffness_n_m, welcome.coupling_damping_n_s_m, welcome.force_max_nn});
  // A twin of another scene than the server's never came into use.
  if (logs_steps && recorded.twin_scene_hash == recorded.scene_hash) {
    station::TwinRunConfig twin;
    twin.rate_hz = recorded.station.rate_hz;
    twin.ring_s = recorded.twin_ring_s;
    twin.look_s = station::kLookAgain_s;
    station.use_twin(std::make_unique<station::TwinRun>(twin, std::make_unique<twin::SceneTwin>(scene),
                                                        std::make_unique<twin::SceneTwin>(scene)));
  }
  loop::StationLoop loop(device, wire, wire.address(), client, station, &clock, recorded.link);

  const auto columns = compared_columns();
  ReplayResult result;
  result.recorded_ticks = static_cast<std::int64_t>(recorded.samples.size());
  std::int64_t last_step_ns = recorded.samples.front().now_ns;
  Sample sample;
  for (std::size_t k = 0; k < recorded.samples.size(); ++k) {
    const Sample& row = recorded.samples[k];
    std::size_t count = 0;
    while (count < datagrams.size() && datagrams[count].tick <= row.tick) ++count;
    const auto rows = datagrams.first(count);
    const auto command =
        static_cast<std::uint64_t>(std::max<std::int64_t>(row.commands_sent - commands_before, 0));
    result.ended = why_it_ends(recorded, k, command, session.unknown_from, rows);
    for (const auto& datagram : rows)
      pieces_come += is_accepted(datagram, link::MessageType::kSnapshotPiece) ? 1 : 0;
    if (result.ended.empty() && logs_steps && pieces_come > recorded.state_pieces.size())
      result.ended = "the server's state that the twin took up is not all recorded";
    if (result.ended.empty() && !logs_steps && row.sent_ns != 0 && session.stepped.contains(command)) {
      if (row.sent_ns - last_step_ns > recorded.slave_timeout_ns)
        result.ended = "no command had come for the slave's time-out: it withdrew by its own clock";
      last_step_ns = row.sent_ns;
    }
    if (!result.ended.empty()) break;

    // What a person asked for between two ticks.
    const control::Scaling& scaling = station.config().scaling;
    if (scaling.velocity != row.velocity_scale || scaling.force != row.force_scale)
      station.change_scaling({row.velocity_scale, row.force_scale});
    if (k > 0 && row.method != recorded.samples[k - 1].method)
      station.change_method(static_cast<control::Method>(row.method));
    if (station.mode() == station::Mode::kStopped &&
        row.station_mode != static_cast<std::uint32_t>(station::Mode::kStopped))
      station.clear_stop();

    if (recorded.undo_after.contains(row.tick - 1)) loop.undo_marks(row.now_ns);
    loop.send_as_recorded(row.sent_ns != 0);
    device.set(row);
    wire.begin_tick(row.now_ns, {}, &row);
    for (std::size_t i = 0; i < rows.size() && logs_steps; ++i) {
      if (!is_accepted(rows[i], link::MessageType::kWelcome)) continue;
      if (rows[i].epoch != epoch) {
        server_config.secret.k1 += 1;
        servers.push_back(std::make_unique<server::Server>(server_config, served));
        wire.use(*servers.back());
        epoch = rows[i].epoch;
      } else {
        wire.end_session(report_of(rows[i]), row.now_ns);
      }
      session = session_of(recorded, rows_of_session(datagrams.subspan(i)));
      commands_before = k > 0 ? recorded.samples[k - 1].commands_sent : 0;
      const std::vector<std::uint8_t> answer = resume(client, wire, clock);
      wire.begin_session(session.script, answer, report_of(rows[i]));
      break;
    }
    datagrams = datagrams.subspan(count);
    wire.begin_tick(row.now_ns, rows, &row);
    const std::uint64_t step_before = client.next_step();
    loop.tick(row.now_ns, row.dt_s, sample);
    if (wire.told_in_tick()) {
      ++result.told_ticks;
      if (row.method != static_cast<std::uint32_t>(control::Method::kTwin)) {
        result.ended = "the server's slave left its log while no twin was felt: its state is not recorded";
        break;
      }
    }
    if (logs_steps && client.next_step() == step_before) wire.end_tick(0, {});
    if (logs_steps && client.next_step() != step_before) {
      link::LoggedStep step =
          link::logged_step(loop.trace().tip_target_pos_w_nm, step_flags(recorded, row, sample), row.dt_s);
      step.dt_ns = loop.step().dt_ns;
      step.hold = loop.step().hold;
      wire.end_tick(client.next_step() - 1, step);
    }
    if (wire.other_steps_at() != 0) {
      result.ended = "the steps that the server had made by then are not all recorded";
      break;
    }
    ++result.replayed_ticks;
    if (compare(row, sample, columns, result)) ++result.equal_ticks;
    for (std::size_t i = 0; i < 3; ++i)
      result.largest_force_error_n =
          std::max(result.largest_force_error_n,
                   std::fabs(sample.hand_force_commanded_h_n[i] - row.hand_force_commanded_h_n[i]));
  }
  result.steps = wire.steps();
  return result;
}

}  // namespace telenano::studies
