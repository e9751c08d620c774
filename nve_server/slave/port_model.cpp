#include "nve_server/slave/port_model.h"

#include <algorithm>
#include <cmath>

#include "nve_server/physics/relative_curvature.h"

namespace telenano::slave {
namespace {

// The walk that finds the contact without load and where it lets go: in contact over this many of the law's
// own lengths, where a Maugis contact of any λ rests and ends; that many steps a length.
constexpr double kWalkLengths = 4;
constexpr double kWalkLeastNm = 20;
constexpr int kWalkSteps = 4000;
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

}  // namespace

PortGround::PortGround(const scene::Scene& scene) {
  // On level ground, down until the contact pushes and up until it lets go.
  const physics::TipSampleLaw& law = scene.equilibrium->law();
  const double spring_nm_nn = scene.port_compliance_nm_nn()(2, 2);
  const double radius_nm = scene.probe.tip_radius_nm;
  const double reach_nm = std::max(kWalkLeastNm, kWalkLengths * law.scales(radius_nm).overlap_nm);
  const double step_nm = reach_nm / kWalkSteps;
  physics::TipSampleState state;
  double base_nm = -reach_nm;
  for (; base_nm < reach_nm && !(rest_stiffness_n_m_ > 0); base_nm += step_nm) {
    const physics::Equilibrium eq = law.advance(base_nm, spring_nm_nn, radius_nm, state);
    if (eq.branch != physics::Branch::kContact || !(eq.force_nn >= 0) || !(eq.stiffness_n_m > 0)) continue;
    rest_overlap_nm_ = eq.overlap_nm - eq.force_nn / eq.stiffness_n_m;
    rest_stiffness_n_m_ = eq.stiffness_n_m;
  }
  for (int i = 0; i < 4 * kWalkSteps; ++i, base_nm -= step_nm) {
    const physics::Equilibrium eq = law.advance(base_nm, spring_nm_nn, radius_nm, state);
    if (eq.branch != physics::Branch::kContact) break;
    pull_off_nn_ = std::max(pull_off_nn_, -eq.force_nn);
  }
  well_aj_ =
      slave::well_aj(law, scene.surface->is_flat() ? radius_nm : radius_nm / physics::kMinRelativeCurvature);
  if (scene.particle) {
    const physics::ParticleParameters& p = scene.particle->parameters;
    well_aj_ +=
        slave::well_aj(physics::TipSampleLaw(p.tip_particle),
                       p.tip_radius_nm * p.particle_radius_nm / (p.tip_radius_nm + p.particle_radius_nm));
  }
}

PortModel::PortModel(std::shared_ptr<const scene::Scene> scene, const PortGround& ground)
    : scene_(std::move(scene)), springs_nm_nn_(scene_->port_compliance_nm_nn()), ground_(ground) {
  if (scene_->friction) friction_.emplace(*scene_->friction);
}

double PortModel::port_stiffness_n_m(double contact_n_m, const Vec3& normal_w) const noexcept {
  return contact_n_m / (1 + contact_n_m * normal_w.dot(springs_nm_nn_ * normal_w));
}

link::LocalModel PortModel::of(const physics::TipSolution& tip, const Vec3& commanded_w_nm) noexcept {
  link::LocalModel model;
  const double length = tip.normal_w.norm();
  if (scene_->particle || !(length > 0.1) || !(ground_.rest_stiffness_n_m() > 0)) return model;
  const Vec3 normal_w = tip.normal_w / length;
  const bool touching = tip.branch == physics::Branch::kContact;
  model.normal_w = normal_w;
  model.adhesion_nn =
      ground_.pull_off_nn() * tip.radius_nm / scene_->probe.tip_radius_nm;  // every term goes with R
  model.stiffness_n_m = port_stiffness_n_m(
      touching ? std::max(tip.stiffness_n_m, ground_.rest_stiffness_n_m()) : ground_.rest_stiffness_n_m(),
      normal_w);
  if (touching) {
    model.point_w_nm = commanded_w_nm + normal_w * (tip.force_w_nn.dot(normal_w) / model.stiffness_n_m);
    if (friction_) {
      const double across_nm_nn = 0.5 * (springs_nm_nn_.trace() - normal_w.dot(springs_nm_nn_ * normal_w));
      const double contact_n_m = friction_->stiffness_n_m(tip.contact_radius_nm);
      model.shear_stiffness_n_m = contact_n_m / (1 + contact_n_m * across_nm_nn);
      model.friction_nn = friction_->limit_nn(tip.contact_radius_nm, tip.normal_force_nn);
    }
  } else {
    model.point_w_nm = tip.apex_w_nm - normal_w * (ground_.rest_overlap_nm() - tip.overlap_nm);
  }
  model.version = last_.version;
  if (!same(model, last_) || model.version == 0) model.version = std::max(1u, last_.version + 1);
  last_ = model;
  return model;
}

}  // namespace telenano::slave
