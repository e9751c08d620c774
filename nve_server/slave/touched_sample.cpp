#include "nve_server/slave/touched_sample.h"

#include <utility>

#include "common/base/error.h"

namespace telenano::slave {

TouchedSample::TouchedSample(std::shared_ptr<const scene::Scene> scene) : scene_(std::move(scene)) {
  if (scene_->marks) {
    const auto* heights = dynamic_cast<const physics::SplineSurface*>(scene_->surface.get());
    if (heights == nullptr) throw UserError(scene_->path + ": marks need a surface of heights");
    physics::EquilibriumOptions options = scene_->equilibrium->options();
    options.hardness_gpa = scene_->marks->hardness_gpa;
    marked_ = std::make_unique<physics::MarkedSample>(*heights, scene_->equilibrium->law(),
                                                      scene_->probe.tip_radius_nm, options);
  }
  if (!scene_->particle) return;
  const scene::Particle& particle = *scene_->particle;
  physics::ParticleEquilibrium equilibrium(scene_->surface, particle.parameters);
  const physics::ParticleState resting = equilibrium.place(particle.x_nm, particle.y_nm);
  particle_ =
      std::make_unique<ParticleTrial>(ParticleTrial{std::move(equilibrium), resting, resting, {}, {}});
  particle_->solution.particle_centre_w_nm = resting.particle_centre_w_nm;
  particle_->solution.on_surface = true;
}

physics::TipSolution TouchedSample::advance(const Vec3& free_end, const physics::Compliance& springs,
                                            double dt_s, physics::TipState& state) noexcept {
  if (!particle_) {
    const physics::TipEquilibrium& equilibrium = marked_ ? marked_->equilibrium() : *scene_->equilibrium;
    return equilibrium.advance(free_end, springs, state);
  }
  particle_->trial_state = particle_->state;
  particle_->trial_solution = particle_->equilibrium.advance(free_end, springs, dt_s, particle_->trial_state);
  return particle_->trial_solution.tip;
}

void TouchedSample::accept(const physics::TipSolution& accepted) noexcept {
  if (marked_) marked_->press(accepted.yielded);
  if (!particle_) return;
  particle_->state = particle_->trial_state;
  particle_->solution = particle_->trial_solution;
}

}  // namespace telenano::slave
