#pragma once

#include <optional>

#include "telenano/nve_server/physics/equilibrium/held_friction.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/equilibrium/spring_frame.h"
#include "telenano/nve_server/physics/potential/tip_potential.h"

namespace telenano::physics {

/// One step of a PotentialEquilibrium: the free end's way, and the tip's. follow() and hold() + descend() are
/// the ways there are; write() tells what came of it.
class PotentialWalk {
 public:
  PotentialWalk(const TipPotential& potential, const std::optional<Friction>& friction,
                const PotentialState& from) noexcept;

  /// Puts free end and tip there, outside and dry.
  void place(const Vec3& x_w_nm) noexcept;
  /// The balance as the continuation of the last one; `bend` beside what the last ∂p/∂x says. False: nothing
  /// has happened but evaluations.
  bool follow(const Vec3& to_x_w_nm, const Vec3& bend_w_nm) noexcept;
  /// The free end goes on, the tip stays, but for where it is rigidly held.
  void hold(const Vec3& to_x_w_nm) noexcept;
  /// Down to a local minimum of E at the free end. False: interrupted.
  bool descend() noexcept;
  /// Before a solution without a balance: what is where the tip is. False: nowhere that can be.
  bool look() noexcept;

  void write(TipSolution& out) const noexcept;
  void write(PotentialState& out) const noexcept;

  void allow(int evaluations) noexcept { most_ = evaluations; }
  void forget_losses() noexcept;
  bool spent() const noexcept { return evaluations_ >= most_; }
  const Vec3& apex() const noexcept { return p_; }
  const Mat3& rate() const noexcept { return follow_; }  ///< ∂apex/∂(free end), of a balance
  const PotentialSample& here() const noexcept { return at_; }
  bool finite() const noexcept { return finite_; }

 private:
  BranchEnd sample(const Vec3& q, const PotentialBranch& branch, CurveHint& hint,
                   PotentialSample& at) noexcept {
    ++evaluations_;
    return potential_.sample(q, branch, hint, at);
  }
  bool arrive(const Vec3& q, PotentialBranch& branch, CurveHint& hint, PotentialSample& at,
              bool& jumps) noexcept;
  bool was_reversible() const noexcept;
  bool fall() noexcept;
  double energy_at(const Vec3& q, const PotentialSample& at) const noexcept {
    return at.energy_aj + springs_.energy_aj(q - x_) + held_.energy_aj(q);
  }
  bool may_stick_and_slip() const noexcept { return friction_->parameters().kinetic_ratio < 1.0; }
  void rest_on(const FrictionStep& step, const FrictionState& after) noexcept;
  void hold_friction() noexcept;
  bool let_go() noexcept;
  void settle(const Vec3& q, const Vec3& step, const PotentialSample& at, const Mat3& inverse) noexcept;

  const TipPotential& potential_;
  const std::optional<Friction>& friction_;
  const SpringFrame& springs_;
  Vec3 x_, p_;
  PotentialBranch branch_;
  CurveHint hint_;
  Mat3 follow_;
  double convergence_;  // per nm
  FrictionState bristle_;
  HeldFriction held_;
  bool broken_ = false;
  double rubbed_ = 0;
  bool sliding_ = false;
  PotentialSample at_;
  bool finite_ = true;
  Vec3 force_ = Vec3::Zero();
  bool balanced_ = false;
  double lost_ = 0;
  int jumps_ = 0;
  int evaluations_ = 0;
  int most_;
};

}  // namespace telenano::physics
