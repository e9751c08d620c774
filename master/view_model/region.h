#pragma once

#include <optional>

#include "telenano/common/base/vec3.h"
#include "telenano/master/view_model/ground.h"

namespace telenano::view_model {

/// The part of the sample that the overview shows large: the two-scale view of Kim & Sitti, whose map keeps
/// the whole in sight. A box as wide to its depth as the ground is, inside it.
class Region {
 public:
  static constexpr double kNarrower = 4;     ///< times, each time
  static constexpr double kLeastPixels = 8;  ///< of the scan across; fewer show nothing new

  /// None: the whole.
  const std::optional<MapBox>& box() const noexcept { return box_; }
  /// About a place, kNarrower times narrower than now; false: it would be narrower than `least_nm` or than
  /// kLeastPixels, and it is the whole again.
  bool narrow(const Ground& ground, const Vec3& middle_w_nm, double least_nm) noexcept;
  void whole() noexcept { box_.reset(); }
  /// As wide as it is, about another place. Nothing while it is the whole.
  void move_to(const Ground& ground, const Vec3& middle_w_nm) noexcept;
  /// Once a frame: goes with a tip that leaves it, and stays where a person has moved it away from the tip.
  /// True when it has moved.
  bool follow(const Ground& ground, const Vec3& tip_w_nm) noexcept;

 private:
  std::optional<MapBox> box_;
  bool had_tip_ = false;
};

}  // namespace telenano::view_model
