#pragma once

#include <memory>
#include <optional>

#include "nve_server/physics/particle_equilibrium.h"
#include "nve_server/physics/tip_equilibrium.h"
#include "nve_server/scene/scene.h"

namespace telenano::slave {

/// What the tip of one session touches: the scene's sample, shared by all sessions, and what is this session's
/// own, a particle. Trials change nothing until one is accepted.
class TouchedSample {
 public:
  explicit TouchedSample(std::shared_ptr<const scene::Scene> scene);

  /// Moves the free end of the springs as TipEquilibrium::advance does, within `dt_s`. Energies of the solution
  /// are those of everything that is touched: `potential_aj` and `friction_stored_aj` stored, `dissipated_aj` and
  /// `friction_dissipated_aj` lost in this step.
  physics::TipSolution advance(const Vec3& free_end_w_nm, const physics::Compliance& springs, double dt_s,
                               physics::TipState& state) noexcept;
  /// The last trial is what happened.
  void accept() noexcept;

  /// Of the last trial accepted; null without a particle.
  const physics::ParticleSolution* particle() const noexcept { return particle_ ? &particle_->solution : nullptr; }

 private:
  struct ParticleTrial {
    physics::ParticleEquilibrium equilibrium;
    physics::ParticleState state;
    physics::ParticleState trial_state;
    physics::ParticleSolution solution;
    physics::ParticleSolution trial_solution;
  };

  std::shared_ptr<const scene::Scene> scene_;
  std::unique_ptr<ParticleTrial> particle_;
};

}  // namespace telenano::slave
