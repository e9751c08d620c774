#include <gtest/gtest.h>

#include "telenano/common/base/error.h"
#include "telenano/master/app/station_file.h"
#include "tests/source_dir.h"

namespace telenano::app {
namespace {

std::string refusal(const std::string& content) {
  try {
    parse_station_file(content, "station.toml");
  } catch (const UserError& error) {
    return error.what();
  }
  return "";
}

/// The shipped file documents the defaults: reading it changes nothing.
TEST(StationFile, TheShippedFileStatesTheDefaults) {
  const StationFile file = load_station_file(TELENANO_SOURCE_DIR "/deploy/station.toml");
  const StationFile defaults = parse_station_file("", "empty.toml");
  const auto& a = file.station;
  const auto& b = defaults.station;
  EXPECT_EQ(a.rate_hz, b.rate_hz);
  EXPECT_FALSE(file.scaling.velocity || file.scaling.force) << "planned, unless a person says otherwise";
  EXPECT_FALSE(file.workspaces.haptic_m || file.workspaces.visual_m || file.workspaces.nano_nm);
  EXPECT_EQ(a.scaling.velocity, b.scaling.velocity);
  EXPECT_EQ(a.scaling.force, b.scaling.force);
  EXPECT_EQ(a.method, b.method);
  EXPECT_TRUE(file.chooses_method && defaults.chooses_method) << "by the round trip";
  EXPECT_EQ(a.allowance_j, b.allowance_j);
  EXPECT_EQ(a.well_max_j, b.well_max_j);
  EXPECT_EQ(a.store_max_j, b.store_max_j);
  EXPECT_EQ(a.companding.gain, b.companding.gain);
  EXPECT_EQ(a.companding.energy_aj, b.companding.energy_aj);
  EXPECT_EQ(file.companding_tasks, defaults.companding_tasks);
  EXPECT_EQ(a.guaranteed_velocity_m_s, b.guaranteed_velocity_m_s);
  EXPECT_EQ(a.trip_velocity_m_s, b.trip_velocity_m_s);
  EXPECT_EQ(a.force_safety, b.force_safety);
  EXPECT_EQ(a.slew_n_s, b.slew_n_s);
  EXPECT_EQ(a.stale_hold_s, b.stale_hold_s);
  EXPECT_EQ(a.stale_zero_s, b.stale_zero_s);
  EXPECT_EQ(a.force_age_s, b.force_age_s);
  EXPECT_EQ(a.engage_ramp_s, b.engage_ramp_s);
  EXPECT_EQ(a.require_deadman, b.require_deadman);
  EXPECT_EQ(a.device_damping_n_s_m, b.device_damping_n_s_m);
  const auto& p = file.plant;
  const auto& q = defaults.plant;
  EXPECT_EQ(p.device_mass_kg, q.device_mass_kg);
  EXPECT_EQ(p.device_damping_n_s_m, q.device_damping_n_s_m);
  EXPECT_EQ(p.coulomb_friction_n, q.coulomb_friction_n);
  EXPECT_EQ(p.force_max_n, q.force_max_n);
  EXPECT_EQ(p.force_quantum_n, q.force_quantum_n);
  EXPECT_EQ(p.position_quantum_m, q.position_quantum_m);
  EXPECT_EQ(p.arm_mass_kg, q.arm_mass_kg);
  EXPECT_EQ(p.arm_stiffness_n_m, q.arm_stiffness_n_m);
  EXPECT_EQ(p.arm_damping_n_s_m, q.arm_damping_n_s_m);
  EXPECT_EQ(p.grip_stiffness_n_m, q.grip_stiffness_n_m);
  EXPECT_EQ(p.grip_damping_n_s_m, q.grip_damping_n_s_m);
  EXPECT_EQ(file.task.duration_s, defaults.task.duration_s);
  EXPECT_EQ(file.task.hover_low_nm, defaults.task.hover_low_nm);
  EXPECT_EQ(file.task.hover_high_nm, defaults.task.hover_high_nm);
  EXPECT_EQ(file.task.depth_nm, defaults.task.depth_nm);
  EXPECT_EQ(file.task.contact_depth_nm, defaults.task.contact_depth_nm);
  EXPECT_EQ(file.task.retract_nm, defaults.task.retract_nm);
  EXPECT_EQ(file.task.scan_size_nm, defaults.task.scan_size_nm);
  EXPECT_EQ(file.task.scan_lines, defaults.task.scan_lines);
}

TEST(StationFile, CompandsInTheTasksThatItNames) {
  const StationFile file =
      parse_station_file("[companding]\ngain = 4\nenergy_aj = 2.5\ntasks = \"indent, hand\"\n", "a.toml");
  EXPECT_EQ(companding_of(file, "indent").gain, 4);
  EXPECT_EQ(companding_of(file, "indent").energy_aj, 2.5);
  EXPECT_EQ(companding_of(file, "hand").gain, 4);
  EXPECT_EQ(companding_of(file, "scan").gain, 1);
  EXPECT_EQ(companding_of(parse_station_file("[companding]\ngain = 4\n", "a.toml"), "scan").gain, 4);
  EXPECT_NE(refusal("[companding]\ntasks = \"indent, dance\"\n").find("'dance' is unknown"),
            std::string::npos);
  EXPECT_NE(refusal("[companding]\ngain = 0.5\n").find("gain"), std::string::npos);
  EXPECT_NE(refusal("[companding]\ngain = 11\n").find("gain"), std::string::npos);
  EXPECT_NE(refusal("[companding]\nenergy_aj = 0\n").find("energy_aj"), std::string::npos);
}

TEST(StationFile, ReadsWhatItIsTold) {
  const StationFile file = parse_station_file(
      "rate_hz = 2000\n[scaling]\nforce = 1e6\n[control]\nmethod = \"ks\"\ndamper = "
      "\"per-axis\"\n[hand]\narm_mass_kg = "
      "2\n[device]\n"
      "damping_n_s_m = 1.5\n[workspaces]\nnano_nm = 50.0\n",
      "a.toml");
  EXPECT_EQ(file.station.rate_hz, 2000);
  EXPECT_EQ(file.plant.period_s, 0.0005);
  EXPECT_EQ(file.station.scaling.force, 1e6);
  EXPECT_EQ(file.scaling.force, 1e6);
  EXPECT_FALSE(file.scaling.velocity);
  EXPECT_EQ(file.workspaces.nano_nm, 50);
  EXPECT_EQ(file.station.method, control::Method::kKs);
  EXPECT_FALSE(file.chooses_method);
  EXPECT_EQ(file.station.damper, control::DamperDirection::kPerAxis);
  EXPECT_EQ(file.plant.arm_mass_kg, 2);
  EXPECT_EQ(file.station.device_damping_n_s_m, 1.5);
}

/// A recording's list of settings, read as a station file again, says the same.
TEST(StationFile, DescribesEverySettingByItsKey) {
  const StationFile file = parse_station_file("rate_hz = 500\n[scaling]\nforce = 1e6\n", "a.toml");
  for (const auto& [key, value] : describe(file.station, file.plant)) {
    if (key == "allow_unsafe_scaling") continue;  // a flag only
    const auto dot = key.find('.');
    const bool is_text = key == "control.method" || key == "control.damper";
    const std::string quoted = is_text ? '"' + value + '"' : value;
    const std::string line = dot == std::string::npos
                                 ? key + " = " + quoted
                                 : '[' + key.substr(0, dot) + "]\n" + key.substr(dot + 1) + " = " + quoted;
    EXPECT_EQ(refusal(line), "") << line;
  }
}

TEST(StationFile, RefusesMistakesInOneLineThatNamesFileAndKey) {
  const struct {
    const char* content;
    const char* key;
  } cases[] = {
      {"rate_hz = 0\n", "rate_hz"},
      {"rate_hz = nan\n", "rate_hz"},
      {"rate_hz = \"fast\"\n", "rate_hz"},
      {"rate_khz = 1\n", "rate_khz"},
      {"[scaling]\nforce = -1\n", "force"},
      {"[control]\ndamper = \"all\"\n", "per-axis"},
      {"[control]\nmethod = \"KS\"\n", "unknown; use auto, none, ks, "},
      {"[limits]\ntrip_velocity_m_s = 1.0\n", "trip_velocity_m_s"},
      {"[limits]\nstale_zero_s = 0.01\n", "stale_zero_s"},
      {"[limits]\nslew_n = 5\n", "slew_n"},
      {"[task]\nhover_low_nm = 30\n", "hover_high_nm"},
      {"[simulated_device]\nmass_kg = 0\n", "mass_kg"},
      {"[scaling]\nvelocity = nan\n", "velocity"},
      {"[workspaces]\nhaptic_m = 0\n", "haptic_m"},
      {"[workspaces]\nnano_nm = inf\n", "nano_nm"},
      {"[workspaces]\nnano_m = 1\n", "nano_m"},
      {"[hands]\narm_mass_kg = 1\n", "hands"},
      {"rate_hz = \n", "station.toml"},
  };
  for (const auto& bad : cases) {
    const std::string what = refusal(bad.content);
    EXPECT_NE(what.find("station.toml"), std::string::npos) << bad.content << " -> " << what;
    EXPECT_NE(what.find(bad.key), std::string::npos) << bad.content << " -> " << what;
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
  }
  EXPECT_THROW(load_station_file("no/such.toml"), UserError);
}

TEST(StationFile, DeviceSettings) {
  const StationFile none = parse_station_file("", "s.toml");
  EXPECT_EQ(none.device.kind, "sim");
  EXPECT_FALSE(none.device.axes || none.device.serial || none.device.watchdog_ms ||
               none.device.deadman_buttons);
  const StationFile file = parse_station_file(R"(
[device]
kind = "omega"
serial = "4711"
axes = "+x +y +z"
centre_m = [0.01, 0, -0.02]
workspace_half_m = 0.05
deadman_buttons = [0, 3]
clutch_buttons = [1]
stop_buttons = [31]
damping_n_s_m = 1.5
mass_kg = 0.3
force_max_n = 8
watchdog_ms = 20
speed_m_s = 0.1
dead_zone = 0.1
hold_s = 1
)",
                                              "s.toml");
  EXPECT_EQ(file.device.kind, "omega");
  EXPECT_EQ(file.device.serial, "4711");
  EXPECT_EQ(file.device.axes->to_hand(Vec3(1, 2, 3)), Vec3(1, 2, 3));
  EXPECT_EQ(*file.device.centre_m, Vec3(0.01, 0, -0.02));
  EXPECT_EQ(file.device.deadman_buttons, 0b1001u);
  EXPECT_EQ(file.device.stop_buttons, 1u << 31);
  EXPECT_EQ(file.device.watchdog_ms, 20);
  EXPECT_EQ(file.station.device_damping_n_s_m, 1.5);
  std::vector<std::pair<std::string, std::string>> list;
  describe(file.device, list);
  EXPECT_EQ(list.size(), 13u)
      << "a recording tells every setting that was given, and has kind and damping anyway";
}

TEST(StationFile, BadDeviceSettingsAreRefused) {
  const auto expect = [](const std::string& line, const std::string& part) {
    const std::string text = refusal("[device]\n" + line + "\n");
    EXPECT_NE(text.find(part), std::string::npos) << line << " -> " << text;
    EXPECT_NE(text.find("station.toml:2"), std::string::npos) << text;
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
  };
  expect("kind = \"omega3\"", "omega");
  expect("axes = \"+x +y\"", "three device axes");
  expect("axes = \"+x +y +y\"", "twice");
  expect("axes = \"+x +y -z\"", "mirror");
  expect("axes = \"+x y z\"", "expected the device's axis with its sign");
  expect("centre_m = [0, 0]", "centre_m");
  expect("centre_m = [0, 0, 2]", "centre_m");
  expect("watchdog_ms = 32", "31");
  expect("watchdog_ms = -1", "watchdog_ms");
  expect("deadman_buttons = [32]", "deadman_buttons");
  expect("deadman_buttons = [0.5]", "whole");
  expect("speed_m_s = 0", "speed_m_s");
  expect("force_max_n = 0", "force_max_n");
  expect("hold_s = inf", "hold_s");
  expect("watchdog = 10", "watchdog");
  EXPECT_NE(refusal("[device]\ndeadman_buttons = [1]\nstop_buttons = [1]\n").find("two of"),
            std::string::npos);
}

}  // namespace
}  // namespace telenano::app
