#include "telenano/nve_server/slave/touched_sample.h"

#include <utility>

#include "telenano/common/base/error.h"

namespace telenano::slave {

TouchedSample::TouchedSample(std::shared_ptr<const scene::Scene> scene) : scene_(std::move(scene)) {
  if (scene_->marks) {
    const auto* heights = dynamic_cast<const physics::SplineSurface*>(scene_->surface.get());
    if (heights == nullptr) throw UserError(scene_->path + ": marks need a surface of heights");
    const auto* fields =
        scene_->potential ? dynamic_cast<const physics::ScanFields*>(&scene_->potential->fields()) : nullptr;
    if (fields == nullptr) throw UserError(scene_->path + ": marks need fields on a grid");
    marked_ =
        std::make_unique<physics::MarkedPotential>(*fields, *heights, *scene_->potential, scene_->friction,
                                                   scene_->marks->hardness_gpa, scene_->marks->pile_up);
  }
  if (!scene_->particle) return;
  const scene::Particle& particle = *scene_->particle;
  physics::ParticleEquilibrium equilibrium(
      scene_->surface, particle.parameters,
      {std::make_shared<physics::TipPotential>(scene_->potential->tip_potential()), scene_->particle_ground});
  const physics::ParticleState resting = equilibrium.place(particle.x_nm, particle.y_nm);
  physics::TipBesideSleeper beside(equilibrium.model(), equilibrium.little_pull_nn());
  particle_ = std::make_unique<ParticleTrial>(
      ParticleTrial{std::move(equilibrium), {resting, resting}, {}, resting, std::move(beside), {}, {}});
  particle_->solution().particle_centre_w_nm = resting.particle_centre_w_nm;
  particle_->solution().on_surface = true;
}

physics::TipSolution TouchedSample::advance_both(const Vec3& free_end, const physics::Compliance& springs,
                                                 double dt_s, physics::PotentialState& state) noexcept {
  ParticleTrial& p = *particle_;
  p.trial_alone = p.alone && advance_alone(free_end, springs, state);
  if (p.trial_alone) return p.trial_solution().tip;
  p.trial_state() = p.state();
  if (p.alone && p.begun) p.beside.end(state, p.solution().tip, p.pull, p.trial_state());
  p.springs = springs;
  p.equilibrium.advance_in_place(free_end, springs, dt_s, p.trial_state(), p.trial_solution());
  return p.trial_solution().tip;
}

// The particle sleeps: the tip beside it. False: it wakes, `state` is what it was.
bool TouchedSample::advance_alone(const Vec3& free_end, const physics::Compliance& springs,
                                  physics::PotentialState& state) noexcept {
  ParticleTrial& p = *particle_;
  if (!p.begun) p.beside.begin(p.state(), p.solution(), p.springs, state);
  return p.beside.advance(free_end, springs, p.state(), p.trial_pull, state, p.trial_solution().tip);
}

physics::TipSolution TouchedSample::advance(const Vec3& free_end, const physics::Compliance& springs,
                                            double dt_s, physics::PotentialState& state) noexcept {
  if (particle_) return advance_both(free_end, springs, dt_s, state);
  if (marked_) return marked_->advance(free_end, springs, state);
  return scene_->potential->advance(free_end, springs, state);
}

void TouchedSample::accept(const physics::TipSolution& accepted) noexcept {
  if (marked_) marked_->accept(accepted);
  if (!particle_) return;
  ParticleTrial& p = *particle_;
  if (p.trial_alone) {
    p.begun = true;
    std::swap(p.pull, p.trial_pull);
    p.beside.describe(p.trial_solution().tip, p.pull, p.solution());
    return;
  }
  p.now = 1 - p.now;
  p.alone = p.beside.may_begin(p.state());
  p.begun = false;
  if (!p.alone) return;
  p.pull = {};  // nothing of an earlier sleep is state
  p.pull.memory = p.trial_pull.memory = p.state().contacts[physics::kTipParticle].law;
}

namespace {

template <class Visit, class Solution>
void visit_particle(Visit& visit, Solution& solution) noexcept {
  fields(visit, solution.particle_centre_w_nm);
  visit(solution.held_by_tip);
  visit(solution.on_surface);
}

/// What its contacts and the ground remember of each other.
template <class Visit, class Trial>
void visit_particle_ground(Visit& visit, Trial& p) noexcept {
  for (auto& contact : p.state().contacts) {
    fields(visit, contact.place);
    fields(visit, contact.hint);
  }
  fields(visit, p.state().sleep.push_w_nn);
  fields(visit, p.solution().contacts[physics::kTipParticle].force_w_nn);
}

/// The tip beside a particle that sleeps: what the next step, or the particle's first one awake, begins from.
template <class Visit, class Trial>
void visit_sleeper(Visit& visit, Trial& p) noexcept {
  visit(p.alone);
  visit(p.begun);
  if (!p.alone) return;
  fields(visit, p.springs);
  // The two take turns: what the trial's law begins from is of two steps ago, and so are its last bits.
  law_fields(visit, p.pull.memory, false);
  law_fields(visit, p.trial_pull.memory, false);
  fields(visit, p.pull.law);
  fields(visit, p.solution().tip);
  auto& report = p.solution().contacts[physics::kTipSample];
  visit(report.normal_force_nn);
  visit(report.overlap_nm);
  visit(report.stiffness_n_m);
  visit(report.radius_nm);
}

/// What marks have changed is a list of nodes in rising order: number, then both values. The hash takes
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
    visit(node.height_nm);
  });
}

/// The same of the fields: the coefficients that marks have changed.
void write_marks(StateHash& visit, const physics::ScanFields& fields) noexcept {
  visit(fields.marks_digest());
}

void write_marks(StateWriter& visit, const physics::ScanFields& fields) noexcept {
  int changed = 0;
  fields.each_pressed([&](const auto&) { ++changed; });
  visit(changed);
  fields.each_pressed([&](const physics::ScanFields::Pressed& pressed) {
    visit(static_cast<int>(pressed.grid));
    visit(static_cast<int>(pressed.number));
    for (const double value : pressed.value) visit(value);
  });
}
constexpr std::size_t kPressedBytes = 4 + 4 + 4 * 8;

bool read_marks(StateReader& visit, physics::ScanFields& to) noexcept {
  int changed = 0;
  if (!count(visit, changed, static_cast<int>(to.pressable()))) return false;
  std::int64_t last = -1;
  for (int i = 0; i < changed && visit.ok(); ++i) {
    int grid = 0, number = 0;
    physics::ScanFields::Pressed pressed;
    visit(grid);
    visit(number);
    for (double& value : pressed.value) visit(value);
    const std::int64_t place = (static_cast<std::int64_t>(grid) << 32) + number;
    if (grid < 0 || number < 0 || place <= last) visit.fail();
    last = place;
    pressed.grid = static_cast<std::uint32_t>(grid);
    pressed.number = static_cast<std::uint32_t>(number);
    if (!visit.ok() || !to.set_pressed(pressed)) visit.fail();
  }
  return visit.ok();
}

template <class Visit, class Last>
void visit_last_step(Visit& visit, Last& last) noexcept {
  visit(last.known);
  if (!last.known) return;
  visit(last.under_way);
  fields(visit, last.force_w_nn);
  fields(visit, last.apex_w_nm);
  visit(last.potential_aj);
  visit(last.friction_stored_aj);
}

}  // namespace

std::size_t TouchedSample::mark_bytes_max() const noexcept {
  const physics::SplineSurface* const surface = marked_surface();
  if (surface == nullptr) return 0;
  constexpr std::size_t kNodeBytes = 20;
  const std::size_t nodes =
      static_cast<std::size_t>(surface->rows()) * static_cast<std::size_t>(surface->columns());
  return kNodeBytes * nodes + kPressedBytes * marked_->fields().pressable();
}

template <class Visit>
void TouchedSample::write(Visit& visit) const noexcept {
  if (marked_) {
    write_marks(visit, marked_->surface(), static_cast<const physics::SplineSurface&>(*scene_->surface));
    write_marks(visit, marked_->fields());
    visit_last_step(visit, marked_->last_step());
  }
  if (!particle_) return;
  fields(visit, particle_->state());
  visit_particle(visit, particle_->solution());
  visit_sleeper(visit, std::as_const(*particle_));
  visit_particle_ground(visit, std::as_const(*particle_));
}

template void TouchedSample::write(StateHash&) const noexcept;
template void TouchedSample::write(StateWriter&) const noexcept;

void TouchedSample::unmark() noexcept {
  marked_->fields_to_restore().unmark();
  marked_->set_last_step({});
  marked_->forget_strokes();
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
  particle_->state() = particle_->at_first;
  particle_->alone = particle_->begun = false;
  particle_->pull = particle_->trial_pull = {};
  particle_->solution() = {};
  particle_->solution().particle_centre_w_nm = particle_->state().particle_centre_w_nm;
  particle_->solution().on_surface = true;
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
      visit(node.height_nm);
      if (number <= last || number >= nodes) visit.fail();
      if (!visit.ok()) break;
      last = number;
      surface.set_node(number % surface.columns(), number / surface.columns(), node);
    }
    surface.settle(marked);
  }
  if (marked_ && visit.ok() && read_marks(visit, marked_->fields_to_restore())) {
    physics::MarkedPotential::LastStep last;
    visit_last_step(visit, last);
    if (visit.ok()) marked_->set_last_step(last);
  }
  if (particle_ && visit.ok()) {
    physics::ParticleState& state = particle_->state();
    fields(visit, state);
    visit_particle(visit, particle_->solution());
    visit_sleeper(visit, *particle_);
    visit_particle_ground(visit, *particle_);
    const auto& laws = particle_->equilibrium.model().laws;
    for (std::size_t i = 0; i < laws.size(); ++i) laws[i].derive(state.contacts[i].law.cache);
    laws[physics::kTipParticle].derive(particle_->pull.memory.cache);
    laws[physics::kTipParticle].derive(particle_->trial_pull.memory.cache);
  }
  if (!visit.ok()) reset();
  return visit.ok();
}

}  // namespace telenano::slave
