#include "telenano/master/app/plan/station_plan.h"

#include <fmt/format.h>

#include <cstring>

#include "telenano/common/base/error.h"
#include "telenano/master/app/devices/device_kinds.h"

namespace telenano::app {

namespace {}  // namespace

config::SlaveLimits slave_limits(const link::Welcome& welcome) {
  const auto& name = welcome.scene_name.text;
  config::SlaveLimits limits;
  limits.scene_name = {name.data(), strnlen(name.data(), name.size())};
  limits.scene_hash = fmt::format("{:016x}", welcome.scene_hash);
  limits.workspace_min_w_nm = welcome.workspace_min_w_nm;
  limits.workspace_max_w_nm = welcome.workspace_max_w_nm;
  limits.start_pos_w_nm = welcome.start_pos_w_nm;
  limits.surface_z_w_nm = welcome.surface_z_w_nm;
  limits.force_max_nn = welcome.force_max_nn;
  limits.coupling_stiffness_n_m = welcome.coupling_stiffness_n_m;
  limits.coupling_damping_n_s_m = welcome.coupling_damping_n_s_m;
  limits.well_aj = welcome.well_aj;
  limits.rate_max_hz = welcome.slave_rate_max_hz;
  return limits;
}

station::SlavePort slave_port(const config::SlaveLimits& slave) {
  return {slave.coupling_stiffness_n_m, slave.coupling_damping_n_s_m, slave.force_max_nn};
}

control::ScalingPlanInput plan_input(const StationFile& file, const device::DeviceInfo& device,
                                     const config::SlaveLimits& slave, int loop_delay_samples) {
  const station::StationConfig& station = file.station;
  control::ScalingPlanInput input;
  input.method = station.method;
  input.plant.device_damping_n_s_m =
      station.device_damping_n_s_m < 0 ? device.damping_n_s_m : station.device_damping_n_s_m;
  input.plant.coupling_stiffness_n_m = slave.coupling_stiffness_n_m;
  input.plant.coupling_damping_n_s_m = slave.coupling_damping_n_s_m;
  input.plant.period_s = 1 / station.rate_hz;
  input.plant.delay_samples = loop_delay_samples;
  input.device_latency_s = station.device_latency_s;
  input.device_force_max_n = device.force_max_n;
  input.force_safety = station.force_safety;
  input.tip_force_max_nn = slave.force_max_nn;
  input.haptic_workspace_m = file.workspaces.haptic_m.value_or(2 * device.workspace_radius_m);
  input.visual_workspace_m = file.workspaces.visual_m.value_or(input.visual_workspace_m);
  input.nano_workspace_nm =
      file.workspaces.nano_nm.value_or((slave.workspace_max_w_nm - slave.workspace_min_w_nm).minCoeff());
  return input;
}

std::string damping_text(const StationFile& file, const device::DeviceInfo& device) {
  const double stated_n_s_m = file.station.device_damping_n_s_m;
  if (stated_n_s_m >= 0) {
    return fmt::format(
               "device damping: {:g} N s/m, as [device] damping_n_s_m states; the limit on energy holds for "
               "a "
               "device with at least that",
               stated_n_s_m) +
           (file.station.device_latency_s >= 0
                ? fmt::format("; its force acts at most {:g} ms late, as latency_ms states",
                              1e3 * file.station.device_latency_s)
                : "");
  }
  if (device.name == device_name(DeviceKind::kSim))
    return fmt::format("device damping: {:g} N s/m, the simulated device's own", device.damping_n_s_m);
  return fmt::format(
      "device damping: not measured, {:g} N s/m taken as the least that is plausible; telenano-master "
      "calibrate --dynamics measures it for [device] damping_n_s_m, which mostly makes the touch stronger",
      device.damping_n_s_m);
}

namespace {

/// Where the twin alone is planned for: the scale of what follows when there is no twin any more.
void plan_way_back(StationFile& file, control::ScalingPlanInput input) {
  station::StationConfig& station = file.station;
  if (station.method != control::Method::kTwin || station.device_latency_s < 0) return;
  input.method = control::Method::kModel;
  input.velocity_scale = station.scaling.velocity;
  const control::ScalingPlan without = control::plan_scaling(input);
  const double impedance = without.scaling.impedance();
  if (impedance < station.scaling.impedance() && without.scaling.force >= station::kForceScaleMin)
    station.impedance_without_twin = impedance;
}

}  // namespace

std::string choose_scaling(StationFile& file, const device::DeviceInfo& device,
                           const config::SlaveLimits& slave, int loop_delay_samples) {
  const GivenScaling& given = file.scaling;
  control::ScalingPlanInput input = plan_input(file, device, slave, loop_delay_samples);
  if (given.velocity && given.force) {
    plan_way_back(file, input);
    return "";
  }
  input.velocity_scale = given.velocity.value_or(0);
  const control::ScalingPlan plan = control::plan_scaling(input);
  control::Scaling& scaling = file.station.scaling;
  scaling.velocity = plan.scaling.velocity;
  if (given.force) {
    plan_way_back(file, input);
    return fmt::format("planned: velocity scale {:.6g}, {:.4g} nm of the tip to {:.4g} mm of the hand",
                       scaling.velocity, input.nano_workspace_nm, 1e3 * input.haptic_workspace_m);
  }
  const std::string reason = control::plan_reason(input, plan);
  if (!(plan.scaling.force >= 1)) {
    throw UserError(reason + "; to insist, give a --force-scale (scaling.force) and --allow-unsafe-scaling");
  }
  scaling.force = plan.scaling.force;
  plan_way_back(file, input);
  file.station.validate("planned scaling");
  return fmt::format("planned: velocity scale {:.6g}, force scale {:.6g}; {}", scaling.velocity,
                     scaling.force, reason);
}

}  // namespace telenano::app
