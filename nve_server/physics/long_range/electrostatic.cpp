#include "telenano/nve_server/physics/long_range/electrostatic.h"

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/log_one_plus.h"

namespace telenano::physics {

Electrostatic::Electrostatic(double bias_v, const TipShape& shape) noexcept
    : k_(kPi * kVacuumPermittivityNnPerV2 * bias_v * bias_v), shape_(shape) {
  if (!(shape.height_nm > 0)) return;
  const double log_tan = det_log(shape.half_angle_sin / (1.0 + shape.half_angle_cos));
  kappa2_ = 1.0 / (log_tan * log_tan);
  p_over_radius_ = shape.half_angle_cos * shape.half_angle_cos / shape.half_angle_sin;
}

LongRangePoint Electrostatic::at(double gap_nm, double radius_nm) const noexcept {
  const double d = gap_nm;
  const double cap = shape_.cap_nm(radius_nm);
  const double inverse = 1.0 / (d * (d + cap));
  LongRangePoint out;
  out.force_nn = -k_ * radius_nm * cap * inverse;
  out.stiffness_n_m = out.force_nn * (2.0 * d + cap) * inverse;
  if (shape_.height_nm > cap) {
    const double z = d + cap;
    const double y = (shape_.height_nm - cap) / z;
    const double p = p_over_radius_ * radius_nm / z;
    const double end = 1.0 / (1.0 + y);
    const LogOnePlus l(y);
    out.force_nn -= k_ * kappa2_ * (2.0 * l.s * (l.e + l.s / (1.0 + l.s)) + p * y * end);
    out.stiffness_n_m -= k_ * kappa2_ / z * y * end * end * (y + p * (2.0 + y));
  }
  return out;
}

double Electrostatic::energy_aj(double gap_nm, double radius_nm) const noexcept {
  const double cap = shape_.cap_nm(radius_nm);
  double energy = -k_ * radius_nm * LogOnePlus(cap / gap_nm).log();
  if (shape_.height_nm > cap) {
    const double z = gap_nm + cap;
    const LogOnePlus l((shape_.height_nm - cap) / z);
    energy -= k_ * kappa2_ * (z * 2.0 * l.s * (l.s / l.rest - l.e) + p_over_radius_ * radius_nm * l.log());
  }
  return energy;
}

}  // namespace telenano::physics
