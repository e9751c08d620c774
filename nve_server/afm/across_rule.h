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
/// may add (kPart). What the force along the lever sums to no signal shows: AlongRule.
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

/// The force along the lever, which no signal shows.
///
/// Why the deflection does not. With the tip's height h over the lever's length L as ρ, a lever of stiffness k
/// without tilt has (probe.h) the apex raised by (F_z + 3/2 ρ F_y)/k, and the photodiode reads, as a force,
/// D = F_z + 2 ρ F_y. Where ball, ground and a step meet, the apex rests, the base keeps its height, and so
/// F_z = F_0 − 3/2 ρ F_y:
///
///   D = F_0 + ρ/2 F_y.
///
/// With ρ = 0.1 that is 8 nN for 160 nN along, and ground that falls or rises by 0.2 nm says the same. On the
/// face of a step alone, of slope m, F_y = −m F_z, D = F_z (1 − 2 ρ m) for a lever that points to the step: of
/// m = 1/(2ρ) nothing is seen at all. So no limit of D, nor of its change, bounds F_y by itself. Two things do.
///
/// Where the operator knows how steep the tip's way can be, m (friction as a slope on top): every contact
/// pushes across by at most m times what it pushes up, all of them together push up with F_z and what adhesion
/// A pulls down, and D shows F_z but for c F_y, c = tan(tilt + arctan 2 ρ):
///
///   |F_y| ≤ m (F_z + A),  F_z ≤ D + c |F_y|   ⇒   |F_y| ≤ m (D + A)/(1 − c m),  c m < 1.
///
/// So |F_y| ≤ P as long as D ≤ (1 − c m) P/m − A. That is a limit of the force down, whichever way the tip
/// comes. Between readings F_z grows by what AfmLogic counts with anyway; a part 1 − c m of it is kept here.
///
/// Where nobody knows: of a wall that faces along the lever the tip feels at most K times the way that its base
/// has come along since there was no wall: since it was higher than any ground. So near the ground
/// the base stays within half of P/K of there (way_nm). That needs no reading, and holds for any height of a
/// step. The other half is for what the wall pushed with already, and for drift along, K times its way.
class AlongRule {
 public:
  struct Limits {
    double across_n_m = 400;  ///< K
    double lateral_max_nn = 200;
    double slope = 0;    ///< m; 0: not known
    double part = 0.45;  ///< c
  };
  explicit AlongRule(const Limits& limits) noexcept : limits_(limits) {}

  bool slope_known() const noexcept { return limits_.slope > 0; }
  /// How far along the base may go near the ground where no slope is known.
  double way_nm() const noexcept { return kWayPart * most_nn() / limits_.across_n_m; }
  /// What may be read of the force down; without end where no slope is known. Negative where what adhesion pulls
  /// is already too much: then the tip must not touch.
  double force_down_nn(double adhesion_nn) const noexcept;
  /// The part of `move_nm`, along, that may be made from `at_nm` where the tip has come down at `from_nm`: always
  /// back, never beyond.
  double allowed_nm(double at_nm, double move_nm, double from_nm) const noexcept;

 private:
  static constexpr double kWayPart = 0.5;
  double most_nn() const noexcept { return AcrossRule::kPart * limits_.lateral_max_nn; }

  Limits limits_;
};

}  // namespace telenano::afm
