#pragma once

#include <string>

#include "telenano/common/config/slave_limits_file.h"
#include "telenano/common/control/scaling_plan.h"
#include "telenano/common/link/messages.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::app {

/// What a Welcome says of its slave, as `telenano-nve check --limits` writes it.
config::SlaveLimits slave_limits(const link::Welcome& welcome);

station::SlavePort slave_port(const config::SlaveLimits& slave);

/// All that decides the scaling. Workspaces that the station file leaves out: the device's; a picture of
/// 0.3 m; the largest cube in the slave's workspace, whose edge is its shortest side (the height, along which
/// a sample is felt; sideways the clutch carries the hand further).
control::ScalingPlanInput plan_input(const StationFile& file, const device::DeviceInfo& device,
                                     const config::SlaveLimits& slave, int loop_delay_samples);

/// Which damping of the device a plan and its limit on energy rest on, and who says so: the station file, the
/// simulated device itself, or nobody. One line.
std::string damping_text(const StationFile& file, const device::DeviceInfo& device);

/// The scales that nobody gave, as planned: a given α_v is kept, and the plan is made for it; a given α_F is
/// kept. Changes file.station.scaling. Returns one line that says what was chosen and why, empty when both
/// were given. Throws UserError, with the reason, when no force scale is safe and none was given.
std::string choose_scaling(StationFile& file, const device::DeviceInfo& device,
                           const config::SlaveLimits& slave, int loop_delay_samples);

}  // namespace telenano::app
