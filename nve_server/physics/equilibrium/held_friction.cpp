#include "telenano/nve_server/physics/equilibrium/held_friction.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/renew.h"

namespace telenano::physics {

RubbedContact rubbed_contact(const PotentialSample& at) noexcept {
  RubbedContact c;
  rubbed_contact(at, c);
  return c;
}

void rubbed_contact(const PotentialSample& at, RubbedContact& c) noexcept {
  renew(c);
  const ContactJet& place = at.place;
  const double steepness = place.overlap_grad.norm();
  if (!(steepness > 0.0)) return;
  const double per = 1.0 / steepness;
  c.normal = -per * place.overlap_grad;
  // −(1 − n nᵀ) ∇∇δ/|∇δ|
  const Vec3 along = place.overlap_hess_per_nm * c.normal;
  c.turn = per * (c.normal * along.transpose() - place.overlap_hess_per_nm);
  c.load = at.law.force_nn * steepness + at.other_load_nn;
  c.load_grad = steepness * (at.law.stiffness_n_m * place.overlap_grad +
                             at.law.mixed_nn * place.log_radius_grad_per_nm) +
                at.other_load_grad_n_m - at.law.force_nn * along;  // ∇|∇δ| = −∇∇δ n
  if (!(at.size.square_nm2 > 0.0)) return;
  c.radius = std::sqrt(at.size.square_nm2);
  c.radius_grad = (at.size.by_overlap_nm * place.overlap_grad +
                   at.size.by_log_radius_nm2 * place.log_radius_grad_per_nm) /
                  (2.0 * c.radius);
}

Mat3 rubbing_tangent(const RubbedContact& c, const FrictionStep& rub, const Vec3& moved) noexcept {
  return rub.stiffness_n_m - rub.force_per_radius_w_n_m * c.radius_grad.transpose() -
         rub.force_per_load_w * c.load_grad.transpose() +
         c.normal * (c.turn.transpose() * rub.force_w_nn).transpose() -
         c.normal.dot(moved) * (rub.stiffness_n_m * c.turn);
}

HeldFriction::HeldFriction(const FrictionState& bristle, const Vec3& from, double limit_nn,
                           bool broken) noexcept
    : stiffness_(bristle.stiffness_n_m),
      from_(from),
      extension_(bristle.extension_w_nm),
      across_(Mat3::Identity() - bristle.normal_w * bristle.normal_w.transpose()) {
  limit_ = broken ? limit_nn : std::max(limit_nn, stiffness_ * extension_.norm());
}

double HeldFriction::energy_aj(const Vec3& apex) const noexcept {
  if (!active()) return 0;
  const double e = extension(apex).norm();
  if (stiffness_ * e <= limit_) return 0.5 * stiffness_ * e * e;
  return limit_ * (e - 0.5 * limit_ / stiffness_);
}

Vec3 HeldFriction::force_nn(const Vec3& apex) const noexcept {
  if (!active()) return Vec3::Zero();
  const Vec3 e = extension(apex);
  const double length = e.norm();
  return stiffness_ * length <= limit_ ? Vec3(-stiffness_ * e) : Vec3(-(limit_ / length) * e);
}

Mat3 HeldFriction::stiffness_n_m(const Vec3& apex) const noexcept {
  if (!active()) return Mat3::Zero();
  const Vec3 e = extension(apex);
  const double length = e.norm();
  if (stiffness_ * length <= limit_) return stiffness_ * across_;
  return (limit_ / length) * (across_ - (e / length) * (e / length).transpose());
}

double HeldFriction::broken_aj() const noexcept {
  const double beyond = stiffness_ * extension_.norm() - limit_;
  return active() && beyond > 0.0 ? 0.5 * beyond * beyond / stiffness_ : 0.0;
}

Vec3 HeldFriction::slipped(const Vec3& apex, double& dissipated_aj) const noexcept {
  dissipated_aj = 0;
  Vec3 e = extension(apex);
  const double length = e.norm();
  const double longest = limit_ / stiffness_;
  if (length > longest) {
    dissipated_aj = limit_ * (length - longest);
    e *= longest / length;
  }
  return e;
}

}  // namespace telenano::physics
