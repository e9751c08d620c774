#pragma once

#include <functional>

#include "telenano/master/app/devices/dynamics_text.h"
#include "telenano/master/calibration/dynamics_measurement.h"
#include "telenano/master/device/call_watch.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::app {

/// Measures an open device by small known forces, in a real-time thread when the hand moves by itself, else
/// as fast as it can be simulated. It begins once `is_ready` is true, which is asked again and again and may wait
/// for up to 50 ms; until then the thread shows zero force, so that no watchdog of the device misses it. Null: at once. `calls`: of a device that calls a vendor's library, else null. Tells its
/// progress on standard error, and that the loop is stuck in a call. Throws RunError, one line with what to
/// do, when it was stopped, when the device left its bounds or failed, and when an axis does not pass for one
/// that nobody holds; the device shows no force then. Stopped while a call does not come back, it ends the
/// program.
DeviceDynamics measure_dynamics(device::HapticDevice& device, const device::CallWatch* calls,
                                const calibration::MeasurementConfig& config,
                                const std::function<bool()>& is_ready);

}  // namespace telenano::app
