#include "telenano/nve_server/physics/long_range/tip_van_der_waals.h"

#include "telenano/common/base/constants.h"
#include "telenano/nve_server/physics/numerics/log_one_plus.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {

constexpr double kGregory = 5.32;

}  // namespace

TipVanDerWaals::TipVanDerWaals(double hamaker_aj, double retardation_nm, const TipShape& shape) noexcept
    : h12_(hamaker_aj / (12.0 * kPi)), b_(retardation_nm > 0 ? kGregory / retardation_nm : 0), shape_(shape) {
  const double tan = shape.half_angle_sin / shape.half_angle_cos;
  tan2_ = tan * tan;
}

double TipVanDerWaals::area_energy(double z) const noexcept {
  return h12_ / (z * z * (1.0 + b_ * z));
}

double TipVanDerWaals::area_energy_integral(double z) const noexcept {
  if (b_ == 0) return h12_ / z;
  const LogOnePlus l(1.0 / (b_ * z));
  return h12_ / z * (l.s - l.rest * l.e);
}

double TipVanDerWaals::area_energy_integral_drop(double z, double further) const noexcept {
  if (b_ == 0) return h12_ * further / (z * (z + further));
  return area_energy_integral(z) - area_energy_integral(z + further);
}

double TipVanDerWaals::area_energy_second_integral(double z) const noexcept {
  const LogOnePlus l(1.0 / (b_ * z));
  return h12_ * (l.s + l.e + l.s * l.e);
}

double TipVanDerWaals::area_energy_second_integral_drop(double z, double further) const noexcept {
  if (b_ == 0) return h12_ * LogOnePlus(further / z).log();
  return area_energy_second_integral(z) - area_energy_second_integral(z + further);
}

LongRangePoint TipVanDerWaals::correction(double gap_nm, double radius_nm) const noexcept {
  const double d = gap_nm;
  LongRangePoint out;
  if (b_ > 0) {
    const double inverse = 1.0 / (d * (1.0 + b_ * d));
    out.force_nn = kTwoPi * radius_nm * h12_ * b_ * inverse;
    out.stiffness_n_m = out.force_nn * (1.0 + 2.0 * b_ * d) * inverse;
  }
  if (shape_.height_nm > 0) {
    const double cap = shape_.cap_nm(radius_nm);
    const double cone = shape_.height_nm - cap;
    const double end = d + shape_.height_nm;
    const double a = radius_nm - cap + cone * tan2_;
    const double w_end = area_energy(end);
    const double w_cap = area_energy(d + cap);
    const double p_end = w_end * (2.0 + 3.0 * b_ * end) / (end * (1.0 + b_ * end));
    out.force_nn += kTwoPi * (area_energy_integral_drop(d, cap) -
                              tan2_ * area_energy_integral_drop(d + cap, cone) + a * w_end);
    out.stiffness_n_m += kTwoPi * (area_energy(d) - w_cap - tan2_ * (w_cap - w_end) + a * p_end);
  }
  return out;
}

double TipVanDerWaals::correction_energy_aj(double gap_nm, double radius_nm) const noexcept {
  const double d = gap_nm;
  double energy = 0;
  if (b_ > 0) energy = kTwoPi * radius_nm * h12_ * b_ * LogOnePlus(1.0 / (b_ * d)).log();
  if (shape_.height_nm > 0) {
    const double cap = shape_.cap_nm(radius_nm);
    const double cone = shape_.height_nm - cap;
    energy += kTwoPi * (area_energy_second_integral_drop(d, cap) -
                        tan2_ * area_energy_second_integral_drop(d + cap, cone) +
                        (radius_nm - cap + cone * tan2_) * area_energy_integral(d + shape_.height_nm));
  }
  return energy;
}

TipVanDerWaals::Gap TipVanDerWaals::gap(double gap_nm) const noexcept {
  Gap g;
  g.gap_nm = gap_nm;
  const double end = gap_nm + shape_.height_nm;
  g.end_density = area_energy(end);
  if (b_ == 0) return g;
  g.retarded_force = kTwoPi * h12_ * b_ / (gap_nm * (1.0 + b_ * gap_nm));
  g.retarded_energy = kTwoPi * h12_ * b_ * LogOnePlus(1.0 / (b_ * gap_nm)).log();
  g.near_integral = area_energy_integral(gap_nm);
  g.near_second = area_energy_second_integral(gap_nm);
  g.end_integral = area_energy_integral(end);
  g.end_second = area_energy_second_integral(end);
  return g;
}

TipVanDerWaals::Correction TipVanDerWaals::correction(const Gap& g, double radius_nm) const noexcept {
  Correction out{g.retarded_force * radius_nm, g.retarded_energy * radius_nm};
  if (b_ == 0) {
    out.force_nn = correction(g.gap_nm, radius_nm).force_nn;
    out.energy_aj = correction_energy_aj(g.gap_nm, radius_nm);
  }
  if (shape_.height_nm > 0) {
    const double cap = shape_.cap_nm(radius_nm);
    const double z = g.gap_nm + cap;
    if (b_ == 0) return out;
    const LogOnePlus l(1.0 / (b_ * z));
    const double integral = h12_ / z * (l.s - l.rest * l.e);
    const double second = h12_ * (l.s + l.e + l.s * l.e);
    const double a = radius_nm - cap + (shape_.height_nm - cap) * tan2_;
    out.force_nn +=
        kTwoPi * ((g.near_integral - integral) - tan2_ * (integral - g.end_integral) + a * g.end_density);
    out.energy_aj +=
        kTwoPi * ((g.near_second - second) - tan2_ * (second - g.end_second) + a * g.end_integral);
  }
  return out;
}

}  // namespace telenano::physics
