#pragma once

#include <algorithm>
#include <cmath>
#include <memory>

#include "tests/support/mass_spring_hand.h"
#include "tests/support/virtual_session.h"
#include "tests/support/wall_slave.h"

namespace telenano::support {

/// The methods that promise to give the hand no more than the allowance beyond what they got.
constexpr bool promises(control::Method method) noexcept {
  return method == control::Method::kKsClamp || method == control::Method::kTank ||
         method == control::Method::kModel;
}

/// What the properties of sessions are shown with: a hand with mass that leans on a wall, the wall's and the
/// hand's own accounts, and the force that really acted.
struct PressedWall {
  explicit PressedWall(control::Method method, std::uint64_t seed = 1) {
    config.station.method = method;
    config.seed = seed;
    WallSlaveConfig wall_config;
    wall_config.stiffness_n_m = 10;  // 200 N/m at the hand: stable without control, over a short way
    config.make_slave = [wall_config, watch = watch] {
      return std::make_unique<WallSlave>(wall_config, watch);
    };
    MassSpringConfig hand_config;
    hand_config.goal_m = hand_config.lowest_goal_m = -0.008;  // 8 nm at 1e-6: 3 nm into the wall
    hand_config.arm_stiffness_n_m = 1000;
    hand = std::make_shared<MassSpringHand>(hand_config);
    config.hand = hand;
  }
  void start() { session = std::make_unique<VirtualSession>(config); }
  const recording::Sample& step() {
    const recording::Sample& row = session->step();
    const auto& f = row.hand_force_applied_h_n;
    const double force_n = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    worst_rise_n = std::max(worst_rise_n, force_n - last_force_n);
    last_force_n = force_n;
    most_force_n = std::max(most_force_n, force_n);
    return row;
  }
  void steps(int n) {
    for (int i = 0; i < n; ++i) step();
  }
  double slew_limit_n() const { return config.station.slew_n_s / config.station.rate_hz * (1 + 1e-9); }
  double target_z_nm() const { return session->loop().trace().tip_target_pos_w_nm.z(); }

  std::shared_ptr<WallWatch> watch = std::make_shared<WallWatch>();
  std::shared_ptr<MassSpringHand> hand;
  VirtualSessionConfig config;
  std::unique_ptr<VirtualSession> session;
  double last_force_n = 0;
  double worst_rise_n = 0;  ///< of |f| in a tick
  double most_force_n = 0;
};

}  // namespace telenano::support
