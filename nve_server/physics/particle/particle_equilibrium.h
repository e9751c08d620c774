#pragma once

#include <array>
#include <memory>

#include "telenano/nve_server/physics/equilibrium/tip_solution.h"
#include "telenano/nve_server/physics/particle/particle_model.h"
#include "telenano/nve_server/physics/particle/particle_state.h"

namespace telenano::physics {

class ParticleBalance;

/// One of the three contacts, as it is after a step. Forces act on the upper body: on the tip from the
/// sample, on the particle from the tip, on the particle from the sample.
struct ParticleContactReport {
  Branch branch = Branch::kFree;
  double overlap_nm = 0;
  double radius_nm = 0;  ///< effective
  double contact_radius_nm = 0;
  double normal_force_nn = 0;  ///< repulsive positive
  double stiffness_n_m = 0;
  Vec3 normal_w = Vec3::UnitZ();
  Vec3 force_w_nn = Vec3::Zero();     ///< normal and friction
  Vec3 friction_w_nn = Vec3::Zero();  ///< of it
  Vec3 rolling_w_nn_nm = Vec3::Zero();
  Vec3 spinning_w_nn_nm = Vec3::Zero();
  bool slides = false;
  bool rolls = false;
  bool touches() const noexcept { return branch == Branch::kContact || branch == Branch::kNonContact; }
};

struct ParticleSolution {
  SolveStatus status = SolveStatus::kOk;
  /// What a probe feels: apex, force on the tip of all contacts, energies; branch, overlap and radii are of
  /// the tip–sample contact, or of the tip–particle one where that force is larger. potential_aj is of
  /// contacts and bristles, without the springs; dissipated_aj as below.
  TipSolution tip;
  Vec3 particle_centre_w_nm = Vec3::Zero();
  Vec3 turned_w_rad = Vec3::Zero();  ///< of the particle in this step
  std::array<ParticleContactReport, kParticleContacts> contacts;
  bool held_by_tip = false;  ///< tip and particle touch
  bool on_surface = false;   ///< particle and sample touch
  double friction_loss_aj = 0;
  double drag_loss_aj = 0;
  double jump_loss_aj = 0;
  double dissipated_aj = 0;  ///< the sum of these three, each >= 0
  int substeps = 0;
  int iterations = 0;
};

inline constexpr double kSleepError = 1e-6;  ///< of the pull-off of particle and sample

/// Tip, particle and sample: a sphere on the surface with adhesion and friction, pushed, rolled, picked up or
/// lost by the tip as the forces decide. Small steps are balanced by ParticleBalance (particle_balance.h).
///
/// Sub-steps The free end goes in steps of at most kSubstepRadii of the smaller sphere, or half the gap
///           between tip and particle where that is more; so the tip never passes through the particle. A
///           step that does not converge is tried again in quarters.
/// Energy    Over a step, with the work W = −½(F₀ + F₁)·Δx of the free end and U all that is stored,
///             dissipated = friction + drag + jumps,
///           jumps = W − ΔU − friction − drag when a branch ended or a state became unstable, never below 0.
///           ΔU + dissipated is what the step costs the operator: U is a function of the state and the losses
///           are not negative, so no path draws more than was put in. What is left is the step's error.
/// Compliance kLeastCompliance is added in all directions, so that rigid directions need no code of their
///           own. Where it changes between two steps, the step begins at the free end that would hold the tip
///           where it was.
/// Sleep     A particle that rests on the sample while the tip is far is not balanced anew: the tip is
///           balanced alone, with the force of the particle where it lies. It falls asleep after a step in
///           which it hardly moved, nothing slipped, and the tip did not touch it and pulled with less than
///           5e-5 of the pull-off of particle and sample, and than half a hundredth of what its sliding and
///           rolling friction hold (0 without friction: then only a tip that is not felt lets it sleep). It
///           wakes, and the step is made anew, when the tip pulls twice that or touches it. What is left out
///           is how the pull F strains its contact, by F/k: of the force on the tip dF/dd F/k, below
///           kSleepError of the pull-off; of the energy F²/2k. A new state is awake. The surface does not
///           change under a particle; who makes it do so must wake() it.
/// Errors    Smooth steps: W − ΔU − losses is of second order in the step, of first where a friction limit
///           changes while it slips. A particle squeezed out from under the tip over many radii may find no
///           balance within a step (some 2 in 1000 of random steps to 1 µm): the state stays, kNotConverged.
/// Limits    The three contacts do not see each other (no shared elastic field, no many-body van der Waals).
///           One contact law, friction and rolling for each pair, on a rough surface that of the fields
///           (contact_fields.h): leaving a floor for an edge breaks no second contact. The particle's weight
///           is nothing at this scale (0.1 fN at 100 nm). The friction's stiffness has no share in the normal
///           force. A tip whose springs can hold several states takes the one downhill. Rolling is measured
///           against the frame W: on a surface curved as strongly as the particle, the turning of the normal
///           along the way is not counted.
class ParticleEquilibrium {
 public:
  /// Throws UserError unless radii, laws and frictions make sense.
  ParticleEquilibrium(std::shared_ptr<const Surface> surface, const ParticleParameters& parameters,
                      const ParticleGround& ground);

  /// The particle resting at (x, y), where its force has no part along z; the tip not there yet. For set-up,
  /// not for loops.
  ParticleState place(double x_nm, double y_nm) const noexcept;

  /// Moves the tip's free end (which belongs to its apex) to `free_end_w_nm` in `dt_s`. Unless the status is
  /// kOk, `state` is left as it was and the force is zero.
  ParticleSolution advance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, double dt_s,
                           ParticleState& state) const noexcept;
  /// The same in place, without copies: `state` means nothing unless the status is kOk.
  void advance_in_place(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, double dt_s,
                        ParticleState& state, ParticleSolution& out) const noexcept;

  static void wake(ParticleState& state) noexcept { state.sleep.asleep = false; }

  const ParticleModel& model() const noexcept { return model_; }
  /// Of the tip, that wakes a particle.
  double little_pull_nn() const noexcept { return little_pull_nn_; }

 private:
  bool rests(const ParticleBalance& balance) const noexcept;
  bool left_alone(const ParticleBalance& balance, double share) const noexcept;
  void take(const ParticleBalance& balance, const Mat3& soft, const Vec3& carried_nm, bool counts,
            ParticleState& now, ParticleSolution& out) const noexcept;

  ParticleModel model_;
  double little_pull_nn_ = 0;  // of the tip at a particle that sleeps
};

}  // namespace telenano::physics
