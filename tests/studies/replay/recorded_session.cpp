#include "tests/studies/replay/recorded_session.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <utility>

#include "telenano/common/base/base64.h"
#include "telenano/common/base/error.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/recording/recording_reader.h"

namespace telenano::studies {
namespace {

using recording::RecordingReader;

std::string text_of(const RecordingReader& reader, const std::string& key) {
  std::string text = reader.configuration(key);
  if (text.empty())
    throw UserError(reader.path().string() + ": does not say '" + key +
                    "'; it was recorded by a program that is too old to be replayed");
  return text;
}

double number_of(const RecordingReader& reader, const std::string& key) {
  return std::strtod(text_of(reader, key).c_str(), nullptr);
}

std::int64_t ns_of_ms(const RecordingReader& reader, const std::string& key, std::int64_t otherwise) {
  const std::string text = reader.configuration(key);
  return text.empty() ? otherwise : std::llround(std::strtod(text.c_str(), nullptr) * 1e6);
}

station::StationConfig station_of(const RecordingReader& reader) {
  station::StationConfig c;
  c.rate_hz = number_of(reader, "rate_hz");
  c.scaling.velocity = number_of(reader, "scaling.velocity");
  c.scaling.force = number_of(reader, "scaling.force");
  c.method = control::parse_method(text_of(reader, "control.method"));
  c.damper = text_of(reader, "control.damper") == "per-axis" ? control::DamperDirection::kPerAxis
                                                             : control::DamperDirection::kAlongMotion;
  c.leak_time_s = number_of(reader, "control.leak_time_s");
  // Before there was a bound.
  constexpr double kUnbounded_j = 1e6;
  const std::string store = reader.configuration("control.store_max_j");
  c.store_max_j = store.empty() ? kUnbounded_j : std::strtod(store.c_str(), nullptr);
  c.allowance_j = number_of(reader, "control.allowance_j");
  if (const std::string well = reader.configuration("control.well_max_j"); !well.empty())
    c.well_max_j = std::strtod(well.c_str(), nullptr);
  if (const std::string gain = reader.configuration("companding.gain"); !gain.empty()) {
    c.companding.gain = std::strtod(gain.c_str(), nullptr);
    c.companding.energy_aj = number_of(reader, "companding.energy_aj");
  }
  c.guaranteed_velocity_m_s = number_of(reader, "control.guaranteed_velocity_m_s");
  c.trip_velocity_m_s = number_of(reader, "limits.trip_velocity_m_s");
  c.force_safety = number_of(reader, "limits.force_safety");
  c.slew_n_s = number_of(reader, "limits.slew_n_s");
  c.stale_hold_s = number_of(reader, "limits.stale_hold_s");
  c.stale_zero_s = number_of(reader, "limits.stale_zero_s");
  if (const std::string age = reader.configuration("limits.force_age_s"); !age.empty())
    c.force_age_s = std::strtod(age.c_str(), nullptr);
  c.engage_ramp_s = number_of(reader, "limits.engage_ramp_s");
  c.require_deadman = text_of(reader, "limits.require_deadman") == "true";
  c.allow_unsafe_scaling = text_of(reader, "allow_unsafe_scaling") == "true";
  if (const std::string damping = reader.configuration("device.damping_n_s_m"); !damping.empty())
    c.device_damping_n_s_m = std::strtod(damping.c_str(), nullptr);
  if (const std::string latency = reader.configuration("device.latency_s"); !latency.empty()) {
    c.device_latency_s = std::strtod(latency.c_str(), nullptr);
    if (const std::string without = reader.configuration("scaling.impedance_without_twin"); !without.empty())
      c.impedance_without_twin = std::strtod(without.c_str(), nullptr);
  }
  return c;
}

device::DeviceInfo device_of(const RecordingReader& reader) {
  device::DeviceInfo info;
  info.name = text_of(reader, "haptic.name");
  info.force_max_n = number_of(reader, "haptic.force_max_n");
  info.position_quantum_m = number_of(reader, "haptic.position_quantum_m");
  info.damping_n_s_m = number_of(reader, "haptic.damping_n_s_m");
  info.mass_kg = number_of(reader, "haptic.mass_kg");
  info.workspace_radius_m = number_of(reader, "haptic.workspace_radius_m");
  info.has_force = text_of(reader, "haptic.has_force") == "true";
  return info;
}

loop::LinkOptions link_of(const RecordingReader& reader) {
  using Mode = link::PlayoutConfig::Mode;
  loop::LinkOptions link;
  const std::string playout = text_of(reader, "link.playout");
  link.playout.mode = playout == "constant"   ? Mode::kConstant
                      : playout == "adaptive" ? Mode::kAdaptive
                                              : Mode::kNewest;
  link.playout.delay_ns = ns_of_ms(reader, "link.playout_delay_ms", link.playout.delay_ns);
  link.gate.deadband_nm = number_of(reader, "link.deadband_nm");
  link.gate.deadband_n = number_of(reader, "link.deadband_n");
  link.gate.heartbeat_ns = ns_of_ms(reader, "link.heartbeat_ms", link.gate.heartbeat_ns);
  // One that adapts is none while a recording is made.
  if (reader.configuration("link.reply_deadband") == "kept") {
    link.reply_deadband.permille = number_of(reader, "link.reply_deadband_permille");
    link.reply_deadband.floor_n = number_of(reader, "link.reply_deadband_n");
  }
  link.step_pace_ns = ns_of_ms(reader, "link.step_pace_ms", link.step_pace_ns);
  // Of programs that sent one a tick: none.
  if (const std::string send_hz = reader.configuration("link.send_hz"); !send_hz.empty()) {
    const double hz = number_of(reader, "link.send_hz");
    link.rate.adapts = hz == 0;
    link.rate.full_hz = hz == 0 ? number_of(reader, "rate_hz") : hz;
    link.rate.redundancy = static_cast<std::size_t>(number_of(reader, "link.redundancy"));
  }
  return link;
}

}  // namespace

RecordedSession load_session(const std::filesystem::path& path) {
  const RecordingReader reader = RecordingReader::isolated(path);
  if (!reader.has("now_ns") || !reader.has("sent_ns"))
    throw UserError(path.string() +
                    ": was recorded by a program that is too old to be replayed (no column now_ns)");
  if (const std::string before = reader.configuration("continued_from"); !before.empty())
    throw UserError(
        path.string() + ": begins in the middle of a session, which was at the sample '" + before +
        "' before, with an energy account that it does not hold; 'telenano-master replay' repeats the hand's "
        "motion");
  RecordedSession session;
  session.path = path;
  session.scene_name = text_of(reader, "scene_name");
  session.scene_hash = text_of(reader, "scene_hash");
  session.scene_path = reader.configuration("scene_path");
  session.scene_text = reader.configuration("scene_text");
  session.surface_force = reader.configuration("surface.force");
  if (const std::string bundle = reader.configuration("scene_bundle"); !bundle.empty())
    session.scene_bundle = from_base64(bundle).value_or("");
  session.station = station_of(reader);
  session.device = device_of(reader);
  session.link = link_of(reader);
  session.redundancy = static_cast<std::size_t>(number_of(reader, "link.redundancy"));
  session.features = std::strtoull(text_of(reader, "features").c_str(), nullptr, 16);
  session.twin_scene_hash = reader.configuration("twin.scene_hash");
  if (!session.twin_scene_hash.empty()) session.twin_ring_s = number_of(reader, "twin.ring_s");
  session.slave_timeout_ns = std::llround(1e6 * number_of(reader, "slave_timeout_ms"));
  session.samples.resize(reader.rows());
  reader.read_samples(0, session.samples);
  session.datagrams = reader.datagrams();
  for (const recording::Event& event : reader.events()) {
    if (std::strstr(event.text.data(), "twin: apart") != nullptr) session.apart_at.insert(event.tick);
    if (std::strcmp(event.text.data(), "undo of marks asked") == 0) session.undo_after.insert(event.tick);
  }
  for (const recording::DatagramRow& row : session.datagrams) session.tells_of_log |= row.epoch != 0;
  session.state_pieces = reader.state_pieces();
  session.states = states_of(session.state_pieces);
  if (session.samples.empty()) throw UserError(path.string() + ": holds no row");
  return session;
}

std::vector<RecordedState> states_of(const std::vector<recording::StatePieceRow>& pieces) {
  constexpr std::size_t kBytes = recording::StatePieceRow::kBytes;
  constexpr std::size_t kMostBytes = std::size_t{1} << 26;
  std::vector<RecordedState> states;
  RecordedState state;
  std::uint32_t number = 0;
  std::set<std::uint32_t> here;
  for (const auto& piece : pieces) {
    if (piece.snapshot != number) {
      number = piece.snapshot;
      here.clear();
      state = {piece.tick, piece.step, piece.state_hash, piece.breaks, {}};
      state.bytes.resize(std::min<std::size_t>(piece.total, kMostBytes));
    }
    const std::size_t at = std::size_t{piece.piece} * kBytes;
    if (at >= state.bytes.size() || piece.size != std::min(kBytes, state.bytes.size() - at)) continue;
    std::copy_n(piece.data.begin(), piece.size, state.bytes.begin() + static_cast<std::ptrdiff_t>(at));
    here.insert(piece.piece);
    if (here.size() != (state.bytes.size() + kBytes - 1) / kBytes) continue;
    state.tick = piece.tick;
    states.push_back(std::exchange(state, {}));
  }
  return states;
}

StepOrder step_order(const std::vector<recording::DatagramRow>& datagrams) {
  struct Answer {
    std::uint64_t command = 0, before = 0, left_out = 0;
  };
  std::map<std::uint64_t, Answer> replies;  // by their number: the order in which they were sent
  for (const auto& row : datagrams) {
    if (row.type == static_cast<std::uint32_t>(link::MessageType::kReply) && row.sequence != 0)
      replies[row.sequence] = {row.answers, row.steps_before, row.left_out};
  }
  StepOrder order;
  std::uint64_t last_reply = 0, last_command = 0, last_left_out = 0;
  for (const auto& [number, answer] : replies) {
    // Every accepted command has one reply, numbered on from the last, or one that was left out: so many were accepted
    // in between.
    const std::uint64_t accepted =
        number - last_reply - 1 + (std::max(answer.left_out, last_left_out) - last_left_out);
    const std::uint64_t sent = answer.command - last_command - 1;
    std::uint64_t known = 0;
    for (std::uint64_t i = 0; i < 64 && i + 1 < answer.command - last_command; ++i) {
      if ((answer.before >> i & 1) == 0) continue;
      order.commands.insert(answer.command - 1 - i);
      ++known;
    }
    if (accepted == sent) {
      for (std::uint64_t c = last_command + 1; c < answer.command; ++c) order.commands.insert(c);
    } else if (known != accepted && last_reply != 0) {
      order.unknown_from = std::min(order.unknown_from, last_command + 1);
    }
    order.commands.insert(answer.command);
    last_reply = number;
    last_command = answer.command;
    last_left_out = answer.left_out;
  }
  return order;
}

std::uint64_t newest_answered_before(const std::vector<recording::DatagramRow>& datagrams, bool any) {
  if (!any) return 0;
  for (const auto& row : datagrams) {
    if (row.type == static_cast<std::uint32_t>(link::MessageType::kReply) && row.drop == 0)
      return row.answers - 1;
  }
  return UINT64_MAX;
}

}  // namespace telenano::studies
