#pragma once

#include <limits>
#include <optional>
#include <string>

#include "telenano/common/base/vec3.h"
#include "telenano/master/device/device_map.h"

namespace telenano::app {

/// What a person's push said of a device's axes. Pure.
struct Push {
  std::string axis;     ///< e.g. "+y"; empty when it cannot be told
  std::string problem;  ///< then why, one line
};

/// The device axis along which a push went that is so long in the device's frame. It must be at least
/// `shortest_m` long and at least twice as far along its axis as along any other.
Push judge_push(const Vec3& displacement_d_m, double shortest_m);

/// The box that a handle has been moved through.
class ReachedBox {
 public:
  void add(const Vec3& pos_d_m) noexcept {
    if (!is_finite(pos_d_m)) return;
    min_ = min_.cwiseMin(pos_d_m);
    max_ = max_.cwiseMax(pos_d_m);
  }
  Vec3 centre_d_m() const noexcept { return 0.5 * (min_ + max_); }
  /// Half the edge of the largest cube in it.
  double half_m() const noexcept { return 0.5 * (max_ - min_).minCoeff(); }

 private:
  static constexpr double kFar = std::numeric_limits<double>::infinity();
  Vec3 min_{kFar, kFar, kFar};
  Vec3 max_{-kFar, -kFar, -kFar};
};

/// The part of a station file that says so. `box` null: the workspace was not asked for.
std::string calibration_toml(const std::string& kind, const device::AxisMap& axes, const ReachedBox* box);

}  // namespace telenano::app
