#pragma once

#include "telenano/common/base/vec3.h"

namespace telenano::afm {

/// How far the tip may go near the sample while nothing new is read of the force across, whatever stands in
/// its way.
///
/// The force on a tip that is led by its base through springs K (lever, tip and contact), over ground of any
/// shape: with the ground's energy U, F(b) = K (b − p) where K (b − p) = U'(p), so
///
///   dF/db = K − K (K + U'')⁻¹ K ≤ K,
///
/// since K + U'' is positive in a stable balance: along any direction no wall is stiffer than K. (A jump
/// leads to less of the force that has driven it.) Where there is nothing but contact also dF/db ≥ 0, and then
/// between two axes |dF_i/db_j| ≤ √(K_i K_j)/2, which is what a plane gives whose slope is √(K_i/K_j). With K
/// across the same along both axes, K_z the lever's stiffness, and the base within a box since the beginning
/// of the window of the newest reading R of the force against σx:
///
///   R' ≤ R + K max(0, σx' − min σx) + K/2 |Δy| + √(K K_z)/2 max(0, max z − z')
///
/// and the base goes only where that is at most what is allowed, less what noise and curvature of the contact
/// may add (kPart). What no signal shows, the force along the lever, grows by no more than this between
/// two readings; what it sums to is not known.
class AcrossRule {
 public:
  struct Limits {
    double lever_n_m = 40;    ///< K_z
    double across_n_m = 400;  ///< K
    double force_max_nn = 200;
  };
  /// Where the base was, from the beginning of the window of the newest reading on.
  struct Since {
    Vec3 low_w_nm = Vec3::Zero();
    Vec3 high_w_nm = Vec3::Zero();
    double force_x_nn = 0;  ///< that reading
  };
  explicit AcrossRule(const Limits& limits) noexcept;

  /// The part of `move`, across, that may be made from there.
  Vec3 allowed(const Vec3& base_w_nm, const Vec3& move_w_nm, const Since& since) const noexcept;
  /// How far the base must go along x because the reading itself shows more than is allowed: away from what
  /// pushes. 0 if it need not.
  double back_nm(const Vec3& base_w_nm, const Since& since) const noexcept;
  /// How deep the base may go there, where it stands at least.
  double lowest_nm(const Vec3& base_w_nm, const Since& since) const noexcept;
  /// What the base rises by for each nanometre across, so that the force down does not grow.
  double slope() const noexcept { return over_z_n_m_ / limits_.lever_n_m; }
  /// The reading leaves less than half.
  bool held(const Since& since) const noexcept;

  static constexpr double kPart = 0.8;  ///< of the limit
  static constexpr double kAcrossPart =
      0.75;  ///< of what is left, for moves across; any of it for those down

 private:
  double most_nn() const noexcept { return kPart * limits_.force_max_nn; }
  /// Of the bound above for side σ, without the way down.
  double across_nn(double side, const Vec3& at, const Since& since) const noexcept;

  Limits limits_;
  double over_z_n_m_;
};

}  // namespace telenano::afm
