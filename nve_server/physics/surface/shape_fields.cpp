#include "telenano/nve_server/physics/surface/shape_fields.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/renew.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {

/// A function of the apex with its derivatives.
struct Field {
  double value = 0;
  Vec3 grad = Vec3::Zero();
  Mat3 hess = Mat3::Zero();
};

Field sum(const Field& a, double factor, const Field& b) noexcept {
  return {a.value + factor * b.value, a.grad + factor * b.grad, a.hess + factor * b.hess};
}

Field product(const Field& a, const Field& b) noexcept {
  return {a.value * b.value, a.grad * b.value + b.grad * a.value,
          a.hess * b.value + b.hess * a.value + a.grad * b.grad.transpose() + b.grad * a.grad.transpose()};
}

/// f(a) from f, f', f''.
Field of(const Field& a, double f, double f1, double f2) noexcept {
  return {f, f1 * a.grad, f1 * a.hess + f2 * (a.grad * a.grad.transpose())};
}

/// The height that two feet share above the second, over t, and their radius over that of the second, as
/// functions of q = (δ_1 − δ_2)/t: with L = q + ln(R_1/R_2), p = 1/(1 + e^{−L}),
///   (δ − δ_2)/t = p q,  ln(R_eff/R_2) = ln(1 + e^L) − p q.
struct TwoFeet {
  Field height, log_radius;
};

TwoFeet two_feet(const Field& q, double log_ratio) noexcept {
  const double l = q.value + log_ratio;
  const double small = det_exp(-std::abs(l));
  const double p = l > 0.0 ? 1.0 / (1.0 + small) : small / (1.0 + small);
  const double log_sum = (l > 0.0 ? l : 0.0) + det_log(1.0 + small);
  const double p1 = small / ((1.0 + small) * (1.0 + small));
  const double p2 = p1 * (1.0 - 2.0 * p);
  const double x = q.value;
  return {of(q, p * x, p + p1 * x, 2.0 * p1 + p2 * x), of(q, log_sum - p * x, -p1 * x, -p1 - p2 * x)};
}

void put(const Field& overlap, const Field& log_radius, ContactJet& jet) noexcept {
  jet.overlap_nm = overlap.value;
  jet.overlap_grad = overlap.grad;
  jet.overlap_hess_per_nm = overlap.hess;
  jet.log_radius = log_radius.value;
  jet.log_radius_grad_per_nm = log_radius.grad;
  jet.log_radius_hess_per_nm2 = log_radius.hess;
}

void check_tip(double radius_nm) {
  if (!(radius_nm > 0.0 && std::isfinite(radius_nm)))
    throw UserError("surface: expected a positive tip radius");
}

}  // namespace

PlaneFields::PlaneFields(const PlaneSurface::Shape& shape, double tip_radius_nm) {
  const PlaneSurface checked(shape);
  check_tip(tip_radius_nm);
  const double secant = std::sqrt(1.0 + shape.slope_x * shape.slope_x + shape.slope_y * shape.slope_y);
  slope_ = Vec3(shape.slope_x, shape.slope_y, -1.0) / secant;
  // 1 − 1/secant without cancellation.
  const double slope_sq = shape.slope_x * shape.slope_x + shape.slope_y * shape.slope_y;
  offset_ = shape.height_nm / secant + tip_radius_nm * slope_sq / (secant * (secant + 1.0));
  log_radius_ = det_log(tip_radius_nm);
}

void PlaneFields::contact_at(const Vec3& apex, ContactJet& jet) const noexcept {
  renew(jet);
  jet.overlap_nm = slope_.dot(apex) + offset_;
  jet.overlap_grad = slope_;
  jet.log_radius = log_radius_;
}

void PlaneFields::growing_at(const Vec3& apex, const SofteningRule&, ContactJet& jet) const noexcept {
  contact_at(apex, jet);
}

void PlaneFields::at_softening(const Vec3& apex, double, ContactJet& jet) const noexcept {
  contact_at(apex, jet);
}

struct SphereFields::Feet {
  Field apart;  // δ_b − δ_p
  Field plate;  // δ_p
};

SphereFields::SphereFields(const SphereSurface::Shape& shape, double tip_radius_nm, const SofteningRule& rule)
    : rule_(rule), tip_radius_(tip_radius_nm), reach_(tip_radius_nm + shape.radius_nm) {
  const SphereSurface checked(shape);
  check_tip(tip_radius_nm);
  middle_ = Vec3(shape.x_nm, shape.y_nm, shape.height_nm - shape.radius_nm);
  log_plate_ = det_log(tip_radius_nm);
  log_ball_ = det_log(tip_radius_nm * shape.radius_nm / reach_);
}

SphereFields::Feet SphereFields::feet(const Vec3& apex) const noexcept {
  Vec3 e = apex - middle_;
  e.z() += tip_radius_;
  const double length = e.norm();
  // In the very middle, which no tip reaches, every direction is as good: up.
  const double inverse = length > 0.0 ? 1.0 / length : 1.0;
  const Vec3 n = length > 0.0 ? Vec3(e * inverse) : Vec3(0.0, 0.0, 1.0);
  Feet feet;
  feet.plate.value = -apex.z();
  feet.plate.grad = Vec3(0.0, 0.0, -1.0);
  feet.apart.value = reach_ - length + apex.z();
  feet.apart.grad = Vec3(0.0, 0.0, 1.0) - n;
  feet.apart.hess = inverse * (n * n.transpose() - Mat3::Identity());
  return feet;
}

void SphereFields::at_softening(const Vec3& apex, double softening_nm, ContactJet& jet) const noexcept {
  const Feet both = feet(apex);
  const Field q = sum(Field{}, 1.0 / softening_nm, both.apart);
  TwoFeet shared = two_feet(q, log_ball_ - log_plate_);
  shared.log_radius.value += log_plate_;
  put(sum(both.plate, softening_nm, shared.height), shared.log_radius, jet);
}

void SphereFields::contact_at(const Vec3& apex, ContactJet& jet) const noexcept {
  growing_at(apex, rule_, jet);
}

void SphereFields::growing_at(const Vec3& apex, const SofteningRule& rule, ContactJet& jet) const noexcept {
  const Feet both = feet(apex);
  const double log_ratio = log_ball_ - log_plate_;
  const double t0 = rule_.finest_nm;
  const Field at_finest = sum(both.plate, t0, two_feet(sum(Field{}, 1.0 / t0, both.apart), log_ratio).height);
  // t = t0 2^level(v0), v0 = −δ at the finest.
  const SofteningLevel level = softening_level(rule, -at_finest.value);
  const double a = kLn2 * level.slope_per_nm, b = kLn2 * level.bend_per_nm2;
  const double t = std::max(t0, rule.finest_nm) * det_exp(kLn2 * level.level);
  const Field v0 = sum(Field{}, -1.0, at_finest);
  const Field softening = of(v0, t, t * a, t * (a * a + b));
  const Field sharpness = of(v0, 1.0 / t, -a / t, (a * a - b) / t);
  TwoFeet shared = two_feet(product(both.apart, sharpness), log_ratio);
  shared.log_radius.value += log_plate_;
  put(sum(both.plate, 1.0, product(softening, shared.height)), shared.log_radius, jet);
}

}  // namespace telenano::physics
