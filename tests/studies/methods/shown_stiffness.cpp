#include "tests/studies/methods/shown_stiffness.h"

#include <algorithm>
#include <cmath>

#include "tests/support/port_account.h"
#include "tests/support/virtual_session.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies {
namespace {

constexpr double kTip_n_m = 50;          // the wall at the tip; α_F follows from what is to be felt
constexpr double kVelocityScale = 1e-6;  // 1 mm of the hand is 1 nm

// Times of one press, s. Long enough for a round trip of a second to settle before the last second counts.
constexpr double kStillS = 1.0;
constexpr double kReachS = 0.5;
constexpr double kHoldS = 4.0;
constexpr double kRestS = 2.5;
constexpr double kPressS = kReachS + kHoldS + kReachS + kRestS;
constexpr double kMeasuredS = 1.0;      // at the end of a hold
constexpr double kRestartAfterS = 0.5;  // into a rest
constexpr double kReleasedS = 0.2;      // at the end of a rest
constexpr double kAllS = kStillS + kPresses * kPressS;

// In nm of the tip above the wall; the hand's metres times 1e3 at this velocity scale.
std::vector<device::IntendedMotion::Waypoint> script(const PressConfig& config) {
  const double up_nm = config.clearance_m * kVelocityScale * 1e9;
  const double down_nm = -config.depth_m * kVelocityScale * 1e9;
  std::vector<device::IntendedMotion::Waypoint> points{{0, Vec3(0, 0, up_nm)}};
  const auto go = [&](double t, double z) { points.push_back({t, Vec3(0, 0, z)}); };
  for (int press = 0; press < kPresses; ++press) {
    const double t = kStillS + press * kPressS;
    go(t, up_nm);
    go(t + kReachS, down_nm);
    go(t + kReachS + kHoldS, down_nm);
    go(t + kReachS + kHoldS + kReachS, up_nm);
  }
  go(kAllS, up_nm);
  return points;
}

struct Range {
  double low = HUGE_VAL;
  double high = -HUGE_VAL;
  void add(double x) {
    low = std::min(low, x);
    high = std::max(high, x);
  }
};

support::VirtualSessionConfig session_config(const PressConfig& config,
                                             const std::shared_ptr<support::WallWatch>& watch) {
  support::VirtualSessionConfig session;
  support::WallSlaveConfig wall;
  wall.stiffness_n_m = kTip_n_m;
  wall.start_height_nm = config.clearance_m * kVelocityScale * 1e9;
  session.make_slave = [wall, watch] { return std::make_unique<support::WallSlave>(wall, watch); };
  session.station.method = config.method;
  session.station.scaling.velocity = kVelocityScale;
  session.station.scaling.force = config.wall_n_m / (kTip_n_m * kVelocityScale);
  session.station.allow_unsafe_scaling = true;
  session.task = device::Task::kScript;
  session.script = script(config);
  session.plant = config.plant;
  session.to_server.delay_ns = session.to_station.delay_ns = std::llround(0.5e9 * config.rtt_s);
  session.seed = config.seed;
  return session;
}

}  // namespace

double PressResult::later_stiffness_n_m() const {
  double sum = 0;
  for (int i = 1; i < kPresses; ++i) sum += presses[static_cast<std::size_t>(i)].stiffness_n_m;
  return sum / (kPresses - 1);
}

double PressResult::worst_swing_mm() const {
  double worst = 0;
  for (const Press& press : presses) worst = std::max(worst, press.swing_mm);
  return worst;
}

double PressResult::worst_drift_mm() const {
  double worst = 0;
  for (const Press& press : presses) {
    if (std::fabs(press.drift_mm) > std::fabs(worst)) worst = press.drift_mm;
  }
  return worst;
}

RestOnWall rest_on_wall(const PressConfig& config) {
  // Arm and grip in series press from `depth_m` against the wall: k_h (d − x) = K x.
  const double hand_n_m = 1 / (1 / config.plant.arm_stiffness_n_m + 1 / config.plant.grip_stiffness_n_m);
  RestOnWall rest;
  rest.depth_m = hand_n_m * config.depth_m / (hand_n_m + config.wall_n_m);
  rest.force_n = config.wall_n_m * rest.depth_m;
  return rest;
}

PressResult run_press(const PressConfig& config) {
  const auto watch = std::make_shared<support::WallWatch>();
  support::VirtualSession session(session_config(config, watch));
  PressResult result;
  result.config = config;
  support::PortAccount account(config.plant.device_damping_n_s_m, session.period_s());
  const double wall_z_m = -config.clearance_m;  // the hand is at 0 when the session starts
  const double force_scale_n_nn = session.station().config().scaling.force * 1e-9;
  double last_z_m = session.device().plant().pos_m().z();
  double least_in_j = 0, error2 = 0;
  std::int64_t inside = 0, acted = 0, tick = 0;
  int restarted = 0;
  struct Sums {
    double force = 0, depth = 0, drift = 0;
    int held = 0, released = 0;
    Range depths;
  };
  std::array<Sums, kPresses> sums;
  session.run(std::llround((kAllS + 5) / session.period_s()), [&](const recording::Sample& row) {
    const double z_m = session.device().plant().pos_m().z();
    const double force_n = row.hand_force_applied_h_n[2];  // upwards, against going into the wall
    account.add(force_n, static_cast<long double>(z_m) - last_z_m);
    least_in_j = std::min(least_in_j, -account.given_j());
    last_z_m = z_m;
    const double depth_m = wall_z_m - z_m;
    result.peak_force_n = std::max(result.peak_force_n, std::fabs(force_n));
    if (depth_m > 0) {
      ++inside;
      error2 += std::pow(force_n - config.wall_n_m * depth_m, 2);
      acted += (row.limit_flags & (recording::kLimitDamper | recording::kLimitClamp)) != 0;
    }
    const double t = session.device().motion_time_s();
    if ((row.limit_flags & recording::kLimitStop) != 0 && result.stopped_at_s < 0) {
      result.stopped_at_s = t;
      result.stop_faults = row.station_faults;
    }
    if (config.trace_every > 0 && tick++ % config.trace_every == 0)
      result.trace.push_back({t, 1e3 * depth_m, force_n});
    if (t < kStillS) return;
    const auto press = static_cast<std::size_t>((t - kStillS) / kPressS);
    if (press >= kPresses) return;
    Sums& sum = sums[press];
    const double phase = t - kStillS - static_cast<double>(press) * kPressS;
    if (phase > kReachS + kHoldS - kMeasuredS && phase <= kReachS + kHoldS) {
      sum.force += force_n;
      sum.depth += depth_m;
      sum.depths.add(depth_m);
      ++sum.held;
    }
    if (config.restarts && phase >= kPressS - kRestS + kRestartAfterS &&
        restarted <= static_cast<int>(press)) {
      ++restarted;
      session.restart_server();
    }
    if (phase > kPressS - kReleasedS) {
      // Hand and tip have been at rest for longer than the link takes: what is left between them is drift.
      sum.drift += watch->commanded_z_w_nm / (kVelocityScale * 1e9) - (z_m - wall_z_m);
      ++sum.released;
    }
  });
  for (std::size_t i = 0; i < kPresses; ++i) {
    const Sums& sum = sums[i];
    Press& press = result.presses[i];
    if (sum.held == 0 || sum.released == 0) continue;
    press.force_n = sum.force / sum.held;
    press.depth_mm = 1e3 * sum.depth / sum.held;
    press.stiffness_n_m = sum.force / sum.depth;
    press.swing_mm = 1e3 * (sum.depths.high - sum.depths.low);
    press.drift_mm = 1e3 * sum.drift / sum.released;
  }
  result.over_force = force_scale_n_nn * watch->most_force_nn / rest_on_wall(config).force_n;
  result.sessions = session.client().sessions();
  result.least_energy_mj = 1e3 * least_in_j;
  result.extracted_mj = 1e3 * account.most_extracted_j();
  result.force_error_rms_n = inside > 0 ? std::sqrt(error2 / static_cast<double>(inside)) : 0;
  result.duty = inside > 0 ? static_cast<double>(acted) / static_cast<double>(inside) : 0;
  return result;
}

}  // namespace telenano::studies
