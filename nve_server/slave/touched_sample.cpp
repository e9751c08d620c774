#include "nve_server/slave/touched_sample.h"

#include <utility>

#include "common/base/error.h"

namespace telenano::slave {

TouchedSample::TouchedSample(std::shared_ptr<const scene::Scene> scene) : scene_(std::move(scene)) {
  if (scene_->marks) {
    const auto* heights = dynamic_cast<const physics::SplineSurface*>(scene_->surface.get());
    if (heights == nullptr) throw UserError(scene_->path + ": marks need a surface of heights");
    if (scene_->potential) {
      const auto* fields = dynamic_cast<const physics::ScanFields*>(&scene_->potential->fields());
      if (fields == nullptr) throw UserError(scene_->path + ": marks need fields on a grid");
      marked_potential_ =
          std::make_unique<physics::MarkedPotential>(*fields, *heights, *scene_->potential, scene_->friction,
                                                     scene_->marks->hardness_gpa, scene_->marks->pile_up);
    } else {
      physics::EquilibriumOptions options = scene_->equilibrium->options();
      options.hardness_gpa = scene_->marks->hardness_gpa;
      marked_ = std::make_unique<physics::MarkedSample>(*heights, scene_->equilibrium->law(),
                                                        scene_->probe.tip_radius_nm, options);
    }
  }
  if (!scene_->particle) return;
  const scene::Particle& particle = *scene_->particle;
  physics::ParticleEquilibrium equilibrium(scene_->surface, particle.parameters);
  const physics::ParticleState resting = equilibrium.place(particle.x_nm, particle.y_nm);
  physics::TipBesideSleeper beside(scene_->surface, equilibrium.model(), equilibrium.little_pull_nn());
  particle_ = std::make_unique<ParticleTrial>(
      ParticleTrial{std::move(equilibrium), resting, resting, {}, {}, std::move(beside), {}, {}});
  particle_->solution.particle_centre_w_nm = resting.particle_centre_w_nm;
  particle_->solution.on_surface = true;
}

physics::TipSolution TouchedSample::advance(const Vec3& free_end, const physics::Compliance& springs,
                                            double dt_s, physics::TipState& state) noexcept {
  if (!particle_) {
    const physics::TipEquilibrium& equilibrium = marked_ ? marked_->equilibrium() : *scene_->equilibrium;
    return equilibrium.advance(free_end, springs, state);
  }
  ParticleTrial& p = *particle_;
  p.trial_alone = p.alone && advance_alone(free_end, springs, state);
  if (p.trial_alone) return p.trial_solution.tip;
  p.trial_state = p.state;
  if (p.alone && p.begun) p.beside.end(state, p.solution.tip, p.pull, p.trial_state);
  p.springs = springs;
  p.trial_solution = p.equilibrium.advance(free_end, springs, dt_s, p.trial_state);
  return p.trial_solution.tip;
}

// The particle sleeps: the tip beside it. False: it wakes, `state` is what it was.
bool TouchedSample::advance_alone(const Vec3& free_end, const physics::Compliance& springs,
                                  physics::TipState& state) noexcept {
  ParticleTrial& p = *particle_;
  if (!p.begun) p.beside.begin(p.state, p.solution, p.springs, state);
  return p.beside.advance(free_end, springs, p.state, p.trial_pull, state, p.trial_solution.tip);
}

physics::TipSolution TouchedSample::advance(const Vec3& free_end, const physics::Compliance& springs,
                                            physics::PotentialState& state) noexcept {
  if (marked_potential_) return marked_potential_->advance(free_end, springs, state);
  return scene_->potential->advance(free_end, springs, state);
}

void TouchedSample::accept(const physics::TipSolution& accepted) noexcept {
  if (marked_potential_) marked_potential_->accept(accepted);
  if (marked_) marked_->press(accepted.yielded);
  if (!particle_) return;
  ParticleTrial& p = *particle_;
  if (p.trial_alone) {
    p.begun = true;
    std::swap(p.pull, p.trial_pull);
    p.beside.describe(p.trial_solution.tip, p.pull, p.solution);
    return;
  }
  p.state = p.trial_state;
  p.solution = p.trial_solution;
  p.alone = p.beside.may_begin(p.state);
  p.begun = false;
  if (p.alone) p.pull.memory = p.trial_pull.memory = p.state.contacts[physics::kTipParticle].law;
}

}  // namespace telenano::slave
