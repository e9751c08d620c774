#include "master/app/station_config.h"

#include <utility>

#include "common/config/toml_document.h"

namespace telenano::app {
namespace {

using config::at_least;
using config::between;
using config::positive;
using config::TomlTable;

void read_scaling(const TomlTable& table, control::Scaling& scaling) {
  scaling.velocity = table.number_or("velocity", between(1e-12, 1), scaling.velocity);
  scaling.force = table.number_or("force", between(1, 1e12), scaling.force);
}

void read_control(const TomlTable& table, station::StationConfig& station) {
  const std::string method = table.text_or("method", control::method_name(station.method));
  try {
    station.method = control::parse_method(method);
  } catch (const std::exception& error) {
    table.fail("method", error.what());
  }
  station.allowance_j = table.number_or("allowance_j", between(1e-6, 1), station.allowance_j);
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
  station.engage_ramp_s = table.number_or("engage_ramp_s", between(0.01, 10), station.engage_ramp_s);
  station.require_deadman = table.boolean_or("require_deadman", station.require_deadman);
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
  file.content = document.content();
  const TomlTable root = document.root();
  file.station.rate_hz = root.number_or("rate_hz", between(10, 8000), file.station.rate_hz);
  if (const auto table = root.optional_table("scaling")) read_scaling(*table, file.station.scaling);
  if (const auto table = root.optional_table("control")) read_control(*table, file.station);
  if (const auto table = root.optional_table("limits")) read_limits(*table, file.station);
  if (const auto table = root.optional_table("device")) {
    const auto damping = table->optional_number("damping_n_s_m", between(0, 1000));
    if (damping) file.station.device_damping_n_s_m = *damping;
  }
  if (const auto table = root.optional_table("simulated_device")) {
    read_simulated_device(*table, file.simulated_device);
  }
  if (const auto table = root.optional_table("hand")) read_hand(*table, file.simulated_device);
  if (const auto table = root.optional_table("task")) read_task(*table, file.task);
  document.finish();
  finish_station_file(file, document.path());
  return file;
}

}  // namespace

StationFile load_station_file(const std::string& path) {
  return read(config::TomlDocument::load(path));
}

StationFile parse_station_file(std::string content, const std::string& name) {
  return read(config::TomlDocument::parse(std::move(content), name));
}

void finish_station_file(StationFile& file, const std::string& source) {
  file.station.validate(source);
  file.simulated_device.period_s = 1 / file.station.rate_hz;
  file.simulated_device.validate();
}

}  // namespace telenano::app
