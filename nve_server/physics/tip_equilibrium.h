#pragma once

#include <memory>

#include "common/base/vec3.h"
#include "nve_server/physics/surface.h"
#include "nve_server/physics/tip_sample_law.h"

namespace telenano::physics {

/// The springs between the free end and the tip's apex, diagonal in W, nm/nN: 0 = rigid. The virtual coupling is equal
/// in all directions, the cantilever adds its compliance along z.
using Compliance = Vec3;

/// What the equilibrium remembers from one accepted step to the next.
struct TipState {
  TipSampleState law;
  FootMemory foot;
  bool started = false;
  Vec3 free_end_w_nm = Vec3::Zero();
  Vec3 apex_w_nm = Vec3::Zero();
  Vec3 normal_w = Vec3::UnitZ();
  double force_nn = 0;
  double stiffness_n_m = 0;
};

struct TipSolution {
  SolveStatus status = SolveStatus::kOk;
  Branch branch = Branch::kFree;
  Vec3 apex_w_nm = Vec3::Zero();
  Vec3 force_w_nn = Vec3::Zero();  ///< on the tip
  Vec3 normal_w = Vec3::UnitZ();
  double normal_force_nn = 0;  ///< repulsive positive
  double overlap_nm = 0;
  double radius_nm = 0;  ///< effective
  double contact_radius_nm = 0;
  double stiffness_n_m = 0;     ///< of the tip–sample law, along the normal
  double potential_aj = 0;      ///< of the tip–sample law
  double dissipated_aj = 0;     ///< in the jumps of this step
  int jumps = 0;
  int iterations = 0;
  bool slid = false;            ///< the tip went down a slope by a lateral instability
  bool outside = false;         ///< beyond the rim of the scan
  bool radius_clamped = false;  ///< wider than the pit it stands in
};

/// Quasi-static balance of a spherical tip between a sample and springs to a free end.
///
///   apex p = x_free + C n F,   F = law(overlap δ, R_eff),   δ = R − distance(p + R e_z)
///
/// C the compliance, n the surface's normal at the foot. For a given foot the balance along n is scalar: the law is
/// advanced against the compliance c_n = nᵀCn, branches and jumps included. The foot, normal and radius follow from p.
///
/// Flat sample: nothing turns, the scalar balance is the answer. Otherwise Newton's method with the law kept whole: the
/// turning normal n(p) ≈ n + N(p − p_k) (N = ∂n/∂p) changes the compliance to A C, A = (1 − F C N)⁻¹, and the base overlap to
/// δ_k − nᵀA(x_free − p_k). Where F C N comes near 1 the tip is about to slide off a summit sideways: A is then bounded
/// and the iteration walks downhill to the next balance. Each trial starts from a copy of the law's memory, which moves on
/// once a step, with the accepted foot, and that foot is the nearest of the whole surface.
///
/// Limits: one contact, the nearest (largest overlap); a second one at the foot of a step is left out. The force on the tip
/// is along the normal: the lateral force from the change of R_eff along the surface is left out, while
/// the potential has it.
class TipEquilibrium {
 public:
  TipEquilibrium(std::shared_ptr<const Surface> surface, const TipSampleLaw& law, double tip_radius_nm);

  /// Moves the free end to `free_end_w_nm`. Unless the status is kOk, `state` is left as it was.
  TipSolution advance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, TipState& state) const noexcept;

  /// Height of the apex at which the sphere, coming straight down on (x, y), first touches the surface.
  double touch_height_nm(double x_nm, double y_nm) const noexcept;

  const Surface& surface() const noexcept { return *surface_; }
  const TipSampleLaw& law() const noexcept { return law_; }
  double tip_radius_nm() const noexcept { return tip_radius_nm_; }

 private:
  TipSolution advance_flat(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn,
                           TipState& state) const noexcept;

  std::shared_ptr<const Surface> surface_;
  TipSampleLaw law_;
  double tip_radius_nm_;
};

}  // namespace telenano::physics
