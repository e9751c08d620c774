#include "telenano/nve_server/slave/nve_limits.h"

#include <Eigen/Eigenvalues>

#include "telenano/common/base/constants.h"

namespace telenano::slave {
namespace {

// The hardest wall that the port can show. On a flat sample without friction the force is along W z whatever
// the springs do sideways; a curved sample, a particle's side and a contact that sticks face anywhere, and
// the stiffest direction of the springs counts: 1/λ_min of their compliance. A mode below the sample rate has
// not yielded yet when the next sample asks.
double shown_stiffness(const scene::Scene& scene) {
  const physics::Probe& probe = scene.cantilever;
  const bool sluggish = probe.mode() && probe.mode()->frequency_hz() < scene.limits.rate_max_hz;
  const physics::Compliance springs = Mat3::Identity() / scene.coupling.stiffness_n_m +
                                      (sluggish ? probe.rest_compliance_nm_nn() : probe.compliance_nm_nn());
  const bool upwards_only = scene.surface->is_flat() && !scene.friction && !scene.particle;
  if (upwards_only) return 1.0 / springs(2, 2);
  return 1.0 / Eigen::SelfAdjointEigenSolver<Mat3>(springs, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
}

}  // namespace

SlaveLimits limits_of(const scene::Scene& scene) {
  SlaveLimits limits;
  limits.workspace_min_w_nm = scene.limits.workspace_min_w_nm;
  limits.workspace_max_w_nm = scene.limits.workspace_max_w_nm;
  limits.start_pos_w_nm = scene.start_apex_w_nm;
  limits.surface_z_w_nm = scene.start_touch_w_nm;
  limits.force_max_nn = scene.limits.force_max_nn;
  limits.coupling_stiffness_n_m = shown_stiffness(scene);
  limits.coupling_damping_n_s_m = scene.coupling.damping_n_s_m;
  limits.rate_max_hz = scene.limits.rate_max_hz;
  limits.has_particle = scene.particle.has_value();
  limits.keeps_marks = scene.marks.has_value() && !scene.particle;
  // A mode that is resolved takes ω0 dt balances a step (probe_mode.h), whatever the rate.
  if (const auto& mode = scene.cantilever.mode()) limits.balances_per_s = 2.0 * kPi * mode->frequency_hz();
  return limits;
}

}  // namespace telenano::slave
