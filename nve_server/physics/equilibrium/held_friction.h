#pragma once

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/contact/friction.h"
#include "telenano/nve_server/physics/potential/tip_potential.h"

namespace telenano::physics {

/// The contact that friction acts in, and how it changes with the apex.
struct RubbedContact {
  Vec3 normal = Vec3::UnitZ();
  Mat3 turn = Mat3::Zero();
  double radius = 0;
  Vec3 radius_grad = Vec3::Zero();
  double load = 0;
  Vec3 load_grad = Vec3::Zero();
};
RubbedContact rubbed_contact(const PotentialSample& at) noexcept;
/// Into `contact`, in place.
void rubbed_contact(const PotentialSample& at, RubbedContact& contact) noexcept;

/// −∂f/∂p of the bristle after a motion `moved`: not symmetric, since the limit follows the place, and f
/// turns with the normal.
Mat3 rubbing_tangent(const RubbedContact& contact, const FrictionStep& rub, const Vec3& moved) noexcept;

inline double stored_in(const FrictionState& bristle) noexcept {
  return 0.5 * bristle.stiffness_n_m * bristle.extension_w_nm.squaredNorm();
}

/// Friction while a descent lasts: stiffness k and limit T as they are where it begins, which makes it the
/// convex potential k e²/2 up to e = T/k and T e − T²/2k beyond, e the bristle's extension if it did not
/// slip.
class HeldFriction {
 public:
  HeldFriction() = default;  ///< none
  /// From the apex `from`. The limit is at least what the bristle carries, unless it has broken away.
  HeldFriction(const FrictionState& bristle, const Vec3& from_w_nm, double limit_nn, bool broken) noexcept;

  bool active() const noexcept { return stiffness_ > 0.0; }
  double energy_aj(const Vec3& apex_w_nm) const noexcept;
  Vec3 force_nn(const Vec3& apex_w_nm) const noexcept;
  Mat3 stiffness_n_m(const Vec3& apex_w_nm) const noexcept;
  /// What a bristle stretched beyond the limit loses as it breaks away to it.
  double broken_aj() const noexcept;
  /// The extension that is left at `apex`, and what slipping has taken.
  Vec3 slipped(const Vec3& apex_w_nm, double& dissipated_aj) const noexcept;

 private:
  Vec3 extension(const Vec3& apex) const noexcept { return extension_ + across_ * (apex - from_); }

  double stiffness_ = 0;
  double limit_ = 0;
  Vec3 from_ = Vec3::Zero();
  Vec3 extension_ = Vec3::Zero();
  Mat3 across_ = Mat3::Zero();
};

}  // namespace telenano::physics
