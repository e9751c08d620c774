#pragma once

#include <memory>
#include <optional>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/contact/friction.h"
#include "telenano/nve_server/physics/equilibrium/tip_solution.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::physics {

/// What is remembered from one step to the next.
struct LevelState {
  TipSampleState law;
  Vec3 apex_w_nm = Vec3::Zero();
  FrictionState friction;
};

/// Quasi-static balance of a tip between springs to a free end x and the level sample z = 0:
///
///   apex p = x + C (F e_z + f),   F = law(overlap −p_z),   f = friction across e_z (friction.h).
///
/// Without friction nothing couples the directions: one step of the law against the compliance C_zz is the
/// answer, branches and jumps included, as exact as the law (tip_sample_law.h).
///
/// With friction the unknowns are the tip's motion m across and the normal force. At a given load F, with the
/// stiffness k and the limit T of its contact, the bristle's trial e = e' + m obeys e = g + C_tt f(e), g = e'
/// + x_t + c F − p_t', e' what it was bent, p' the last apex, c = (C_xz, C_yz). It sticks where e = (1 + k
/// C_tt)⁻¹ g does not reach T; else f = −T n, e = ρ n,
///
///   (ρ + T C_tt) n = g,   |n| = 1,
///
/// whose only root ρ >= T/k is that of the secular equation |(ρ + T C_tt)⁻¹ g| = 1, by Newton's method on its
/// reciprocal, which rises to it from below (J. J. Moré, D. C. Sorensen, SIAM J. Sci. Stat. Comput. 4 (1983)
/// 553); at once where C_tt is isotropic. Springs that are not coupled (c = 0) leave F to one step of the
/// law. On a tilted lever friction lifts the apex by β = c·f: the law is asked at the base −(x_z + β), and β
/// = c·f(β) is found by secants within a bracket. Where it closes round a place at which the law jumps, it
/// jumps, and the balance is sought from there.
///
/// At a kinetic ratio below 1 a contact that slips breaks away: the balance is sought again with the kinetic
/// limit, and what springs, sample and bristle have lost down to that is friction.
///
/// Energy. The free end's work over a step is Δ(U + ½ Fᵀ C F + bristle) + dissipated + friction_dissipated,
/// without friction exactly, with it to first order in the step (backward Euler).
/// Errors. What is left of both equations is below 1e-9 nm and 1e-11 of the springs' extension.
class LevelEquilibrium {
 public:
  /// Throws UserError unless the friction's parameters make sense (friction.h).
  LevelEquilibrium(std::shared_ptr<const TipSampleLaw> law, double tip_radius_nm,
                   const std::optional<FrictionParameters>& friction = {});

  /// Moves the free end to `free_end_w_nm`. No allocation, no throw. Unless the status is kOk, `state` is as
  /// it was.
  TipSolution advance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn,
                      LevelState& state) const noexcept;

  /// The same without friction, where the law alone says what is remembered. Of `solution` it writes what is
  /// not always the same there: begin with a new one.
  void advance_without_friction(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn,
                                TipSampleState& law, TipSolution& solution) const noexcept;

  const TipSampleLaw& law() const noexcept { return *law_; }
  const std::optional<Friction>& friction() const noexcept { return friction_; }

 private:
  struct Search;
  enum class Sought { kFound, kFailed, kJumps };
  void balance_across(Search& at) const noexcept;
  Sought search(Search& at, const TipSampleState& from) const noexcept;

  std::shared_ptr<const TipSampleLaw> law_;
  double tip_radius_nm_;
  std::optional<Friction> friction_;
};

}  // namespace telenano::physics
