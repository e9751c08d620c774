#include "tests/studies/stress/arm.h"

#include <cmath>

#include "tests/support/matrix_exponential.h"

namespace telenano::studies::stress {
using support::exponential;

ArmAxis::ArmAxis(const ArmConfig& config) : config_(config) {
  const long double m = config.device_mass_kg, arm_m = config.arm_mass_kg;
  const long double kg = config.grip_stiffness_n_m, cg = config.grip_damping_n_s_m;
  const long double ka = config.arm_stiffness_n_m, ca = config.arm_damping_n_s_m;
  const long double b = config.device_damping_n_s_m;
  Matrix a{};
  a[0][1] = 1;
  a[1] = {-kg / m, -(b + cg) / m, kg / m, cg / m, 0, 0, 1 / m};
  a[2][3] = 1;
  a[3] = {kg / arm_m, cg / arm_m, -(kg + ka) / arm_m, -(cg + ca) / arm_m, ka / arm_m, ca / arm_m, 0};
  a[4][5] = 1;
  propagator_ = exponential(a, config.period_s);
}

void ArmAxis::advance(double force_n, double aim_m) noexcept {
  state_[5] = (static_cast<long double>(aim_m) - state_[4]) / static_cast<long double>(config_.period_s);
  state_[6] = force_n;
  const auto row = [this](std::size_t i) {
    long double sum = 0;
    for (std::size_t j = 0; j < kStates; ++j) sum += propagator_[i][j] * state_[j];
    return sum;
  };
  // By name, not in an array: copied in words of 16 bytes, what was written in ten would have to leave the
  // processor's store buffer first.
  const long double pos = row(0), vel = row(1), arm_pos = row(2), arm_vel = row(3);
  state_[0] = pos;
  state_[1] = vel;
  state_[2] = arm_pos;
  state_[3] = arm_vel;
  state_[4] = aim_m;
}

long double ArmAxis::stored_j() const noexcept {
  const long double grip_m = state_[0] - state_[2];
  const long double arm_m = state_[2] - state_[4];
  return 0.5L *
         (config_.device_mass_kg * state_[1] * state_[1] + config_.arm_mass_kg * state_[3] * state_[3] +
          config_.grip_stiffness_n_m * grip_m * grip_m + config_.arm_stiffness_n_m * arm_m * arm_m);
}

}  // namespace telenano::studies::stress
