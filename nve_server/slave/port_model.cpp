#include "telenano/nve_server/slave/port_model.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::slave {
namespace {

// The walk that finds the contact without load and where it lets go: in contact over this many of the law's
// own lengths, where a Maugis contact of any λ rests and ends; that many steps a length.
constexpr double kWalkLengths = 4;
constexpr double kWalkLeastNm = 20;
constexpr int kWalkSteps = 4000;
constexpr int kOctaves = 3;  // of effective radius to either side of the tip's
// Of a well: the walk steps over its deepest point by less than a step, where the potential is level.
constexpr double kWellMargin = 1e-3;

bool same(const link::LocalModel& a, const link::LocalModel& b) noexcept {
  return a.point_w_nm == b.point_w_nm && a.normal_w == b.normal_w && a.stiffness_n_m == b.stiffness_n_m &&
         a.adhesion_nn == b.adhesion_nn && a.shear_stiffness_n_m == b.shear_stiffness_n_m &&
         a.friction_nn == b.friction_nn;
}

// How deep the law's potential is: from far away down to where the contact bears no load, displacement
// controlled.
double well_aj(const physics::TipSampleLaw& law, double radius_nm) {
  const double reach_nm = std::max(kWalkLeastNm, kWalkLengths * law.scales(radius_nm).overlap_nm);
  const double step_nm = reach_nm / kWalkSteps;
  physics::TipSampleState state;
  double deepest_aj = 0;
  for (double base_nm = -reach_nm; base_nm < reach_nm; base_nm += step_nm) {
    const physics::Equilibrium eq = law.advance(base_nm, 0, radius_nm, state);
    if (eq.status != physics::SolveStatus::kOk) continue;
    deepest_aj = std::max(deepest_aj, -eq.potential_aj);
    if (eq.branch == physics::Branch::kContact && eq.force_nn >= 0) break;
  }
  return deepest_aj * (1 + kWellMargin);
}

// Down until the contact pushes and up until it lets go.
PortGround::Rest walked(const physics::TipSampleLaw& law, double spring_nm_nn, double radius_nm) {
  PortGround::Rest rest;
  const double reach_nm = std::max(kWalkLeastNm, kWalkLengths * law.scales(radius_nm).overlap_nm);
  const double step_nm = reach_nm / kWalkSteps;
  physics::TipSampleState state;
  double base_nm = -reach_nm;
  for (; base_nm < reach_nm && !(rest.stiffness_n_m > 0); base_nm += step_nm) {
    const physics::Equilibrium eq = law.advance(base_nm, spring_nm_nn, radius_nm, state);
    if (eq.branch != physics::Branch::kContact || !(eq.force_nn >= 0) || !(eq.stiffness_n_m > 0)) continue;
    rest.overlap_nm = eq.overlap_nm - eq.force_nn / eq.stiffness_n_m;
    rest.stiffness_n_m = eq.stiffness_n_m;
  }
  for (int i = 0; i < 4 * kWalkSteps; ++i, base_nm -= step_nm) {
    const physics::Equilibrium eq = law.advance(base_nm, spring_nm_nn, radius_nm, state);
    if (eq.branch != physics::Branch::kContact) break;
    rest.pull_off_nn = std::max(rest.pull_off_nn, -eq.force_nn);
  }
  return rest;
}

// The largest effective radius that the law is ever given.
double largest_radius_nm(const scene::Scene& scene) {
  const double radius_nm = scene.probe.tip_radius_nm;
  if (scene.surface->is_flat()) return radius_nm;
  const auto* const fields =
      scene.potential ? dynamic_cast<const physics::ScanFields*>(&scene.potential->fields()) : nullptr;
  // A closed shape rises: nowhere is the tip on two feet of more than its own radius each.
  return fields != nullptr ? det_exp(fields->largest_log_radius()) : 2.0 * radius_nm;
}

}  // namespace

PortGround::PortGround(const scene::Scene& scene)
    : tip_radius_nm_(scene.probe.tip_radius_nm), first_radius_nm_(tip_radius_nm_) {
  const physics::TipSampleLaw& law = scene.law();
  const double spring_nm_nn = scene.port_compliance_nm_nn()(2, 2);
  int octaves = 0;
  if (scene.potential) {
    first_radius_nm_ /= 1 << kOctaves;
    octaves = 2 * kOctaves;
  }
  for (int i = 0; i <= octaves; ++i) rests_.push_back(walked(law, spring_nm_nn, first_radius_nm_ * (1 << i)));
  well_radius_nm_ = largest_radius_nm(scene);
  well_aj_ = slave::well_aj(law, well_radius_nm_);
  if (scene.particle) {
    const physics::ParticleParameters& p = scene.particle->parameters;
    well_aj_ +=
        slave::well_aj(physics::TipSampleLaw(p.tip_particle),
                       p.tip_radius_nm * p.particle_radius_nm / (p.tip_radius_nm + p.particle_radius_nm));
  }
}

PortGround::Rest PortGround::rest(double radius_nm) const noexcept {
  if (rests_.size() == 1) {
    Rest level = rests_[0];
    level.pull_off_nn *= radius_nm / tip_radius_nm_;  // every term goes with R
    return level;
  }
  const double octave = std::clamp(det_log(radius_nm / first_radius_nm_) / det_log(2.0), 0.0,
                                   static_cast<double>(rests_.size() - 1));
  const std::size_t i = std::min(static_cast<std::size_t>(octave), rests_.size() - 2);
  const double part = octave - static_cast<double>(i);
  const Rest &a = rests_[i], &b = rests_[i + 1];
  if (!(a.stiffness_n_m > 0 && b.stiffness_n_m > 0)) return {};
  return {a.overlap_nm + part * (b.overlap_nm - a.overlap_nm),
          a.stiffness_n_m + part * (b.stiffness_n_m - a.stiffness_n_m),
          a.pull_off_nn + part * (b.pull_off_nn - a.pull_off_nn)};
}

PortModel::PortModel(std::shared_ptr<const scene::Scene> scene, const PortGround& ground)
    : scene_(std::move(scene)), springs_nm_nn_(scene_->port_compliance_nm_nn()), ground_(ground) {
  if (scene_->friction) friction_.emplace(*scene_->friction);
}

double PortModel::port_stiffness_n_m(double contact_n_m, const Vec3& normal_w) const noexcept {
  return contact_n_m / (1 + contact_n_m * normal_w.dot(springs_nm_nn_ * normal_w));
}

double PortModel::adhesion_nn(const physics::TipSolution& tip) const noexcept {
  if (scene_->particle || !(tip.radius_nm > 0)) return 0;
  return ground_.rest(tip.radius_nm).pull_off_nn;
}

link::LocalModel PortModel::of(const physics::TipSolution& tip, const Vec3& commanded_w_nm) noexcept {
  link::LocalModel model;
  const double length = tip.normal_w.norm();
  if (scene_->particle || !(length > 0.1) || !(tip.radius_nm > 0)) return model;
  const PortGround::Rest rest = ground_.rest(tip.radius_nm);
  if (!(rest.stiffness_n_m > 0)) return model;
  const Vec3 normal_w = tip.normal_w / length;
  const bool touching = tip.branch == physics::Branch::kContact;
  model.normal_w = normal_w;
  model.adhesion_nn = rest.pull_off_nn;
  model.stiffness_n_m = port_stiffness_n_m(
      touching ? std::max(tip.stiffness_n_m, rest.stiffness_n_m) : rest.stiffness_n_m, normal_w);
  if (touching) {
    model.point_w_nm = commanded_w_nm + normal_w * (tip.force_w_nn.dot(normal_w) / model.stiffness_n_m);
    if (friction_) {
      const double across_nm_nn = 0.5 * (springs_nm_nn_.trace() - normal_w.dot(springs_nm_nn_ * normal_w));
      const double contact_n_m = friction_->stiffness_n_m(tip.contact_radius_nm);
      model.shear_stiffness_n_m = contact_n_m / (1 + contact_n_m * across_nm_nn);
      model.friction_nn = friction_->limit_nn(tip.contact_radius_nm, tip.normal_force_nn);
    }
  } else {
    model.point_w_nm = tip.apex_w_nm - normal_w * (rest.overlap_nm - tip.overlap_nm);
  }
  model.version = last_.version;
  if (!same(model, last_) || model.version == 0) model.version = std::max(1u, last_.version + 1);
  last_ = model;
  return model;
}

}  // namespace telenano::slave
