#include "telenano/master/app/plan/station_plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/master/device/sim_device.h"

namespace telenano::app {
namespace {

/// A slave of which no two numbers are the same.
link::Welcome welcome() {
  link::Welcome w;
  const std::string name = "a sample";
  std::copy(name.begin(), name.end(), w.scene_name.text.begin());
  w.scene_hash = 0x0123456789abcdef;
  w.workspace_min_w_nm = Vec3(-100, -200, -50);
  w.workspace_max_w_nm = Vec3(110, 220, 60);
  w.start_pos_w_nm = Vec3(1, 2, 20);
  w.surface_z_w_nm = 3;
  w.force_max_nn = 300;
  w.coupling_stiffness_n_m = 15;
  w.coupling_damping_n_s_m = 0.004;
  w.slave_rate_max_hz = 4000;
  return w;
}

TEST(StationPlan, AWelcomeSaysWhatAFileOfLimitsSays) {
  const config::SlaveLimits limits = slave_limits(welcome());
  EXPECT_EQ(limits.scene_name, "a sample");
  EXPECT_EQ(limits.scene_hash, "0123456789abcdef");
  EXPECT_EQ(limits.workspace_min_w_nm, Vec3(-100, -200, -50));
  EXPECT_EQ(limits.workspace_max_w_nm, Vec3(110, 220, 60));
  EXPECT_EQ(limits.start_pos_w_nm, Vec3(1, 2, 20));
  EXPECT_EQ(limits.surface_z_w_nm, 3);
  EXPECT_EQ(limits.force_max_nn, 300);
  EXPECT_EQ(limits.coupling_stiffness_n_m, 15);
  EXPECT_EQ(limits.coupling_damping_n_s_m, 0.004);
  EXPECT_EQ(limits.rate_max_hz, 4000);
  const std::string text = config::slave_limits_text(limits);
  EXPECT_EQ(config::slave_limits_text(config::parse_slave_limits(text, "l.toml")), text);
}

TEST(StationPlan, JoinsStationDeviceAndSlave) {
  StationFile file = parse_station_file(
      "rate_hz = 500\n[control]\nmethod = \"ks\"\n[limits]\nforce_safety = 0.5\n[simulated_device]\n"
      "damping_n_s_m = 3.0\nforce_max_n = 7.0\n",
      "s.toml");
  const device::DeviceInfo device = device::sim_device_info(file.plant);
  control::ScalingPlanInput in = plan_input(file, device, slave_limits(welcome()), 6);
  EXPECT_EQ(in.method, control::Method::kKs);
  EXPECT_EQ(in.plant.device_damping_n_s_m, 3);
  EXPECT_EQ(in.plant.adaptive_damping_n_s_m, 0);
  EXPECT_EQ(in.plant.coupling_stiffness_n_m, 15);
  EXPECT_EQ(in.plant.coupling_damping_n_s_m, 0.004);
  EXPECT_EQ(in.plant.period_s, 0.002);
  EXPECT_EQ(in.plant.delay_samples, 6);
  EXPECT_EQ(in.device_force_max_n, 7);
  EXPECT_EQ(in.force_safety, 0.5);
  EXPECT_EQ(in.tip_force_max_nn, 300);
  EXPECT_EQ(in.haptic_workspace_m, 0.11);  // of an omega.3: 160 mm across, 110 mm high
  EXPECT_EQ(in.visual_workspace_m, 0.3);
  EXPECT_EQ(in.nano_workspace_nm, 110);  // the shortest side
  file.workspaces = {0.05, 0.4, 25.0};
  file.station.device_damping_n_s_m = 1.5;  // what a person knows wins over what the device reports
  in = plan_input(file, device, slave_limits(welcome()), 6);
  EXPECT_EQ(in.plant.device_damping_n_s_m, 1.5);
  EXPECT_EQ(in.haptic_workspace_m, 0.05);
  EXPECT_EQ(in.visual_workspace_m, 0.4);
  EXPECT_EQ(in.nano_workspace_nm, 25);
}

TEST(StationPlan, SaysWhetherTheDampingThatItRestsOnWasStated) {
  StationFile file = parse_station_file("[simulated_device]\ndamping_n_s_m = 3.0\n", "s.toml");
  const device::DeviceInfo device = device::sim_device_info(file.plant);
  const std::string simulated = damping_text(file, device);
  EXPECT_NE(simulated.find("3 N s/m, the simulated device's own"), std::string::npos) << simulated;
  device::DeviceInfo omega = device;
  omega.name = "omega.3";
  const std::string assumed = damping_text(file, omega);
  EXPECT_NE(assumed.find("not measured, 3 N s/m taken"), std::string::npos) << assumed;
  EXPECT_NE(assumed.find("calibrate --dynamics"), std::string::npos) << assumed;
  file = parse_station_file("[device]\ndamping_n_s_m = 0.1\n", "s.toml");
  const std::string stated = damping_text(file, device);
  EXPECT_NE(stated.find("0.1 N s/m, as [device] damping_n_s_m states"), std::string::npos) << stated;
  EXPECT_EQ(stated.find("assumed"), std::string::npos) << stated;
}

TEST(StationPlan, PlansOnlyWhatNobodyGave) {
  const auto chosen = [](const std::string& text, std::string& said) {
    StationFile file = parse_station_file(text, "s.toml");
    said = choose_scaling(file, device::sim_device_info(file.plant), slave_limits(welcome()), 1);
    return file.station.scaling;
  };
  // The device binds at either velocity scale: 0.8·12 N/300 nN. 1e-6 is 110 nm over 110 mm too.
  const double largest = 0.99 * 0.8 * 12 / 300e-9;
  std::string said;
  control::Scaling s = chosen("", said);
  EXPECT_NEAR(s.velocity, 1e-6, 1e-20);
  EXPECT_NEAR(s.force, largest, 1e-12 * largest);
  EXPECT_NE(said.find("the device's force binds"), std::string::npos) << said;
  s = chosen("[scaling]\nvelocity = 5e-7\n", said);
  EXPECT_EQ(s.velocity, 5e-7);
  EXPECT_NEAR(s.force, largest, 1e-12 * largest);
  s = chosen("[scaling]\nforce = 123.0\n", said);
  EXPECT_NEAR(s.velocity, 1e-6, 1e-20);
  EXPECT_EQ(s.force, 123);
  EXPECT_NE(said.find("110 nm of the tip to 110 mm of the hand"), std::string::npos) << said;
  s = chosen("[scaling]\nvelocity = 3e-6\nforce = 123.0\n", said);
  EXPECT_EQ(s.velocity, 3e-6);
  EXPECT_EQ(s.force, 123);
  EXPECT_EQ(said, "");
}

// Where damping and latency were measured the twin is planned for no delay, and the way back to any method with it.
TEST(StationPlan, TheTwinAloneIsPlannedForNoDelayWhereTheDeviceWasMeasured) {
  const auto chosen = [](const std::string& text, control::Method method, std::string& said) {
    StationFile file = parse_station_file(text, "s.toml");
    file.station.method = method;
    said = choose_scaling(file, device::sim_device_info(file.plant), slave_limits(welcome()), 100);
    return file.station;
  };
  const std::string damping = "[device]\ndamping_n_s_m = 0.2\n";
  const std::string measured = damping + "latency_ms = 0.0\n";
  std::string said;
  const auto as_model = chosen(measured, control::Method::kModel, said);
  EXPECT_EQ(as_model.impedance_without_twin, 0);
  EXPECT_EQ(said.find("twin"), std::string::npos) << said;
  const auto unmeasured = chosen(damping, control::Method::kTwin, said);
  EXPECT_EQ(unmeasured.scaling.force, as_model.scaling.force);
  EXPECT_EQ(unmeasured.impedance_without_twin, 0);
  const auto planned = chosen(measured, control::Method::kTwin, said);
  EXPECT_NE(said.find("planned for the twin alone"), std::string::npos) << said;
  EXPECT_GT(planned.scaling.force, 1.7 * as_model.scaling.force) << "2b_c/T besides the spring";
  EXPECT_EQ(planned.impedance_without_twin, as_model.scaling.impedance());
  // A force scale that a person gives is the twin's alone too, and has a way back.
  const auto given =
      chosen("[scaling]\nforce = " + std::to_string(1.5 * as_model.scaling.force) + "\n" + measured,
             control::Method::kTwin, said);
  EXPECT_EQ(given.impedance_without_twin, as_model.scaling.impedance());
  const device::DeviceInfo device = device::sim_device_info({});
  const station::SlavePort port = slave_port(slave_limits(welcome()));
  EXPECT_TRUE(station::check_scaling(given, device, port, 100).safe);
  EXPECT_TRUE(station::check_scaling(planned, device, port, 100).safe);
  auto as_any = given;
  as_any.method = control::Method::kModel;
  EXPECT_FALSE(station::check_scaling(as_any, device, port, 100).safe);
  EXPECT_THROW(parse_station_file("[device]\nlatency_ms = 0.1\n", "s.toml"), UserError);
}

TEST(StationPlan, ChoosesNothingWhereNothingIsSafe) {
  StationFile file = parse_station_file("[device]\ndamping_n_s_m = 0.0\n", "s.toml");
  const device::DeviceInfo device = device::sim_device_info(file.plant);
  try {
    choose_scaling(file, device, slave_limits(welcome()), 1);
    FAIL();
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("no force scale is safe"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("--allow-unsafe-scaling"), std::string::npos) << error.what();
  }
  file.scaling.force = 5;  // given: refused or insisted on elsewhere
  EXPECT_NE(choose_scaling(file, device, slave_limits(welcome()), 1), "");
}

}  // namespace
}  // namespace telenano::app
