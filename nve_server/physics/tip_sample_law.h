#pragma once

#include <cstdint>

namespace telenano::physics {

enum class Branch : std::uint8_t { kFree, kVanDerWaals, kNonContact, kContact };

/// One sphere on one locally spherical sample: what the force law needs, in nm, nN, GPa, N/m.
struct TipSampleParameters {
  double contact_modulus_gpa = 0;  ///< K = 4E*/3
  double work_of_adhesion_n_m = 0;  ///< w
  double equilibrium_distance_nm = 0.165;  ///< z0 of Maugis–Dugdale = a0 of van der Waals
  bool van_der_waals = true;  ///< Hamaker constant from w (H = 12 pi a0^2 w), so that no adhesion is counted twice
};

/// What must be remembered between steps: which of the stable states the tip is in, and a warm start.
struct TipSampleState {
  Branch branch = Branch::kFree;
  double overlap_nm = -1e9;
  double warm = 0;  ///< private to the law (the curve's parameter)
};

enum class SolveStatus : std::uint8_t { kOk, kNotConverged, kNonFinite };

/// An equilibrium of the tip between the sample and a spring to the base.
struct Equilibrium {
  SolveStatus status = SolveStatus::kOk;
  Branch branch = Branch::kFree;
  double overlap_nm = 0;         ///< delta, positive beyond touching
  double force_nn = 0;           ///< repulsive positive
  double stiffness_n_m = 0;      ///< dF/d(delta) of the tip–sample law alone
  double contact_radius_nm = 0;  ///< a; 0 without contact
  double potential_aj = 0;       ///< of the tip–sample law alone, 0 at infinite distance
  double dissipated_aj = 0;      ///< lost in the jumps of this advance, >= 0
  int jumps = 0;
};

/// Van der Waals joined to Maugis–Dugdale, with memory of the branch.
class TipSampleLaw {
 public:
  explicit TipSampleLaw(const TipSampleParameters& parameters);

  /// Moves the base quasi-statically from where the state was to `base_overlap_nm` (the overlap that there would be
  /// without any force) against a spring of compliance `compliance_nm_nn` (0 = rigid: displacement control) at the local
  /// radius `radius_nm`, resolving every jump on the way. F = (base_overlap − delta) / compliance. No allocation.
  Equilibrium advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                      TipSampleState& state) const noexcept;
};

}  // namespace telenano::physics
