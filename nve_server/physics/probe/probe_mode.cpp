#include "telenano/nve_server/physics/probe/probe_mode.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/require.h"

namespace telenano::physics {
namespace {

constexpr double kBlendSteps = 8.0;

}  // namespace

ProbeMode::ProbeMode(double stiffness_n_m, double frequency_hz, double quality)
    : stiffness_n_m_(stiffness_n_m), frequency_hz_(frequency_hz), quality_(quality) {
  require(std::isfinite(stiffness_n_m) && stiffness_n_m > 0,
          "probe mode: stiffness must be positive and finite (N/m)", stiffness_n_m);
  require(std::isfinite(frequency_hz) && frequency_hz > 0,
          "probe mode: frequency must be positive and finite (Hz)", frequency_hz);
  require((quality >= 0.6 && quality <= 1e6) || quality == HUGE_VAL, "probe mode: quality must be 0.6 to 1e6",
          quality);
  omega_1_per_s_ = 2.0 * kPi * frequency_hz;
  gamma_1_per_s_ = 0.5 * omega_1_per_s_ / quality;
  omega_damped_1_per_s_ = omega_1_per_s_ * std::sqrt(1.0 - 0.25 / (quality * quality));
  mass_ = stiffness_n_m / (omega_1_per_s_ * omega_1_per_s_);
  damping_ = stiffness_n_m / (omega_1_per_s_ * quality);
}

int ProbeMode::pieces(double dt_s) const noexcept {
  const double pieces = std::ceil(omega_1_per_s_ * dt_s / kResolved);
  return pieces > 1.0 && pieces <= kMaxPieces ? static_cast<int>(pieces) : 1;
}

ModePropagator ProbeMode::over(double step_s) const noexcept {
  return over(step_s, resolved(step_s) ? ModeIntegrator::kMeanForce : ModeIntegrator::kBackwardEuler);
}

ModePropagator ProbeMode::over(double step_s, ModeIntegrator integrator) const noexcept {
  ModePropagator p;
  p.integrator = integrator;
  p.step_s = step_s;
  if (integrator == ModeIntegrator::kBackwardEuler) {
    p.held_nm_nn = 1.0 / (stiffness_n_m_ + damping_ / step_s + mass_ / (step_s * step_s));
    return p;
  }
  const SinCos turn = det_sin_cos(omega_damped_1_per_s_ * step_s);
  const double decay = det_exp(-gamma_1_per_s_ * step_s);
  p.reach_s = decay * turn.sin / omega_damped_1_per_s_;
  p.keep_q = decay * turn.cos + gamma_1_per_s_ * p.reach_s;
  p.keep_v = decay * turn.cos - gamma_1_per_s_ * p.reach_s;
  p.held_nm_nn = (1.0 - p.keep_q) / stiffness_n_m_;
  return p;
}

ModeStep ProbeMode::begin(const ModePropagator& over, const ModeState& from,
                          double contact_stiffness_n_m) const noexcept {
  ModeStep step;
  step.over = over;
  step.from = from;
  if (over.integrator == ModeIntegrator::kBackwardEuler) {
    const double h = over.step_s;
    step.compliance_nm_nn = over.held_nm_nn;
    step.shift_nm = over.held_nm_nn * (mass_ * (from.deflection_nm + h * from.velocity_nm_s) / (h * h) +
                                       damping_ * from.deflection_nm / h);
    return step;
  }
  const double free = over.keep_q * from.deflection_nm + over.reach_s * from.velocity_nm_s;
  double theta = 1.0;
  if (over.integrator == ModeIntegrator::kMeanForce) {
    const double gain = over.held_nm_nn * std::max(0.0, contact_stiffness_n_m);
    // In steps: the law keeps what it has found while the compliance stays the same.
    step.blend = std::floor(kBlendSteps * gain * gain / (1.0 + gain * gain) + 0.5) / kBlendSteps;
    theta = 0.5 * (1.0 + step.blend);
  }
  step.compliance_nm_nn = over.held_nm_nn * theta;
  step.shift_nm = free + over.held_nm_nn * (1.0 - theta) * from.force_nn;
  return step;
}

ModeLoss ProbeMode::finish(const ModeStep& step, double force_nn, ModeState& to) const noexcept {
  const ModePropagator& over = step.over;
  const ModeState from = step.from;
  to.force_nn = force_nn;
  to.deflection_nm = step.shift_nm + step.compliance_nm_nn * force_nn;
  const double moved = to.deflection_nm - from.deflection_nm;
  const double mean_velocity = moved / over.step_s;
  ModeLoss loss;
  if (over.integrator == ModeIntegrator::kBackwardEuler) {
    to.velocity_nm_s = mean_velocity;
    loss.damped_aj = damping_ * moved * mean_velocity;
  } else {
    const double theta = over.integrator == ModeIntegrator::kMeanForce ? 0.5 * (1.0 + step.blend) : 1.0;
    const double held = (1.0 - theta) * from.force_nn + theta * force_nn;
    to.velocity_nm_s = over.keep_v * from.velocity_nm_s +
                       over.reach_s * (held / mass_ - omega_1_per_s_ * omega_1_per_s_ * from.deflection_nm);
    // The motion under a held force is exact, so what the force gave and the mode has not, damping took.
    loss.damped_aj = std::max(0.0, held * moved - (energy_aj(to) - energy_aj(from)));
    to.velocity_nm_s += step.blend * (mean_velocity - to.velocity_nm_s);
  }
  loss.numerical_aj =
      0.5 * (from.force_nn + force_nn) * moved - (energy_aj(to) - energy_aj(from)) - loss.damped_aj;
  return loss;
}

double ProbeMode::slow_down(double energy_aj, ModeState& state) const noexcept {
  const double kinetic = kinetic_aj(state);
  if (!(energy_aj > 0.0) || !(kinetic > 0.0)) return 0.0;
  const double taken = std::min(energy_aj, kinetic);
  state.velocity_nm_s *= std::sqrt((kinetic - taken) / kinetic);
  return taken;
}

}  // namespace telenano::physics
