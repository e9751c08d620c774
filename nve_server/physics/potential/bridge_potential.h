#pragma once

#include "telenano/nve_server/physics/long_range/capillary.h"
#include "telenano/nve_server/physics/potential/potential_jet.h"

namespace telenano::physics {

/// The liquid bridge (capillary.h) as a term of the potential, W(δ, ρ) with D = −δ the gap, and its memory.
///
/// Formula   Constant curvature: W = −F0 (D_r − D)²/(2 D_r). Constant volume: W = −F0 (e(D) − e(D_r)), e(D) =
///           s − D, s = √(D² + V/πR). F0 = 4πRγc; from touch on the force stays, W = W(0) − F(0) δ. With b =
///           V/πR, ∂b/∂ρ = −b and ∂e/∂b = 1/2s the derivatives in ρ are closed forms too.
/// Softening of the fields that it reads: 0.28 of the rupture gap, fixed. Its force falls off in a line over
///           that gap, so that the layer that takes part is a good part of it at any distance. Against rigid
///           proximity sums over synthetic self-affine grounds of rms slope 0.25, gaps 0.165 and 0.5 nm, 50
///           and 80 % humidity: ninth decile of the error 4 to 10 %; with 0.2 or 0.32 up to 14 and 10 %, with
///           the contact's 0.09 nm up to 38 %.
/// Memory    A bridge ends at its rupture gap. Where one may form: formation_overlap_nm(), if U falls by it.
class BridgePotential {
 public:
  static constexpr double kSofteningShare = 0.28;

  BridgePotential() = default;
  /// `nominal_radius_nm` tells the rupture gap of a volume that the humidity condenses.
  BridgePotential(const Capillary& capillary, double nominal_radius_nm) noexcept;

  bool active() const noexcept { return capillary_.active(); }
  double softening_nm() const noexcept { return softening_nm_; }

  /// Where the films meet outside of contact: the overlap, <= 0, from which on a bridge may form.
  double formation_overlap_nm(double log_radius) const noexcept;
  /// The bridge that forms at this overlap (from touch on the one at touch).
  BridgeState formed_at(double overlap_nm, double log_radius) const noexcept;
  static bool ruptured(const BridgeState& bridge, double overlap_nm) noexcept {
    return overlap_nm < -bridge.rupture_gap_nm;
  }

  /// Adds the bridge's term; beyond the rupture gap there is none.
  void add(const BridgeState& bridge, double overlap_nm, double log_radius, PotentialJet& jet) const noexcept;

 private:
  Capillary capillary_;
  double force_per_radius_ = 0;  // 4πγc
  double softening_nm_ = 0;
  bool constant_volume_ = false;
};

}  // namespace telenano::physics
