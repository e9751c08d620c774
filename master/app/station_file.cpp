#include "telenano/master/app/station_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/common/link/recent_commands.h"

namespace telenano::app {
namespace {

using config::between;
using config::positive;
using config::TomlTable;

constexpr std::string_view kOwnHand = "hand";

void read_scaling(const TomlTable& table, StationFile& file) {
  file.scaling.velocity = table.optional_number("velocity", between(1e-12, 1));
  file.scaling.force = table.optional_number("force", between(1, 1e12));
}

void read_workspaces(const TomlTable& table, Workspaces& workspaces) {
  workspaces.haptic_m = table.optional_number("haptic_m", between(1e-3, 10));
  workspaces.visual_m = table.optional_number("visual_m", between(1e-3, 100));
  workspaces.nano_nm = table.optional_number("nano_nm", between(1e-3, 1e9));
}

void read_control(const TomlTable& table, StationFile& file) {
  station::StationConfig& station = file.station;
  const std::string method = table.text_or("method", "auto");
  try {
    file.choose(method);
  } catch (const std::exception& error) {
    table.fail("method", error.what());
  }
  const std::string damper = table.text_or("damper", "along-motion");
  if (damper != "along-motion" && damper != "per-axis")
    table.fail("damper", "expected \"along-motion\" or \"per-axis\"");
  station.damper =
      damper == "per-axis" ? control::DamperDirection::kPerAxis : control::DamperDirection::kAlongMotion;
  station.store_max_j = table.number_or("store_max_j", between(1e-3, 1e6), station.store_max_j);
  station.leak_time_s = table.number_or("leak_time_s", between(0, 1e6), station.leak_time_s);
  station.allowance_j = table.number_or("allowance_j", between(1e-6, 1), station.allowance_j);
  station.well_max_j = table.number_or("well_max_j", between(0, 10), station.well_max_j);
  station.guaranteed_velocity_m_s =
      table.number_or("guaranteed_velocity_m_s", between(0.01, 5), station.guaranteed_velocity_m_s);
}

void read_limits(const TomlTable& table, station::StationConfig& station) {
  station.trip_velocity_m_s =
      table.number_or("trip_velocity_m_s", between(0.01, 5), station.trip_velocity_m_s);
  station.force_safety = table.number_or("force_safety", between(0.01, 1), station.force_safety);
  station.slew_n_s = table.number_or("slew_n_s", between(1, 1e6), station.slew_n_s);
  station.stale_hold_s = table.number_or("stale_hold_s", between(0, 0.020), station.stale_hold_s);
  station.stale_zero_s = table.number_or("stale_zero_s", positive(0.100), station.stale_zero_s);
  station.force_age_s = table.number_or("force_age_s", between(0, 10), station.force_age_s);
  station.engage_ramp_s = table.number_or("engage_ramp_s", between(0.01, 10), station.engage_ramp_s);
  station.require_deadman = table.boolean_or("require_deadman", station.require_deadman);
}

/// The names between the commas; blanks beside them do not count.
std::vector<std::string_view> names_of(std::string_view list) {
  std::vector<std::string_view> names;
  for (std::size_t at = 0; at <= list.size();) {
    const std::size_t end = std::min(list.find(',', at), list.size());
    std::string_view name = list.substr(at, end - at);
    while (name.starts_with(' ')) name.remove_prefix(1);
    while (name.ends_with(' ')) name.remove_suffix(1);
    names.push_back(name);
    at = end + 1;
  }
  return names;
}

void read_companding(const TomlTable& table, StationFile& file) {
  control::CompandingConfig& companding = file.station.companding;
  companding.gain = table.number_or("gain", between(1, station::kCompandingGainMax), companding.gain);
  companding.energy_aj = table.number_or("energy_aj", between(1e-3, 1e4), companding.energy_aj);
  file.companding_tasks = table.text_or("tasks", file.companding_tasks);
  for (const std::string_view name : names_of(file.companding_tasks)) {
    if (name == "all" || name == kOwnHand) continue;
    try {
      device::parse_task(name);
    } catch (const std::exception&) {
      table.fail("tasks", "'" + std::string(name) +
                              "' is unknown; expected all, or some of position, contact, indent, scan, "
                              "script, hand, separated by commas");
    }
  }
}

void read_simulated_device(const TomlTable& table, device::PlantConfig& plant) {
  plant.device_mass_kg = table.number_or("mass_kg", between(1e-3, 100), plant.device_mass_kg);
  plant.device_damping_n_s_m = table.number_or("damping_n_s_m", between(0, 1000), plant.device_damping_n_s_m);
  plant.coulomb_friction_n = table.number_or("coulomb_friction_n", between(0, 100), plant.coulomb_friction_n);
  plant.force_max_n = table.number_or("force_max_n", between(0.01, 1000), plant.force_max_n);
  plant.force_quantum_n = table.number_or("force_quantum_n", between(0, 1), plant.force_quantum_n);
  plant.position_quantum_m =
      table.number_or("position_quantum_m", between(0, 1e-3), plant.position_quantum_m);
}

void read_hand(const TomlTable& table, device::PlantConfig& plant) {
  plant.arm_mass_kg = table.number_or("arm_mass_kg", between(1e-3, 1000), plant.arm_mass_kg);
  plant.arm_stiffness_n_m = table.number_or("arm_stiffness_n_m", between(0, 1e5), plant.arm_stiffness_n_m);
  plant.arm_damping_n_s_m = table.number_or("arm_damping_n_s_m", between(0, 1e4), plant.arm_damping_n_s_m);
  plant.grip_stiffness_n_m = table.number_or("grip_stiffness_n_m", between(0, 1e6), plant.grip_stiffness_n_m);
  plant.grip_damping_n_s_m = table.number_or("grip_damping_n_s_m", between(0, 1e4), plant.grip_damping_n_s_m);
}

void read_link(const TomlTable& table, StationFile& file) {
  using Mode = link::PlayoutConfig::Mode;
  link::PlayoutConfig& playout = file.link.playout;
  const std::string mode = table.text_or("playout", "newest");
  if (mode != "newest" && mode != "constant" && mode != "adaptive")
    table.fail("playout", "expected \"newest\", \"constant\" or \"adaptive\"");
  playout.mode = mode == "constant" ? Mode::kConstant : mode == "adaptive" ? Mode::kAdaptive : Mode::kNewest;
  const auto ns = [](double ms) { return std::llround(ms * 1e6); };
  playout.delay_ns = ns(
      table.number_or("playout_delay_ms", between(0.1, 500), static_cast<double>(playout.delay_ns) * 1e-6));
  file.send_hz = table.number_or("send_hz", between(0, 8000), file.send_hz);
  file.redundancy = static_cast<int>(table.integer_or("redundancy", 0, link::kMaxRecent, file.redundancy));
  link::SendGateConfig& gate = file.link.gate;
  gate.deadband_nm = table.number_or("deadband_nm", between(0, 1e6), gate.deadband_nm);
  gate.deadband_n = table.number_or("deadband_n", between(0, 1e3), gate.deadband_n);
  loop::ReplyDeadbandConfig& replies = file.link.reply_deadband;
  replies.permille =
      table.number_or("reply_deadband_permille", between(0, kReplyDeadbandMost_permille), replies.permille);
  replies.floor_n = table.number_or("reply_deadband_n", between(0, 1), replies.floor_n);
  // A command asks for a reply: without the heartbeat the force would go stale (20 ms) while nothing moves.
  gate.heartbeat_ns =
      ns(table.number_or("heartbeat_ms", between(1, 10), static_cast<double>(gate.heartbeat_ns) * 1e-6));
}

void read_task(const TomlTable& table, device::TaskOptions& task) {
  const auto height = between(0, 1e6);
  task.duration_s = table.number_or("duration_s", between(0.1, 86'400), task.duration_s);
  task.hover_low_nm = table.number_or("hover_low_nm", height, task.hover_low_nm);
  task.hover_high_nm = table.number_or("hover_high_nm", height, task.hover_high_nm);
  if (task.hover_high_nm < task.hover_low_nm) table.fail("hover_high_nm", "expected at least hover_low_nm");
  task.depth_nm = table.number_or("depth_nm", height, task.depth_nm);
  task.contact_depth_nm = table.number_or("contact_depth_nm", between(-1e6, 1e6), task.contact_depth_nm);
  task.retract_nm = table.number_or("retract_nm", height, task.retract_nm);
  task.scan_size_nm = table.number_or("scan_size_nm", height, task.scan_size_nm);
  task.scan_lines = static_cast<int>(table.integer_or("scan_lines", 1, 10'000, task.scan_lines));
}

StationFile read(const config::TomlDocument& document) {
  StationFile file;
  file.text = document.content();
  const TomlTable root = document.root();
  file.station.rate_hz = root.number_or("rate_hz", between(10, 8000), file.station.rate_hz);
  if (const auto table = root.optional_table("scaling")) read_scaling(*table, file);
  if (const auto table = root.optional_table("workspaces")) read_workspaces(*table, file.workspaces);
  if (const auto table = root.optional_table("control")) read_control(*table, file);
  if (const auto table = root.optional_table("companding")) read_companding(*table, file);
  if (const auto table = root.optional_table("limits")) read_limits(*table, file.station);
  if (const auto table = root.optional_table("link")) read_link(*table, file);
  if (const auto table = root.optional_table("device")) {
    file.device = read_device_settings(*table);
    if (file.device.damping_n_s_m) file.station.device_damping_n_s_m = *file.device.damping_n_s_m;
    if (file.device.latency_ms) file.station.device_latency_s = 1e-3 * *file.device.latency_ms;
  }
  if (const auto table = root.optional_table("pedal")) file.pedal = read_pedal_settings(*table);
  if (const auto table = root.optional_table("simulated_device")) {
    read_simulated_device(*table, file.plant);
  }
  if (const auto table = root.optional_table("hand")) read_hand(*table, file.plant);
  if (const auto table = root.optional_table("task")) read_task(*table, file.task);
  document.finish();
  finish_station_file(file, document.path());
  return file;
}

}  // namespace

control::CompandingConfig companding_of(const StationFile& file, std::string_view task) noexcept {
  control::CompandingConfig companding = file.station.companding;
  std::string_view rest = file.companding_tasks;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(','), rest.size());
    std::string_view name = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    while (name.starts_with(' ')) name.remove_prefix(1);
    while (name.ends_with(' ')) name.remove_suffix(1);
    if (name == "all" || name == task) return companding;
  }
  companding.gain = 1;
  return companding;
}

void StationFile::choose(const std::string& method) {
  chooses_method = method == "auto";
  if (chooses_method) return;
  const auto found = control::find_method(method);
  if (!found) throw UserError("method '" + method + "' is unknown; use auto, " + control::method_list());
  station.method = *found;
}

StationFile load_station_file(const std::string& path) {
  return read(config::TomlDocument::load(path));
}

StationFile parse_station_file(std::string content, const std::string& name) {
  return read(config::TomlDocument::parse(std::move(content), name));
}

std::vector<std::pair<std::string, std::string>> describe(const station::StationConfig& station,
                                                          const device::PlantConfig& plant) {
  std::vector<std::pair<std::string, std::string>> list;
  const auto add = [&](const char* key, double value) {
    std::array<char, 40> text{};
    std::snprintf(text.data(), text.size(), "%.17g", value);
    list.emplace_back(key, text.data());
  };
  add("rate_hz", station.rate_hz);
  add("scaling.velocity", station.scaling.velocity);
  add("scaling.force", station.scaling.force);
  list.emplace_back("control.method", control::method_name(station.method));
  list.emplace_back("control.damper",
                    station.damper == control::DamperDirection::kPerAxis ? "per-axis" : "along-motion");
  add("control.leak_time_s", station.leak_time_s);
  add("control.store_max_j", station.store_max_j);
  add("control.allowance_j", station.allowance_j);
  add("control.well_max_j", station.well_max_j);
  add("control.guaranteed_velocity_m_s", station.guaranteed_velocity_m_s);
  add("companding.gain", station.companding.gain);
  add("companding.energy_aj", station.companding.energy_aj);
  add("limits.trip_velocity_m_s", station.trip_velocity_m_s);
  add("limits.force_safety", station.force_safety);
  add("limits.slew_n_s", station.slew_n_s);
  add("limits.stale_hold_s", station.stale_hold_s);
  add("limits.stale_zero_s", station.stale_zero_s);
  add("limits.force_age_s", station.force_age_s);
  add("limits.engage_ramp_s", station.engage_ramp_s);
  list.emplace_back("limits.require_deadman", station.require_deadman ? "true" : "false");
  list.emplace_back("allow_unsafe_scaling", station.allow_unsafe_scaling ? "true" : "false");
  if (station.device_damping_n_s_m >= 0) add("device.damping_n_s_m", station.device_damping_n_s_m);
  if (station.device_latency_s >= 0) add("device.latency_s", station.device_latency_s);
  if (station.impedance_without_twin > 0)
    add("scaling.impedance_without_twin", station.impedance_without_twin);
  add("simulated_device.mass_kg", plant.device_mass_kg);
  add("simulated_device.damping_n_s_m", plant.device_damping_n_s_m);
  add("simulated_device.coulomb_friction_n", plant.coulomb_friction_n);
  add("simulated_device.force_max_n", plant.force_max_n);
  add("simulated_device.force_quantum_n", plant.force_quantum_n);
  add("simulated_device.position_quantum_m", plant.position_quantum_m);
  add("hand.arm_mass_kg", plant.arm_mass_kg);
  add("hand.arm_stiffness_n_m", plant.arm_stiffness_n_m);
  add("hand.arm_damping_n_s_m", plant.arm_damping_n_s_m);
  add("hand.grip_stiffness_n_m", plant.grip_stiffness_n_m);
  add("hand.grip_damping_n_s_m", plant.grip_damping_n_s_m);
  return list;
}

std::vector<std::pair<std::string, std::string>> describe_device(const device::DeviceInfo& info) {
  std::vector<std::pair<std::string, std::string>> list{{"haptic.name", info.name}};
  const auto add = [&](const char* key, double value) {
    std::array<char, 40> text{};
    std::snprintf(text.data(), text.size(), "%.17g", value);
    list.emplace_back(key, text.data());
  };
  add("haptic.force_max_n", info.force_max_n);
  add("haptic.position_quantum_m", info.position_quantum_m);
  add("haptic.damping_n_s_m", info.damping_n_s_m);
  add("haptic.mass_kg", info.mass_kg);
  add("haptic.workspace_radius_m", info.workspace_radius_m);
  list.emplace_back("haptic.has_force", info.has_force ? "true" : "false");
  return list;
}

std::vector<std::pair<std::string, std::string>> describe_link(const StationFile& file) {
  using Mode = link::PlayoutConfig::Mode;
  const link::PlayoutConfig& playout = file.link.playout;
  const link::SendGateConfig& gate = file.link.gate;
  const auto text = [](double value) {
    std::array<char, 40> buffer{};
    std::snprintf(buffer.data(), buffer.size(), "%.17g", value);
    return std::string(buffer.data());
  };
  const char* const mode = playout.mode == Mode::kConstant   ? "constant"
                           : playout.mode == Mode::kAdaptive ? "adaptive"
                                                             : "newest";
  std::vector<std::pair<std::string, std::string>> list = {{"link.playout", mode}};
  if (playout.mode != Mode::kNewest)
    list.emplace_back("link.playout_delay_ms", text(static_cast<double>(playout.delay_ns) * 1e-6));
  list.emplace_back("link.send_hz", text(file.send_hz));
  list.emplace_back("link.redundancy", text(file.redundancy));
  list.emplace_back("link.deadband_nm", text(gate.deadband_nm));
  list.emplace_back("link.deadband_n", text(gate.deadband_n));
  const loop::ReplyDeadbandConfig& replies = file.link.reply_deadband;
  list.emplace_back("link.reply_deadband", replies.adapts ? "adapts" : "kept");
  list.emplace_back("link.reply_deadband_permille", text(replies.permille));
  list.emplace_back("link.reply_deadband_n", text(replies.floor_n));
  list.emplace_back("link.step_pace_ms", text(static_cast<double>(file.link.step_pace_ns) * 1e-6));
  if (gate.enabled())
    list.emplace_back("link.heartbeat_ms", text(static_cast<double>(gate.heartbeat_ns) * 1e-6));
  return list;
}

void finish_station_file(StationFile& file, const std::string& source) {
  if (file.scaling.velocity) file.station.scaling.velocity = *file.scaling.velocity;
  if (file.scaling.force) file.station.scaling.force = *file.scaling.force;
  file.station.validate(source);
  // Two heartbeats within the time that a force is held, whatever the file allows for that.
  const double hold_ms = file.station.stale_hold_s * 1e3;
  if (file.link.gate.enabled() && static_cast<double>(file.link.gate.heartbeat_ns) * 1e-6 > hold_ms / 2) {
    throw UserError(source +
                    ": [link] heartbeat_ms must be at most half of [limits] stale_hold_s, or the force "
                    "goes stale while nothing moves");
  }
  if (file.send_hz != 0 && !(file.send_hz >= 20 && file.send_hz <= file.station.rate_hz)) {
    throw UserError(
        source + ": send_hz must be 0 (as many datagrams as the link carries), or 20 up to the loop's rate");
  }
  link::RateControlConfig& rate = file.link.rate;
  rate.adapts = file.send_hz == 0;
  rate.full_hz = rate.adapts ? file.station.rate_hz : file.send_hz;
  rate.redundancy = static_cast<std::size_t>(file.redundancy);
  loop::ReplyDeadbandConfig& replies = file.link.reply_deadband;
  replies.adapts = !file.kept_reply_deadband_permille;
  if (file.kept_reply_deadband_permille) replies.permille = *file.kept_reply_deadband_permille;
  file.link.playout.rate_hz = file.station.rate_hz;
  file.plant.period_s = 1 / file.station.rate_hz;
  file.plant.validate();
}

}  // namespace telenano::app
