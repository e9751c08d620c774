#include "nve_server/slave/port_model.h"

#include <algorithm>
#include <cmath>

namespace telenano::slave {
namespace {

constexpr double kApproachStepNm = 0.02;
constexpr double kApproachNm = 60;

bool same(const link::LocalModel& a, const link::LocalModel& b) noexcept {
  return a.point_w_nm == b.point_w_nm && a.normal_w == b.normal_w && a.stiffness_n_m == b.stiffness_n_m &&
         a.adhesion_nn == b.adhesion_nn && a.shear_stiffness_n_m == b.shear_stiffness_n_m &&
         a.friction_nn == b.friction_nn;
}

}  // namespace

PortModel::PortModel(std::shared_ptr<const scene::Scene> scene)
    : scene_(std::move(scene)), springs_nm_nn_(scene_->port_compliance_nm_nn()) {
  if (scene_->friction) friction_.emplace(*scene_->friction);
  // Down on level ground until the contact pushes: what a contact without load is like.
  const physics::TipSampleLaw& law = scene_->equilibrium->law();
  const double radius_nm = scene_->probe.tip_radius_nm;
  pull_off_nn_ = law.pull_off_nn(radius_nm);
  physics::TipSampleState state;
  for (double base_nm = -kApproachNm; base_nm < kApproachNm; base_nm += kApproachStepNm) {
    const physics::Equilibrium eq = law.advance(base_nm, springs_nm_nn_(2, 2), radius_nm, state);
    if (eq.branch != physics::Branch::kContact || !(eq.force_nn >= 0) || !(eq.stiffness_n_m > 0)) continue;
    rest_overlap_nm_ = eq.overlap_nm - eq.force_nn / eq.stiffness_n_m;
    rest_stiffness_n_m_ = eq.stiffness_n_m;
    return;
  }
}

double PortModel::port_stiffness_n_m(double contact_n_m, const Vec3& normal_w) const noexcept {
  return contact_n_m / (1 + contact_n_m * normal_w.dot(springs_nm_nn_ * normal_w));
}

link::LocalModel PortModel::of(const physics::TipSolution& tip, const Vec3& commanded_w_nm) noexcept {
  link::LocalModel model;
  const double length = tip.normal_w.norm();
  if (scene_->particle || !(length > 0.1) || !(rest_stiffness_n_m_ > 0)) return model;
  const Vec3 normal_w = tip.normal_w / length;
  const bool touching = tip.branch == physics::Branch::kContact;
  model.normal_w = normal_w;
  model.adhesion_nn = pull_off_nn_;
  model.stiffness_n_m =
      port_stiffness_n_m(touching ? std::max(tip.stiffness_n_m, rest_stiffness_n_m_) : rest_stiffness_n_m_,
                         normal_w);
  if (touching) {
    model.point_w_nm = commanded_w_nm + normal_w * (tip.force_w_nn.dot(normal_w) / model.stiffness_n_m);
    if (friction_) {
      const double across_nm_nn =
          0.5 * (springs_nm_nn_.trace() - normal_w.dot(springs_nm_nn_ * normal_w));
      const double contact_n_m = friction_->stiffness_n_m(tip.contact_radius_nm);
      model.shear_stiffness_n_m = contact_n_m / (1 + contact_n_m * across_nm_nn);
      model.friction_nn = friction_->limit_nn(tip.contact_radius_nm, tip.normal_force_nn);
    }
  } else {
    model.point_w_nm = tip.apex_w_nm - normal_w * (rest_overlap_nm_ - tip.overlap_nm);
  }
  model.version = last_.version;
  if (!same(model, last_) || model.version == 0) model.version = std::max(1u, last_.version + 1);
  last_ = model;
  return model;
}

}  // namespace telenano::slave
