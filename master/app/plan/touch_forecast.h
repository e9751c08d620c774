#pragma once

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/local_slave.h"
#include "telenano/master/device/intended_motion.h"

namespace telenano::app {

/// What a press and the retract after it would find on a sample, before a session.
struct TouchForecast {
  bool touched = false;
  double push_nn = 0;      ///< greatest force on the tip away from the sample
  double pull_off_nn = 0;  ///< greatest force towards it on the way back; 0: it does not adhere
};

/// Lets the slave make the task `indent` with the tip's target itself, without a hand's compliance: a hand
/// that gives way presses less deep, so that `push_nn` is about the most. Its state is another one then.
TouchForecast forecast_touch(control::LocalSlave& slave, device::TaskOptions task, const Vec3& start_w_nm,
                             double surface_z_w_nm, double rate_hz);

}  // namespace telenano::app
