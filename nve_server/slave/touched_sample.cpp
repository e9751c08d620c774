#include "nve_server/slave/touched_sample.h"

#include <utility>

namespace telenano::slave {

TouchedSample::TouchedSample(std::shared_ptr<const scene::Scene> scene) : scene_(std::move(scene)) {
  if (!scene_->particle) return;
  const scene::Particle& particle = *scene_->particle;
  physics::ParticleEquilibrium equilibrium(scene_->surface, particle.parameters);
  const physics::ParticleState resting = equilibrium.place(particle.x_nm, particle.y_nm);
  particle_ = std::make_unique<ParticleTrial>(ParticleTrial{std::move(equilibrium), resting, resting, {}, {}});
  particle_->solution.particle_centre_w_nm = resting.particle_centre_w_nm;
  particle_->solution.on_surface = true;
}

physics::TipSolution TouchedSample::advance(const Vec3& free_end, const physics::Compliance& springs, double dt_s,
                                            physics::TipState& state) noexcept {
  if (!particle_) return scene_->equilibrium->advance(free_end, springs, state);
  particle_->trial_state = particle_->state;
  particle_->trial_solution = particle_->equilibrium.advance(free_end, springs, dt_s, particle_->trial_state);
  return particle_->trial_solution.tip;
}

void TouchedSample::accept() noexcept {
  if (!particle_) return;
  particle_->state = particle_->trial_state;
  particle_->solution = particle_->trial_solution;
}

}  // namespace telenano::slave
