#include "telenano/common/control/model_renderer.h"

#include <algorithm>
#include <cmath>

namespace telenano::control {
namespace {

constexpr int kHalvings = 12;  // of the step towards a new model: 1/4096 of it is less than anyone feels

}  // namespace

void ModelRenderer::forget() noexcept {
  heard_ = model_ = {};
  attached_ = started_ = slave_touches_ = false;
  answers_ = changed_at_ = 0;
  bristle_w_nm_.setZero();
}

void ModelRenderer::on_reply(const ContactPlane& model, bool touching, std::uint64_t answers) noexcept {
  heard_ = capped(model);
  slave_touches_ = touching;
  answers_ = answers;
  if (model_.version == 0 || heard_.version == 0) {  // nothing to go over from, or to
    model_ = heard_;
    // A first model that would push at once is taken up like any other change: from nothing.
    model_.stiffness_n_m = model_.adhesion_nn = model_.shear_stiffness_n_m = model_.friction_nn = 0;
    if (heard_.version == 0) {
      attached_ = false;
      bristle_w_nm_.setZero();
    }
  }
}

ContactPlane ModelRenderer::capped(ContactPlane model) const noexcept {
  model.stiffness_n_m = std::min(model.stiffness_n_m, stiffness_max_n_m_);
  model.shear_stiffness_n_m = std::min(model.shear_stiffness_n_m, stiffness_max_n_m_);
  return model;
}

ContactPlane ModelRenderer::blend(double part) const noexcept {
  if (part >= 1) return heard_;
  const auto between = [part](double from, double to) { return from + part * (to - from); };
  ContactPlane model = heard_;
  model.point_w_nm = model_.point_w_nm + part * (heard_.point_w_nm - model_.point_w_nm);
  const Vec3 normal_w = model_.normal_w + part * (heard_.normal_w - model_.normal_w);
  const double length = normal_w.norm();
  if (length > 0.1) model.normal_w = normal_w / length;  // nearly opposite ones: the new one
  model.stiffness_n_m = between(model_.stiffness_n_m, heard_.stiffness_n_m);
  model.adhesion_nn = between(model_.adhesion_nn, heard_.adhesion_nn);
  model.shear_stiffness_n_m = between(model_.shear_stiffness_n_m, heard_.shear_stiffness_n_m);
  model.friction_nn = between(model_.friction_nn, heard_.friction_nn);
  return model;
}

// A model whose ground has come up over the tip is touched, whether it was before or not: its energy counts.
bool ModelRenderer::touched(const ContactPlane& model, const Vec3& target_w_nm) const noexcept {
  return attached_ || model.depth_nm(target_w_nm) >= 0;
}

double ModelRenderer::normal_potential_aj(const ContactPlane& model, const Vec3& target_w_nm) const noexcept {
  if (!(model.stiffness_n_m > 0) || !touched(model, target_w_nm)) return 0;
  const double depth = model.depth_nm(target_w_nm);
  return 0.5 * model.stiffness_n_m * depth * depth -
         0.5 * model.adhesion_nn * model.adhesion_nn / model.stiffness_n_m;
}

Vec3 ModelRenderer::normal_force_w_nn(const ContactPlane& model, const Vec3& target_w_nm) const noexcept {
  if (!touched(model, target_w_nm)) return Vec3::Zero();
  Vec3 slope_w;
  const double depth = model.depth_nm(target_w_nm, slope_w);
  return model.stiffness_n_m * depth * slope_w;
}

double ModelRenderer::potential_aj(const Vec3& target_w_nm) const noexcept {
  return normal_potential_aj(model_, target_w_nm) +
         0.5 * model_.shear_stiffness_n_m * bristle_w_nm_.squaredNorm();
}

void ModelRenderer::follow(const Vec3& target_w_nm, double energy_aj, double force_step_nn) noexcept {
  const double potential_aj = normal_potential_aj(model_, target_w_nm);
  const Vec3 force_nn = normal_force_w_nn(model_, target_w_nm);
  double part = 1;
  for (int i = 0; i <= kHalvings; ++i, part *= 0.5) {
    const ContactPlane next = blend(part);
    if (normal_potential_aj(next, target_w_nm) - potential_aj > energy_aj) continue;
    if ((normal_force_w_nn(next, target_w_nm) - force_nn).norm() > force_step_nn) continue;
    // The bristle's force stays where it stiffens, its extension where it softens: both lower its energy.
    if (next.shear_stiffness_n_m > model_.shear_stiffness_n_m && next.shear_stiffness_n_m > 0)
      bristle_w_nm_ *= model_.shear_stiffness_n_m / next.shear_stiffness_n_m;
    model_ = next;
    return;
  }
}

void ModelRenderer::touch(const Vec3& target_w_nm, std::uint64_t command) noexcept {
  const double depth = model_.depth_nm(target_w_nm);
  const double reach_nm = model_.stiffness_n_m > 0 ? model_.adhesion_nn / model_.stiffness_n_m : 0;
  // What the slave says counts if it has seen a command since touch last changed here.
  const bool slave_knows = answers_ >= changed_at_;
  const bool was = attached_;
  if (attached_) {
    const bool slave_let_go = slave_knows && !slave_touches_ && depth < 0;
    if (depth < -reach_nm || slave_let_go) attached_ = false;
  } else {
    const bool slave_snapped_in = slave_knows && slave_touches_ && depth > -reach_nm;
    if (depth >= 0 || slave_snapped_in) attached_ = true;
  }
  if (attached_ != was) changed_at_ = command;
  if (!attached_) bristle_w_nm_.setZero();
}

void ModelRenderer::shear(const Vec3& moved_w_nm) noexcept {
  if (!attached_ || !(model_.shear_stiffness_n_m > 0)) {
    bristle_w_nm_.setZero();
    return;
  }
  // Turned into the plane of the normal now (shortened, never lengthened), stretched by the motion in it, and
  // slipped to the limit: backward Euler of a Coulomb slider.
  const Vec3& n = model_.normal_w;
  bristle_w_nm_ += moved_w_nm;
  bristle_w_nm_ -= n * n.dot(bristle_w_nm_);
  const double limit_nm = model_.friction_nn / model_.shear_stiffness_n_m;
  const double length_nm = bristle_w_nm_.norm();
  if (length_nm > limit_nm) bristle_w_nm_ *= limit_nm / length_nm;
}

Vec3 ModelRenderer::force_w_nn(const Vec3& target_w_nm, std::uint64_t command, double energy_aj,
                               double force_step_nn) noexcept {
  if (heard_.version == 0) return Vec3::Zero();
  if (!started_) last_target_w_nm_ = target_w_nm;
  started_ = true;
  touch(target_w_nm, command);
  follow(target_w_nm, energy_aj, force_step_nn);
  attached_ = touched(model_, target_w_nm);
  shear(target_w_nm - last_target_w_nm_);
  last_target_w_nm_ = target_w_nm;
  return normal_force_w_nn(model_, target_w_nm) - model_.shear_stiffness_n_m * bristle_w_nm_;
}

}  // namespace telenano::control
