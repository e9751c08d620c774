#include "telenano/nve_server/afm_sim/sim_tip.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"

namespace telenano::afm_sim {

SimTip::SimTip(const SimConfig& config, std::shared_ptr<const scene::Scene> scene)
    : config_(config), scene_(std::move(scene)), springs_(scene_->probe_compliance_nm_nn()) {
  if (scene_->cantilever.rigid())
    throw UserError(scene_->path +
                    ": [probe]: an AFM measures by its lever: expected a stiffness, not rigid");
  if (scene_->particle || scene_->marks)
    throw UserError(scene_->path + ": a particle or marks that stay cannot be simulated behind a controller");
  origin_w_nm_ = Vec3(scene_->start_apex_w_nm.x(), scene_->start_apex_w_nm.y(),
                      scene_->start_touch_w_nm - config_.sample_z_nm);
}

double SimTip::deflection_nm() const noexcept {
  return scene_->cantilever.optical_deflection_nm(solution_.force_w_nn);
}

double SimTip::deflection_nm_nn() const noexcept {
  return scene_->cantilever.optical_deflection_nm(Vec3::UnitZ());
}

void SimTip::step(const Vec3& target_nm, double dt_s) noexcept {
  const auto follow = [&](double from, double to, double lag_s) {
    return lag_s > 0 ? to + (from - to) * det_exp(-dt_s / lag_s) : to;
  };
  Vec3 piezo = target_nm;
  if (started_) {
    piezo.z() = follow(piezo_nm_.z(), target_nm.z(), config_.z_lag_s);
    for (int i = 0; i < 3; ++i) creep_nm_[i] = follow(creep_nm_[i], piezo[i], config_.creep_s);
    drift_nm_ += dt_s * Vec3(config_.drift_x_nm_s, config_.drift_y_nm_s, config_.drift_z_nm_s);
  } else {
    creep_nm_ = piezo;
  }
  piezo_nm_ = piezo;
  // Where the rig has long been, creep is over: it counts from there.
  const Vec3 base = origin_w_nm_ + piezo + config_.creep * (creep_nm_ - piezo) + drift_nm_;
  const Vec3 before = started_ ? base_w_nm_ : base;
  const Vec3 move = base - before;
  // On a surface with relief the balance is followed in pieces of a twentieth of the tip's radius.
  const int pieces =
      std::clamp(static_cast<int>(std::ceil(move.norm() / (0.05 * scene_->probe.tip_radius_nm))), 1, 200);
  for (int i = 1; i <= pieces; ++i) {
    const Vec3 force_last = solution_.force_w_nn;
    const Vec3 end = before + move * (static_cast<double>(i) / pieces);
    const auto next = scene_->potential ? scene_->potential->advance(end, springs_, potential_state_)
                                        : scene_->level->advance(end, springs_, state_);
    if (next.status == physics::SolveStatus::kOk) solution_ = next;
    work_aj_ -= 0.5 * (force_last + solution_.force_w_nn).dot(move / pieces);
    peak_force_nn_ = std::max(peak_force_nn_, solution_.normal_force_nn);
  }
  if (!started_) work_aj_ = 0;
  base_w_nm_ = base;
  started_ = true;
}

}  // namespace telenano::afm_sim
