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

/// The session up to the recording's first tick: the handshake, and the idle commands by which the station
/// had measured its link.
void prime(const RecordedSession& recorded, link::ClientSession& client, ScriptedWire& wire,
           RecordedClock& clock) {
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
    while (wire.receive(buffer, received))
      client.on_datagram(std::span(buffer).first(received.size), clock.now_ns());
    clock.set(clock.now_ns() + 1);
  }
  if (client.state() != link::ClientState::kEstablished)
    throw RunError("the replay's session was not established");
  wire.open_to_all(false);
  std::set<std::uint64_t> come_later;
  for (const auto& row : recorded.datagrams) come_later.insert(row.answers);
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

/// What the recording does not hold, at this row; empty: it goes on.
std::string why_it_ends(const RecordedSession& recorded, std::size_t k, std::uint64_t unknown_from,
                        std::span<const recording::DatagramRow> rows) {
  const Sample& row = recorded.samples[k];
  if (k > 0 && row.tick != recorded.samples[k - 1].tick + 1) return "rows are missing in the recording";
  if (row.sent_ns != 0 && static_cast<std::uint64_t>(row.commands_sent) >= unknown_from)
    return "more than 64 commands were lost in part: the order of the slave's steps is not known";
  if (row.tick >= recorded.apart_at)
    return "the twin was apart from the server's slave, whose state it then took up: that is not recorded";
  for (const auto& datagram : rows) {
    if (datagram.drop != 0) continue;
    if (datagram.type == static_cast<std::uint32_t>(link::MessageType::kWelcome))
      return "the session was resumed: what the slave did while the station was away is not recorded";
    if (datagram.type == static_cast<std::uint32_t>(link::MessageType::kBye))
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
  server::ServedScene served;
  served.name = server::scene_name(scene->name);
  served.hash = scene->hash;
  served.make_slave = [scene] { return std::make_unique<slave::NveSlave>(scene); };
  server::Server server(server_config, std::move(served));

  RecordedClock clock;
  StepOrder order = step_order(recorded.datagrams);
  const std::uint64_t unknown_from = order.unknown_from;
  const std::set<std::uint64_t> stepped = order.commands;
  ScriptedWire wire(server, clock, std::move(order));
  link::ClientConfig client_config;
  client_config.rate_hz = static_cast<std::uint32_t>(recorded.station.rate_hz);
  client_config.redundancy = recorded.redundancy;
  if (logs_steps) {
    client_config.step_ring = static_cast<std::size_t>(recorded.twin_ring_s * recorded.station.rate_hz);
    for (const auto& row : recorded.datagrams) {
      if (row.type == static_cast<std::uint32_t>(link::MessageType::kReply) && row.drop == 0)
        wire.expect_executed(row.answers, row.executed);
    }
  }
  link::ClientSession client(client_config);
  prime(recorded, client, wire, clock);

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
    station.use_twin(std::make_unique<station::TwinRun>(twin, std::make_unique<twin::SceneTwin>(scene),
                                                        std::make_unique<twin::SceneTwin>(scene)));
  }
  loop::StationLoop loop(device, wire, wire.address(), client, station, &clock, recorded.link);

  const auto columns = compared_columns();
  ReplayResult result;
  result.recorded_ticks = static_cast<std::int64_t>(recorded.samples.size());
  std::span<const recording::DatagramRow> datagrams(recorded.datagrams);
  std::int64_t last_step_ns = recorded.samples.front().now_ns;
  Sample sample;
  for (std::size_t k = 0; k < recorded.samples.size(); ++k) {
    const Sample& row = recorded.samples[k];
    std::size_t count = 0;
    while (count < datagrams.size() && datagrams[count].tick <= row.tick) ++count;
    const auto rows = datagrams.first(count);
    datagrams = datagrams.subspan(count);
    result.ended = why_it_ends(recorded, k, unknown_from, rows);
    if (result.ended.empty() && row.sent_ns != 0 &&
        stepped.contains(static_cast<std::uint64_t>(row.commands_sent))) {
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

    loop.send_as_recorded(row.sent_ns != 0);
    device.set(row);
    wire.begin_tick(row.now_ns, rows);
    loop.tick(row.now_ns, row.dt_s, sample);
    if (logs_steps) {
      link::LoggedStep step =
          link::logged_step(loop.trace().tip_target_pos_w_nm, step_flags(recorded, row, sample), row.dt_s);
      step.dt_ns = loop.step().dt_ns;
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
