#pragma once

namespace telenano::physics {

/// One term W(δ, ρ) of the potential with its first and second derivatives: δ overlap (nm), ρ = ln(R_eff/nm).
struct PotentialJet {
  double energy_aj = 0;
  double force_nn = 0;            ///< ∂W/∂δ, repulsion positive
  double by_radius_aj = 0;        ///< ∂W/∂ρ
  double stiffness_n_m = 0;       ///< ∂²W/∂δ²
  double mixed_nn = 0;            ///< ∂²W/∂δ∂ρ
  double by_radius_twice_aj = 0;  ///< ∂²W/∂ρ²
};

}  // namespace telenano::physics
