#include "telenano/nve_server/physics/long_range/long_range.h"

#include <cmath>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/require.h"

namespace telenano::physics {
namespace {

constexpr double kLargestHalfAngleDeg = 75;  // beyond, a tip is no tip, and the field no cone's

TipShape shape_of(const LongRangeParameters& p) {
  require(std::isfinite(p.cone_height_nm) && p.cone_height_nm >= 0,
          "long-range forces: cone height must be finite and positive, or 0 for no cone (nm)",
          p.cone_height_nm);
  TipShape shape;
  if (p.cone_height_nm == 0) {
    require(p.cone_half_angle_deg == 0, "long-range forces: a cone's half angle needs its height, too",
            p.cone_half_angle_deg);
    return shape;
  }
  require(p.cone_half_angle_deg >= 1 && p.cone_half_angle_deg <= kLargestHalfAngleDeg,
          "long-range forces: cone half angle must be 1 to 75 degrees", p.cone_half_angle_deg);
  const SinCos angle = det_sin_cos(p.cone_half_angle_deg * (kPi / 180.0));
  shape.half_angle_sin = angle.sin;
  shape.half_angle_cos = angle.cos;
  shape.height_nm = p.cone_height_nm;
  return shape;
}

}  // namespace

LongRange::LongRange(const LongRangeParameters& p, double hamaker_aj, double cut_off_nm,
                     const DisplacedAttraction& displaced)
    : cut_off_nm_(cut_off_nm), capillary_(p.capillary, displaced) {
  require(std::isfinite(p.retardation_nm) && p.retardation_nm >= 0,
          "long-range forces: retardation wavelength must be finite and positive, or 0 for none (nm)",
          p.retardation_nm);
  require(p.retardation_nm == 0 || hamaker_aj > 0,
          "long-range forces: retardation needs van der Waals forces", p.retardation_nm);
  require(std::isfinite(p.tip_bias_v), "long-range forces: tip bias must be finite (V)", p.tip_bias_v);
  const TipShape shape = shape_of(p);
  if (hamaker_aj > 0) {
    const double taken = VanDerWaals::from_adhesion(displaced.work_n_m, cut_off_nm).hamaker_aj;
    van_der_waals_ = TipVanDerWaals(hamaker_aj, p.retardation_nm, shape);
    wet_van_der_waals_ = TipVanDerWaals(hamaker_aj - taken, p.retardation_nm, shape);
  }
  touch_ = van_der_waals_.gap(cut_off_nm);
  wet_touch_ = wet_van_der_waals_.gap(cut_off_nm);
  electrostatic_ = Electrostatic(p.tip_bias_v, shape);
}

// What a bridge that forms at this gap sets free: its own energy less that of the attraction it displaces.
double LongRange::freed_aj(double gap_nm, double radius_nm) const noexcept {
  double freed = capillary_.freed_aj(gap_nm, radius_nm);
  if (van_der_waals_.active()) {
    const double d = cut_off_nm_ + gap_nm;
    freed += van_der_waals_.correction_energy_aj(d, radius_nm) -
             wet_van_der_waals_.correction_energy_aj(d, radius_nm);
  }
  return freed;
}

double LongRange::formation_overlap_nm(double radius_nm) const noexcept {
  const double latest = capillary_.formation_gap_nm(radius_nm);
  if (latest == 0 || (capillary_.settled() && !van_der_waals_.active())) return -latest;
  if (freed_aj(latest, radius_nm) >= 0) return -latest;
  // Nearer by halving; at touch, where contact has another word to say, if nowhere before.
  if (!(freed_aj(0, radius_nm) >= 0)) return 0;
  double low = 0;
  double high = latest;
  for (int i = 0; i < 60; ++i) {
    const double mid = 0.5 * (low + high);
    if (!(mid > low && mid < high)) break;
    (freed_aj(mid, radius_nm) >= 0 ? low : high) = mid;
  }
  return -low;
}

LongRangePoint LongRange::evaluate_open(double overlap_nm, double radius_nm,
                                        const BridgeState& bridge) const noexcept {
  LongRangePoint sum;
  const double gap = cut_off_nm_ - overlap_nm;
  if (van_der_waals_.active()) sum += van_der_waals(bridge).correction(gap, radius_nm);
  if (electrostatic_.active()) sum += electrostatic_.at(gap, radius_nm);
  if (bridge.present) sum += capillary_.at(-overlap_nm, radius_nm, bridge);
  return sum;
}

LongRangePoint LongRange::evaluate(double overlap_nm, double radius_nm,
                                   const BridgeState& bridge) const noexcept {
  if (overlap_nm < 0) return evaluate_open(overlap_nm, radius_nm, bridge);
  return {evaluate_open(0, radius_nm, bridge).force_nn, 0};
}

double LongRange::energy_aj(double overlap_nm, double radius_nm, const BridgeState& bridge) const noexcept {
  const double open = overlap_nm < 0 ? overlap_nm : 0;
  const double gap = cut_off_nm_ - open;
  double energy = 0;
  if (van_der_waals_.active()) energy += van_der_waals(bridge).correction_energy_aj(gap, radius_nm);
  if (electrostatic_.active()) energy += electrostatic_.energy_aj(gap, radius_nm);
  if (bridge.present) energy += capillary_.energy_aj(-open, radius_nm, bridge);
  if (overlap_nm > 0) energy += overlap_nm * evaluate_open(0, radius_nm, bridge).force_nn;
  return energy;
}

LongRange::Touch LongRange::at_touch(double radius_nm, const BridgeState& bridge) const noexcept {
  Touch sum;
  if (van_der_waals_.active()) {
    const TipVanDerWaals::Correction far =
        van_der_waals(bridge).correction(bridge.present ? wet_touch_ : touch_, radius_nm);
    sum = {far.force_nn, far.energy_aj};
  }
  if (electrostatic_.active()) {
    sum.force_nn += electrostatic_.at(cut_off_nm_, radius_nm).force_nn;
    sum.energy_aj += electrostatic_.energy_aj(cut_off_nm_, radius_nm);
  }
  if (bridge.present) {
    sum.force_nn += capillary_.at(0, radius_nm, bridge).force_nn;
    sum.energy_aj += capillary_.energy_aj(0, radius_nm, bridge);
  }
  return sum;
}

double jump_to_contact_gap_nm(const VanDerWaals& van_der_waals, double stiffness_n_m,
                              double radius_nm) noexcept {
  return det_cbrt(van_der_waals.hamaker_aj * radius_nm / (3.0 * stiffness_n_m));
}

double jump_to_contact_gap_nm(const VanDerWaals& van_der_waals, const LongRange& long_range,
                              double cut_off_nm, double stiffness_n_m, double radius_nm) noexcept {
  // The slope falls monotonically with the gap: bisect, to the last bits (in the logarithm first).
  const auto unstable = [&](double gap) {
    return van_der_waals.stiffness_n_m(radius_nm, gap) +
               long_range.evaluate_open(cut_off_nm - gap, radius_nm, {}).stiffness_n_m <
           -stiffness_n_m;
  };
  double low = cut_off_nm;
  double high = cut_off_nm;
  if (!unstable(low)) return 0;
  for (int i = 0; i < 1000 && unstable(high); ++i) high *= 2.0;
  for (int i = 0; i < 200; ++i) {
    const double mid = 0.5 * (low + high);
    if (!(mid > low && mid < high)) break;
    (unstable(mid) ? low : high) = mid;
  }
  return high;
}

}  // namespace telenano::physics
