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
  particle_ = std::make_unique<ParticleTrial>(
      ParticleTrial{std::move(equilibrium), resting, resting, {}, {}, resting});
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

std::uint32_t TouchedSample::surface_stamp() const noexcept {
  if (marked_) return marked_->surface().stamp();
  const auto* const heights = dynamic_cast<const physics::SplineSurface*>(scene_->surface.get());
  return heights != nullptr ? heights->stamp() : 0;
}

namespace {

template <class Visit, class Solution>
void visit_particle(Visit& visit, Solution& solution) noexcept {
  fields(visit, solution.particle_centre_w_nm);
  visit(solution.held_by_tip);
  visit(solution.on_surface);
}

/// What marks have changed is a list of nodes in rising order: number, then the three values. The hash takes
/// the surface's own digest instead.
void write_marks(StateHash& visit, const physics::SplineSurface& surface,
                 const physics::SplineSurface& /*scan*/) noexcept {
  visit(surface.marks_digest());
}

void write_marks(StateWriter& visit, const physics::SplineSurface& surface,
                 const physics::SplineSurface& scan) noexcept {
  visit(surface.marked());
  int changed = 0;
  const auto each = [&](const auto& found) {
    if (!surface.marked()) return;
    for (int row = 0; row < surface.rows(); ++row) {
      for (int column = 0; column < surface.columns(); ++column) {
        const auto node = surface.node(column, row);
        if (!(node == scan.node(column, row))) found(row * surface.columns() + column, node);
      }
    }
  };
  each([&](int, const auto&) { ++changed; });
  visit(changed);
  each([&](int number, const auto& node) {
    visit(number);
    visit(node.height_coefficient_nm);
    visit(node.relative_curvature);
    visit(node.height_nm);
  });
}

}  // namespace

template <class Visit>
void TouchedSample::write(Visit& visit) const noexcept {
  if (marked_)
    write_marks(visit, marked_->surface(), static_cast<const physics::SplineSurface&>(*scene_->surface));
  if (!particle_) return;
  fields(visit, particle_->state);
  visit_particle(visit, particle_->solution);
}

template void TouchedSample::write(StateHash&) const noexcept;
template void TouchedSample::write(StateWriter&) const noexcept;

void TouchedSample::unmark() noexcept {
  physics::SplineSurface& surface = marked_->surface_to_restore();
  if (!surface.marked()) return;
  const auto& scan = static_cast<const physics::SplineSurface&>(*scene_->surface);
  for (int row = 0; row < surface.rows(); ++row) {
    for (int column = 0; column < surface.columns(); ++column) {
      const auto node = scan.node(column, row);
      if (!(surface.node(column, row) == node)) surface.set_node(column, row, node);
    }
  }
  surface.settle(false);
}

void TouchedSample::reset() noexcept {
  if (marked_) unmark();
  if (!particle_) return;
  particle_->state = particle_->at_first;
  particle_->solution = {};
  particle_->solution.particle_centre_w_nm = particle_->state.particle_centre_w_nm;
  particle_->solution.on_surface = true;
}

bool TouchedSample::read(StateReader& visit) noexcept {
  reset();
  if (marked_) {
    physics::SplineSurface& surface = marked_->surface_to_restore();
    bool marked = false;
    visit(marked);
    int changed = 0;
    const int nodes = surface.rows() * surface.columns();
    if (!count(visit, changed, marked ? nodes : 0)) return false;
    int last = -1;
    for (int i = 0; i < changed && visit.ok(); ++i) {
      int number = 0;
      physics::SplineSurface::Node node;
      visit(number);
      visit(node.height_coefficient_nm);
      visit(node.relative_curvature);
      visit(node.height_nm);
      if (number <= last || number >= nodes || !(node.relative_curvature > 0)) visit.fail();
      if (!visit.ok()) break;
      last = number;
      surface.set_node(number % surface.columns(), number / surface.columns(), node);
    }
    surface.settle(marked);
    visit.surface_stamp = surface.stamp();
  }
  if (particle_ && visit.ok()) {
    physics::ParticleState& state = particle_->state;
    fields(visit, state);
    visit_particle(visit, particle_->solution);
    const auto& laws = particle_->equilibrium.model().laws;
    for (std::size_t i = 0; i < laws.size(); ++i) laws[i].derive(state.contacts[i].law.cache);
  }
  if (!visit.ok()) reset();
  return visit.ok();
}

}  // namespace telenano::slave
