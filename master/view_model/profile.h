#pragma once

#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/view_model/camera.h"
#include "telenano/master/view_model/ground.h"

namespace telenano::view_model {

/// The surface along a straight line between two places, as it is drawn: marks that have not been fetched are
/// not in it.
struct Profile {
  struct Point {
    double along_nm = 0;  ///< from the first place, level
    Vec3 pos_w_nm = Vec3::Zero();
  };
  std::vector<Point> points;  ///< at least two, evenly
  double lowest_w_nm = 0;
  double highest_w_nm = 0;

  const Vec3& from_w_nm() const noexcept { return points.front().pos_w_nm; }
  const Vec3& to_w_nm() const noexcept { return points.back().pos_w_nm; }
  double level_nm() const noexcept { return points.back().along_nm; }  ///< distance, as on a map
  double rise_nm() const noexcept { return to_w_nm().z() - from_w_nm().z(); }
  double straight_nm() const noexcept { return (to_w_nm() - from_w_nm()).norm(); }
};

/// Only x and y of the places count. Twice as many points as the scan has pixels there, at most 2000.
Profile profile_of(const Ground& ground, const Vec3& from_w_nm, const Vec3& to_w_nm);
/// A table (CSV) with what was measured before it.
std::string profile_csv(const Profile& profile);

/// The place on the ground that a perspective camera sees at a pixel of its picture; none: it sees past the
/// ground. Scene coordinates are those about `origin_w_nm` with heights `exaggeration` times taller.
std::optional<Vec3> seen_at(const Ground& ground, const Camera& camera, const Vec3& origin_w_nm,
                            double exaggeration, double x_px, double y_px, double width_px,
                            double height_px) noexcept;

/// Two places, chosen one after the other.
class Measurement {
 public:
  /// The first place, the second, and then none any more.
  void choose(const Vec3& pos_w_nm) noexcept;
  bool any() const noexcept { return chosen_ > 0; }
  /// While the second one is not chosen, it is where `open_end_w_nm` is.
  std::optional<Profile> profile(const Ground& ground, const Vec3& open_end_w_nm) const;

 private:
  int chosen_ = 0;
  Vec3 from_w_nm_ = Vec3::Zero();
  Vec3 to_w_nm_ = Vec3::Zero();
};

}  // namespace telenano::view_model
