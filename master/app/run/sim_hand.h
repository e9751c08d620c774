#pragma once

#include <memory>
#include <vector>

#include "telenano/common/control/companding.h"
#include "telenano/common/rt/latest_value.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/app/view/session_view.h"
#include "telenano/master/device/sim_device.h"

namespace telenano::app {

/// The way that --task and its flags ask for, begun so high above the surface. Throws UserError.
device::IntendedMotion intended_motion(const RunOptions& options, device::TaskOptions task_options,
                                       double start_height_nm);

/// Who only looks on holds the hand still for as long as the task takes: one that the scale of the session
/// has no room for must not end an observer.
device::IntendedMotion hand_motion(const RunOptions& options, const device::TaskOptions& task_options,
                                   double start_height_nm, bool only_looks_on);

/// What a person can choose in the window besides the task that the session begins with, which is number 0.
std::vector<SimTask> add_tasks(device::SimDevice& hand, const RunOptions& options,
                               device::TaskOptions task_options, double start_height_nm,
                               const rt::LatestValue<device::PointerState>* pointer);

/// As many as there are tasks.
std::vector<control::CompandingConfig> companding_of_tasks(const StationFile& file,
                                                           const std::vector<SimTask>& tasks);

device::SimDeviceConfig sim_device_config(const StationFile& file, double start_height_nm);

}  // namespace telenano::app
