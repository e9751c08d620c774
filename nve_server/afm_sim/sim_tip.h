#pragma once

#include <memory>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/afm_sim/sim_config.h"
#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::afm_sim {

/// Piezo, lever and sample in time: where the base of the lever truly is, and with what force the tip
/// touches. Time goes only by step(). A value: a copy is the same rig at the same moment.
///
///   base = over the scene's start, at the height where the tip touches there, + piezo (lag, creep) + drift
///   creep: piezo + c·(y − piezo), dy/dt = (piezo − y)/τ: of a move, c comes late.
class SimTip {
 public:
  SimTip(const SimConfig& config, std::shared_ptr<const scene::Scene> scene);

  /// Moves the piezo to where it is told within dt, and solves lever and sample. `piezo_nm`: x, y and height
  /// (away from the sample positive).
  void step(const Vec3& piezo_nm, double dt_s) noexcept;

  const Vec3& base_w_nm() const noexcept {
    return base_w_nm_;
  }  ///< as if the lever were straight: the apex
     ///< without force
  const Vec3& force_w_nn() const noexcept { return solution_.force_w_nn; }
  double normal_force_nn() const noexcept { return solution_.normal_force_nn; }
  const physics::TipSolution& solution() const noexcept { return solution_; }
  double deflection_nm() const noexcept;     ///< optical, without noise and offset
  double deflection_nm_nn() const noexcept;  ///< of a force of 1 nN along z
  const Vec3& drift_nm() const noexcept { return drift_nm_; }
  /// ∫ −F·dx of the base since the start, trapezia of these steps.
  double work_aj() const noexcept { return work_aj_; }
  double peak_force_nn() const noexcept { return peak_force_nn_; }
  /// From now on; the rig's drift is a constant otherwise.
  void set_drift_z_nm_s(double drift_nm_s) noexcept { config_.drift_z_nm_s = drift_nm_s; }
  void forget_peak() noexcept { peak_force_nn_ = 0; }

 private:
  SimConfig config_;
  std::shared_ptr<const scene::Scene> scene_;
  physics::Compliance springs_;
  Vec3 origin_w_nm_;
  Vec3 piezo_nm_ = Vec3::Zero();
  Vec3 creep_nm_ = Vec3::Zero();
  Vec3 drift_nm_ = Vec3::Zero();
  Vec3 base_w_nm_;
  bool started_ = false;
  physics::LevelState state_;
  physics::PotentialState potential_state_;  // instead, on a scene of one potential
  physics::TipSolution solution_;
  double work_aj_ = 0;
  double peak_force_nn_ = 0;
};

}  // namespace telenano::afm_sim
