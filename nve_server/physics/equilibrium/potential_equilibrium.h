#pragma once

#include <memory>
#include <optional>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/contact/friction.h"
#include "telenano/nve_server/physics/equilibrium/path_trend.h"
#include "telenano/nve_server/physics/equilibrium/spring_frame.h"
#include "telenano/nve_server/physics/equilibrium/tip_solution.h"
#include "telenano/nve_server/physics/potential/tip_potential.h"

namespace telenano::physics {

/// What is remembered from one step to the next.
struct PotentialState {
  bool started = false;
  PotentialBranch branch;
  bool under_way = false;    ///< not yet in a minimum: the descent goes on in the next step
  bool broken_away = false;  ///< on that way friction is the kinetic one
  Vec3 free_end_w_nm = Vec3::Zero();
  Vec3 apex_w_nm = Vec3::Zero();
  CurveHint hint;
  Mat3 follow = Mat3::Identity();  ///< ∂apex/∂(free end)
  PathTrend trend;
  /// Of a Newton step, over the square of the one before it: the last one that was seen, a little more for
  /// each step since. 0: none.
  double convergence_per_nm = 0;
  FrictionState bristle;
  SpringFrame springs;
};

/// Quasi-static balance of the tip between springs to a free end x and a sample that is one potential a
/// branch (tip_potential.h):
///
///   E_b(p) = ½ (p − x)ᵀ K (p − x) + U_b(p) + bristle,
///
/// K the inverse of the springs' compliance (where that is rigid, p moves with x). The tip stays in a local
/// minimum of E_b as long as there is one.
///
/// Step. 1. Follow: from p + (∂p/∂x) Δx and the last step's parabola Newton's method with the exact Hessian,
///          accepted if ∇∇E is positive definite at each iterate, if steps contract and the first is no
///          longer than the predictor's own error (a Newton step that reaches the next basin would leave a
///          hole in the account), and if no border of the branch is passed but one that is used both ways.
///       2. Else in halves, twice at most.
///       3. Else the held move and the descent: the free end moves with the tip held, then E falls at held x,
///          by a trust-region Newton method that takes a step only if E falls, through the borders of the
///          branches, to a local minimum. Snap-in, pull-off, lateral slides, a bridge that forms or ruptures
///          and stick–slip are all this.
///
/// Friction (friction.h) acts in the plane across −∇δ, its contact radius a field of the apex too. On the
/// way it is backward Euler's bristle, with its tangent in Newton's matrix. In a descent stiffness k and
/// limit T are held as they are where it begins: friction then is the convex potential k e²/2 up to e = T/k
/// and T e − T²/2k beyond, and E with it still falls. At the end the bristle is put on the contact as that
/// is there, what this sets free is counted as friction, and the descent is repeated until k rests (three
/// times at most). At a kinetic ratio r < 1 a contact that slips breaks away: a descent at the static limit
/// that slips goes on at r T, the bristle's loss down to that is friction, and where it comes to rest the
/// contact holds up to T again.
///
/// Energy. What is lost is E before the descent less E after it, ≥ 0 by construction, in dissipated_aj; the
/// free end's work over a step is Δ(U + ½ Fᵀ C F + bristle) + both that are dissipated (with friction to
/// first order in the step: backward Euler). On a smooth way nothing is lost. A held move
/// calls some smooth work lost, of second order in its length. A descent may be interrupted after any
/// iteration: the account is closed there too, `under_way` says so, the springs tell the force, and the next
/// step goes on. A step takes at most kMostEvaluations evaluations of the potential, so that none lasts
/// long.
///
/// Errors. Newton's last step is below 1e-9 nm, or foreseen to leave no more; energy and force are those at
/// its end to second and first order. Springs that are rigid in some direction push the tip through a border
/// with what that changes in U counted as work, not as loss.
class PotentialEquilibrium {
 public:
  static constexpr int kMostEvaluations = 60;

  PotentialEquilibrium(std::shared_ptr<const ContactFields> fields,
                       std::shared_ptr<const BranchPotential> potential,
                       const std::optional<FrictionParameters>& friction = {});

  /// Moves the free end to `free_end_w_nm`. The first call places the tip there, wherever that is, and lets
  /// it come to rest with nothing counted. No allocation, no throw. Unless the status is kOk (arguments or
  /// energies that are no numbers), `state` is left as it was. `jolt_w_nm`: by which the apex is expected to
  /// move because the ground has changed since the last step; costs time where it is wrong, and nothing else.
  TipSolution advance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, PotentialState& state,
                      const Vec3& jolt_w_nm = Vec3::Zero()) const noexcept;

  /// Height of the apex over (x, y) at which the overlap is 0: the closed form's or the fields' own touch.
  double touch_height_nm(double x_nm, double y_nm, double highest_nm) const noexcept;

  const TipPotential& tip_potential() const noexcept { return potential_; }
  const BranchPotential& potential() const noexcept { return potential_.potential(); }
  const std::shared_ptr<const BranchPotential>& shared_potential() const noexcept {
    return potential_.shared_potential();
  }
  const ContactFields& fields() const noexcept { return potential_.fields(); }
  const std::shared_ptr<const ContactFields>& shared_fields() const noexcept {
    return potential_.shared_fields();
  }

 private:
  TipPotential potential_;
  std::optional<Friction> friction_;
};

}  // namespace telenano::physics
