#include "telenano/nve_server/physics/potential/bridge_potential.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"

namespace telenano::physics {

BridgePotential::BridgePotential(const Capillary& capillary, double nominal_radius_nm) noexcept
    : capillary_(capillary), constant_volume_(capillary.constant_volume()) {
  if (!capillary.active()) return;
  force_per_radius_ = capillary.force_per_radius_n_m();
  softening_nm_ = kSofteningShare * capillary.formed(nominal_radius_nm).rupture_gap_nm;
}

double BridgePotential::formation_overlap_nm(double log_radius) const noexcept {
  return -capillary_.formation_gap_nm(constant_volume_ ? det_exp(log_radius) : 1.0);
}

BridgeState BridgePotential::formed_at(double overlap_nm, double log_radius) const noexcept {
  return capillary_.formed_at(std::max(0.0, -overlap_nm), constant_volume_ ? det_exp(log_radius) : 1.0);
}

void BridgePotential::add(const BridgeState& bridge, double overlap_nm, double log_radius,
                          PotentialJet& jet) const noexcept {
  if (ruptured(bridge, overlap_nm)) return;
  const double f0 = force_per_radius_ * det_exp(log_radius);
  const double gap = std::max(0.0, -overlap_nm);
  const double pressed = std::max(0.0, overlap_nm);
  if (!constant_volume_) {
    const double reach = bridge.rupture_gap_nm;
    const double left = reach - gap;
    const double energy = -f0 * (0.5 * left * left / reach + pressed);
    const double force = -f0 * left / reach;
    jet.energy_aj += energy;
    jet.force_nn += force;
    jet.by_radius_aj += energy;
    jet.stiffness_n_m -= pressed > 0.0 ? 0.0 : f0 / reach;
    jet.mixed_nn += force;
    jet.by_radius_twice_aj += energy;
    return;
  }
  // W = −F0 g(b), g = e(D) − e(D_r) [+ e'(0) δ, e'(0) = 1]; F0 and 1/b go with R: with x' = ∂x/∂ρ
  //   W' = W + F0 b g_b,  W'' = W' + F0 b g_b − F0 b (g_b + b g_bb) = W' − F0 b² g_bb.
  const double b = bridge.volume_nm3 / (kPi * det_exp(log_radius));
  const auto half = [&](double d) { return std::sqrt(d * d + b); };
  const double s = half(gap), end = half(bridge.rupture_gap_nm);
  const double share = b / (s * (s + gap));  // 1 − D/s
  const double g = b / (s + gap) - b / (end + bridge.rupture_gap_nm) + pressed;
  const double g_b = 0.5 / s - 0.5 / end;
  const double g_bb = -0.25 / (s * s * s) + 0.25 / (end * end * end);
  const double energy = -f0 * g;
  const double by_radius = energy + f0 * b * g_b;
  jet.energy_aj += energy;
  jet.force_nn -= f0 * share;
  jet.by_radius_aj += by_radius;
  // ∂share/∂b = D/(2 s³), which is 0 from touch on.
  jet.mixed_nn -= f0 * (share - 0.5 * b * gap / (s * s * s));
  jet.stiffness_n_m -= pressed > 0.0 ? 0.0 : f0 * b / (s * s * s);
  jet.by_radius_twice_aj += by_radius - f0 * b * b * g_bb;
}

}  // namespace telenano::physics
