#include "tests/support/mass_spring_hand.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "tests/support/matrix_exponential.h"

namespace telenano::support {
namespace {

constexpr double kPatienceS = 0.1;

}  // namespace

double MassSpringConfig::grip_for_hz(double hz, double device_mass_kg, double arm_mass_kg) {
  const double omega = 2 * kPi * hz;
  return omega * omega / (1 / device_mass_kg + 1 / arm_mass_kg);
}

MassSpringHand::MassSpringHand(const MassSpringConfig& config) : AccountedHand(config.port), config_(config) {
  const long double m = config.port.device_mass_kg, arm_m = config.arm_mass_kg;
  const long double grip = config.grip_stiffness_n_m, arm = config.arm_stiffness_n_m;
  Matrix a{};
  a[0][1] = 1;
  a[1] = {-grip / m, -config.port.device_damping_n_s_m / m, grip / m, 0, 1 / m, 0};
  a[2][3] = 1;
  a[3] = {grip / arm_m, 0, -(grip + arm) / arm_m, 0, 0, arm / arm_m};
  propagator_ = exponential(a, config.port.period_s);
}

long double MassSpringHand::stored_j() const noexcept {
  const long double grip_m = state_[0] - state_[2];
  const long double arm_m = state_[2] - state_[5];
  return 0.5L *
         (config_.port.device_mass_kg * state_[1] * state_[1] + config_.arm_mass_kg * state_[3] * state_[3] +
          config_.grip_stiffness_n_m * grip_m * grip_m + config_.arm_stiffness_n_m * arm_m * arm_m);
}

long double MassSpringHand::next_pos_m(double force_n) noexcept {
  const long double step_m = static_cast<long double>(config_.goal_speed_m_s) * config_.port.period_s;
  unfelt_s_ = force_n == 0 ? unfelt_s_ + config_.port.period_s : 0;
  const double goal_m =
      unfelt_s_ > kPatienceS && state_[5] <= config_.goal_m ? config_.lowest_goal_m : config_.goal_m;
  // Back up only from above: what has followed something down stays there.
  if (place_m_)
    state_[5] = state_[5] + std::clamp<long double>(*place_m_ - state_[5], -step_m, step_m);
  else if (state_[5] > goal_m)
    state_[5] = std::max<long double>(goal_m, state_[5] - step_m);
  state_[4] = force_n;
  std::array<long double, kStates> next{};
  for (std::size_t i = 0; i < kStates; ++i) {
    for (std::size_t j = 0; j < kStates; ++j) next[i] += propagator_[i][j] * state_[j];
  }
  state_ = next;
  return state_[0];
}

}  // namespace telenano::support
