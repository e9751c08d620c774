#pragma once

#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/companding.h"
#include "telenano/common/control/local_slave.h"
#include "telenano/master/device/intended_motion.h"

namespace telenano::app {

/// The attraction at a height, before contact, on the way in.
struct FarForce {
  double height_nm = 0;  ///< of the hand's target over the surface
  double pull_nn = 0;
  double shown_nn = 0;  ///< companded
};

/// What a press and the retract after it would find on a sample, before a session.
struct TouchForecast {
  bool touched = false;
  double push_nn = 0;            ///< greatest force on the tip away from the sample
  std::vector<FarForce> way_in;  ///< from the start to the first contact
  double pull_off_nn = 0;        ///< greatest force towards it on the way back; 0: it does not adhere
};

/// Lets the slave make the task `indent` with the tip's target itself, without a hand's compliance: a hand
/// that gives way presses less deep, so that `push_nn` is about the most. Its state is another one then.
TouchForecast forecast_touch(control::LocalSlave& slave, device::TaskOptions task, const Vec3& start_w_nm,
                             double surface_z_w_nm, double rate_hz,
                             const control::CompandingConfig& companding = {});

/// How much of the attraction before contact a hand can tell.
struct Noticed {
  double most_n = 0;       ///< greatest
  double from_nm = 0;      ///< height at which a hand begins to notice it (control::kNoticedForceN); 0: never
  double differences = 0;  ///< just noticeable ones between there and the greatest, each of kForceJnd
};
/// About what a hand tells of two forces, over the force: 10 % in experiments with fingers at 2 to 5 N, 7 to
/// 10 % elsewhere in the literature; more near the threshold. An assumption.
inline constexpr double kForceJnd = 0.1;
Noticed noticed(const std::vector<FarForce>& way_in, double n_per_nn, bool companded);

}  // namespace telenano::app
