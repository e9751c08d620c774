#include "telenano/nve_server/physics/contact/friction.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/renew.h"
#include "telenano/nve_server/physics/numerics/require.h"

namespace telenano::physics {
namespace {

void require_finite(bool good, const char* what, double value) {
  require(good && std::isfinite(value), what, value);
}

// A vector perpendicular to `from` after the least rotation that takes `from` to `to` (Rodrigues' formula).
Vec3 carry(const Vec3& v, const Vec3& from, const Vec3& to) noexcept {
  const double along = to.dot(v);
  if (along == 0.0) return v;
  const double base = 1.0 + from.dot(to);
  const Vec3 turned = base > 1e-12 ? Vec3(v - (along / base) * (from + to)) : Vec3(-v);
  return turned - to * to.dot(turned);  // what rounding left along the normal
}

}  // namespace

Friction::Friction(const FrictionParameters& parameters) : parameters_(parameters) {
  const FrictionParameters& p = parameters;
  require_finite(p.shear_strength_gpa >= 0.0, "friction: shear strength must be >= 0 and finite (GPa)",
                 p.shear_strength_gpa);
  require_finite(p.coefficient >= 0.0, "friction: coefficient must be >= 0 and finite", p.coefficient);
  require_finite(p.shear_strength_gpa + p.coefficient > 0.0,
                 "friction: shear strength or coefficient must be positive", p.shear_strength_gpa);
  require_finite(p.shear_modulus_gpa > 0.0, "friction: shear modulus G* must be positive and finite (GPa)",
                 p.shear_modulus_gpa);
  require_finite(p.kinetic_ratio > 0.0 && p.kinetic_ratio <= 1.0,
                 "friction: kinetic ratio must be more than 0, at most 1", p.kinetic_ratio);
}

double Friction::limit_nn(double contact_radius_nm, double normal_force_nn) const noexcept {
  return parameters_.shear_strength_gpa * kPi * contact_radius_nm * contact_radius_nm +
         parameters_.coefficient * std::max(0.0, normal_force_nn);
}

double Friction::stiffness_n_m(double contact_radius_nm) const noexcept {
  return 8.0 * parameters_.shear_modulus_gpa * contact_radius_nm;
}

FrictionStep Friction::move(const FrictionState& from, const Vec3& normal, const Vec3& moved_nm,
                            double contact_radius_nm, double normal_force_nn, bool breaking) const noexcept {
  FrictionStep step;
  moved<true>(from, normal, moved_nm, contact_radius_nm, normal_force_nn, breaking, step);
  return step;
}

FrictionStep Friction::move_once(const FrictionState& from, const Vec3& normal, const Vec3& moved_nm,
                                 double contact_radius_nm, double normal_force_nn,
                                 bool breaking) const noexcept {
  FrictionStep step;
  moved<false>(from, normal, moved_nm, contact_radius_nm, normal_force_nn, breaking, step);
  return step;
}

void Friction::move(const FrictionState& from, const Vec3& normal, const Vec3& moved_nm,
                    double contact_radius_nm, double normal_force_nn, bool breaking,
                    FrictionStep& step) const noexcept {
  renew(step);
  moved<true>(from, normal, moved_nm, contact_radius_nm, normal_force_nn, breaking, step);
}

void Friction::move_once(const FrictionState& from, const Vec3& normal, const Vec3& moved_nm,
                         double contact_radius_nm, double normal_force_nn, bool breaking,
                         FrictionStep& step) const noexcept {
  renew(step);
  moved<false>(from, normal, moved_nm, contact_radius_nm, normal_force_nn, breaking, step);
}

// `step` is new.
template <bool kTangents>
void Friction::moved(const FrictionState& from, const Vec3& normal, const Vec3& moved,
                     double contact_radius_nm, double normal_force_nn, bool breaking,
                     FrictionStep& step) const noexcept {
  const double k0 = from.stiffness_n_m;
  const double k = stiffness_n_m(contact_radius_nm);
  const double before = 0.5 * k0 * from.extension_w_nm.squaredNorm();
  step.after.normal_w = normal;
  if (!(k > 0.0)) {
    step.dissipated_aj = before;
    return;
  }
  step.after.stiffness_n_m = k;
  if (!(k0 > 0.0)) return;  // made in this step: where on its way nobody knows, so unstressed
  const bool grown = k > k0;
  Vec3 carried = carry(from.extension_w_nm, from.normal_w, normal);
  if (grown) carried *= k0 / k;
  step.dissipated_aj = std::max(0.0, before - 0.5 * k * carried.squaredNorm());

  const Vec3 advance = moved - normal * normal.dot(moved);
  const Vec3 trial = carried + advance;
  const double length = trial.norm();
  const double ratio = breaking ? parameters_.kinetic_ratio : 1.0;
  const double limit = ratio * limit_nn(contact_radius_nm, normal_force_nn);
  // s (1 − n nᵀ [− d dᵀ]), symmetric.
  const auto across = [&](double s, const Vec3* direction) {
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        double part = (i == j ? 1.0 : 0.0) - normal[i] * normal[j];
        if (direction) part -= (*direction)[i] * (*direction)[j];
        step.stiffness_n_m(i, j) = step.stiffness_n_m(j, i) = s * part;
      }
    }
  };
  if (k * length <= limit) {
    step.after.extension_w_nm = trial;
    if constexpr (kTangents) {
      across(k, nullptr);
      step.force_per_radius_w_n_m = -(k / contact_radius_nm) * (grown ? advance : trial);
    }
  } else {
    const double per_length = 1.0 / length;
    const double longest = limit / k;
    const Vec3 direction = per_length * trial;
    step.after.extension_w_nm = longest * direction;
    step.slip_w_nm = trial - step.after.extension_w_nm;
    step.dissipated_aj += limit * (length - longest);
    step.sliding = true;
    if constexpr (kTangents) {
      across(limit * per_length, &direction);
      step.force_per_radius_w_n_m =
          -(ratio * 2.0 * kPi * parameters_.shear_strength_gpa * contact_radius_nm) * direction;
      if (grown) step.force_per_radius_w_n_m += step.stiffness_n_m * (carried / contact_radius_nm);
      if (normal_force_nn > 0.0) step.force_per_load_w = -(ratio * parameters_.coefficient) * direction;
    }
  }
  step.force_w_nn = -k * step.after.extension_w_nm;
  step.stored_aj = 0.5 * k * step.after.extension_w_nm.squaredNorm();
}

}  // namespace telenano::physics
