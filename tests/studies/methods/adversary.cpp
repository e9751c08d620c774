#include "tests/studies/methods/adversary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/random.h"
#include "tests/studies/methods/climbing.h"
#include "tests/support/driven_hand.h"
#include "tests/support/mass_spring_hand.h"
#include "tests/support/virtual_session.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies {
namespace {

using support::AccountedHand;
using support::DrivenHand;

constexpr double kTip_n_m = 50;
constexpr double kVelocityScale = 1e-6;
constexpr double kLowestM = -0.045;  // where the hand turns when there is no wall
constexpr double kHighestM = 0.010;
constexpr double kTouchN = 0.05;

std::int64_t nanoseconds(double seconds) {
  return std::llround(1e9 * seconds);
}

support::VirtualSessionConfig session_config(const AttackConfig& config,
                                             const std::shared_ptr<AccountedHand>& hand,
                                             const std::shared_ptr<support::WallWatch>& watch) {
  support::VirtualSessionConfig session;
  support::WallSlaveConfig wall;
  wall.stiffness_n_m = kTip_n_m;
  wall.start_height_nm = config.clearance_m * kVelocityScale * 1e9;
  session.make_slave = [wall, watch] { return std::make_unique<support::WallSlave>(wall, watch); };
  session.hand = hand;
  session.station.method = config.method;
  session.station.allowance_j = config.allowance_j;
  session.station.guaranteed_velocity_m_s = session.station.trip_velocity_m_s = config.hand.velocity_max_m_s;
  session.station.scaling.velocity = kVelocityScale;
  session.station.scaling.force = config.wall_n_m / (kTip_n_m * kVelocityScale);
  session.station.allow_unsafe_scaling = true;
  session.seed = config.seed;
  const bool all = config.channel == Channel::kEverything;
  for (net::SimPath* path : {&session.to_server, &session.to_station}) {
    path->delay_ns = nanoseconds(0.5 * config.rtt_s);
    if (all || config.channel == Channel::kJitter) {
      path->jitter_ns = std::max<std::int64_t>(path->delay_ns / 2, 2'000'000);
      path->in_order = false;
      path->duplicate = 0.05;
    }
  }
  const auto on_the_way = static_cast<std::size_t>(1.5e3 * config.rtt_s);
  session.link_capacity = std::max<std::size_t>(64, 2 * on_the_way);
  return session;
}

template <class Policy>
std::shared_ptr<AccountedHand> driven(const AttackConfig& config, Policy policy) {
  return std::make_shared<DrivenHand>(config.hand, std::move(policy),
                                      static_cast<std::size_t>(config.ticks()));
}

// Amplitude a about the wall, frequency b.
std::shared_ptr<AccountedHand> make_sine(const AttackConfig& config, double a_m, double hz) {
  return driven(config, [=, T = config.hand.period_s, wall = -config.clearance_m](const auto& view) {
    const double phase = hz * T * static_cast<double>(view.tick);
    return wall - 0.3 * a_m + a_m * det_sin_cos(2 * kPi * (phase - std::floor(phase))).sin;
  });
}

// In and out as fast as allowed: depth a, half period b.
std::shared_ptr<AccountedHand> make_square(const AttackConfig& config, double depth_m, double half_s) {
  return driven(config, [=, T = config.hand.period_s, wall = -config.clearance_m](const auto& view) {
    const auto half = static_cast<std::int64_t>(std::max(1.0, std::round(half_s / T)));
    return view.tick / half % 2 == 0 ? wall - depth_m : wall + 0.002;
  });
}

// Turns at random: range a about the wall, b turns a second.
std::shared_ptr<AccountedHand> make_telegraph(const AttackConfig& config, double range_m, double rate_hz) {
  return driven(config, [=, T = config.hand.period_s, wall = -config.clearance_m,
                         random = Random(config.seed + 77), down = true](const auto& view) mutable {
    if (random.chance(rate_hz * T)) down = !down;
    if (view.pos_m < wall - range_m) down = false;
    if (view.pos_m > wall + 0.3 * range_m) down = true;
    return down ? kLowestM : kHighestM;
  });
}

// Goes against the force at speed a until there is one; then with it, as fast as allowed, after having gone
// on against it for b seconds. Where there is nothing to be felt below, it comes up again.
std::shared_ptr<AccountedHand> make_greedy(const AttackConfig& config, double in_m_s, double patience_s) {
  return driven(config, [=, T = config.hand.period_s, wait_s = 0.1 + 1.5 * config.rtt_s, felt_s = 0.0,
                         low_s = 0.0, up = false](const auto& view) mutable {
    const double in_m = std::max(kLowestM, view.pos_m - in_m_s * T);
    if (std::fabs(view.force_n) < kTouchN) {
      felt_s = 0;
      low_s = view.pos_m <= kLowestM ? low_s + T : 0;
      if (low_s > wait_s) up = true;
      if (view.pos_m >= kHighestM) up = false;
      return up ? kHighestM : in_m;
    }
    felt_s += T;
    if (felt_s < patience_s) return in_m;
    return view.force_n > 0 ? view.pos_m + 1 : view.pos_m - 1;
  });
}

// A passive device and hand: arm's mass a, resonance b of device against arm.
std::shared_ptr<AccountedHand> make_mass_spring(const AttackConfig& config, double arm_kg, double hz) {
  support::MassSpringConfig hand;
  hand.port = config.hand;
  hand.arm_mass_kg = arm_kg;
  hand.grip_stiffness_n_m = support::MassSpringConfig::grip_for_hz(hz, config.hand.device_mass_kg, arm_kg);
  hand.goal_m = -config.clearance_m - 0.006;
  hand.lowest_goal_m = kLowestM;
  return std::make_shared<support::MassSpringHand>(hand);
}

/// Bursts of loss in time, one direction: Gilbert–Elliott by the tick, 20 ms long in the mean, a fifth of the
/// time. (Counted in datagrams, as SimPath does, a burst outlasts a whole handshake, which sends one a
/// second.)
class Bursts {
 public:
  explicit Bursts(double period_s) : leave_(period_s / 0.020), enter_(leave_ * 0.2 / 0.8) {}
  void step(net::SimPath& path, Random& random) noexcept {
    path.down = path.down ? !random.chance(leave_) : random.chance(enter_);
  }

 private:
  double leave_, enter_;
};

/// What must hold whatever the method promises.
class LimitWatch {
 public:
  LimitWatch(double force_limit_n, double slew_n) : force_limit_n_(force_limit_n), slew_n_(slew_n) {}
  bool kept(const recording::Sample& row) noexcept {
    const double force_n = row.hand_force_applied_h_n[2];
    // Rounding of a force of some newtons: far below 1e-9 of it.
    const bool grows_slowly = std::fabs(force_n) <= std::max(0.0, std::copysign(1.0, force_n) * last_n_) +
                                                        slew_n_ * (1 + 1e-9) + 1e-12;
    const bool good = std::fabs(force_n) <= force_limit_n_ * (1 + 1e-12) && grows_slowly &&
                      row.energy_in_j >= in_j_ && row.energy_out_j >= out_j_;
    last_n_ = force_n;
    in_j_ = row.energy_in_j;
    out_j_ = row.energy_out_j;
    return good;  // not, if anything is NaN
  }

 private:
  double force_limit_n_, slew_n_;
  double last_n_ = 0, in_j_ = 0, out_j_ = 0;
};

}  // namespace

const char* channel_name(Channel channel) noexcept {
  switch (channel) {
    case Channel::kIdeal:
      return "ideal";
    case Channel::kJitter:
      return "jitter";
    case Channel::kBursts:
      return "bursts";
    case Channel::kSpite:
      return "spite";
    case Channel::kRestarts:
      return "restarts";
    case Channel::kEverything:
      return "everything";
  }
  return "unknown";
}

std::int64_t AttackConfig::ticks() const {
  return std::llround((seconds + 6 * rtt_s) / hand.period_s);
}

double promised_bound_j(const AttackConfig& config) {
  return (config.method == control::Method::kKsClamp ? 1 : 2) * config.allowance_j;
}

bool balances_both_ports(control::Method method) noexcept {
  return method == control::Method::kTank;
}

AttackOutcome attack(const AttackConfig& config, const std::shared_ptr<AccountedHand>& hand) {
  const auto watch = std::make_shared<support::WallWatch>();
  support::VirtualSession session(session_config(config, hand, watch));
  const control::Scaling scaling = session.station().config().scaling;
  const bool restarts = config.channel == Channel::kRestarts || config.channel == Channel::kEverything;
  const bool lossy = config.channel == Channel::kBursts || config.channel == Channel::kEverything;
  Bursts bursts(config.hand.period_s);
  const double restart_chance = config.hand.period_s / (config.restart_mean_s + 10 * config.rtt_s);
  Random random(config.seed ^ 0x7e57a27u);
  LimitWatch limits(session.station().force_limit_n(),
                    session.station().config().slew_n_s * config.hand.period_s);
  AttackOutcome outcome;
  double last_pos_m = 0;
  const std::int64_t ticks = config.ticks();
  for (; outcome.steps < ticks && !hand->too_fast(); ++outcome.steps) {
    const recording::Sample& row = session.step();
    outcome.stopped = outcome.stopped || (row.limit_flags & recording::kLimitStop) != 0;
    outcome.limits_kept = outcome.limits_kept && limits.kept(row);
    outcome.quantum_bound_j = row.energy_bound_j;
    if (!hand->too_fast()) {
      const double both_j = hand->account().extracted_j() + scaling.hand_energy_j(watch->taken_in_aj);
      outcome.generated_j = std::max(outcome.generated_j, both_j);
    }
    if (config.channel == Channel::kSpite) {
      // Force and motion of the interval that has just passed. What is on the way already cannot be stopped.
      const bool gives = row.hand_force_applied_h_n[2] * (hand->pos_m() - last_pos_m) > 0;
      session.link().path_a_to_b().down = session.link().path_b_to_a().down = gives;
    }
    last_pos_m = hand->pos_m();
    if (restarts && random.chance(restart_chance)) session.restart_server();
    if (lossy) {
      bursts.step(session.link().path_a_to_b(), random);
      bursts.step(session.link().path_b_to_a(), random);
    }
  }
  outcome.extracted_j = hand->account().most_extracted_j();
  outcome.given_j = hand->account().most_given_j();
  outcome.too_fast = hand->too_fast();
  return outcome;
}

std::vector<NamedHand> named_hands(const AttackConfig& config, int every) {
  std::vector<NamedHand> hands;
  int index = 0;
  const auto add = [&](std::string name, auto make, double a, double b) {
    if (index++ % every == 0) hands.push_back({std::move(name), make, a, b});
  };
  const double rtt_s = std::max(config.rtt_s, config.hand.period_s);
  const double v = config.hand.velocity_max_m_s;
  for (const double hz : {1.0, 3.0, 10.0, 30.0, 100.0, 250.0, 0.25 / rtt_s, 0.5 / rtt_s}) {
    const double a_m = std::min(0.008, v / (2 * kPi * hz));
    add(fmt::format("sine of {:.3g} mm, {:.3g} Hz", 1e3 * a_m, hz), make_sine, a_m, hz);
  }
  index = 0;
  for (const double half_s : {0.002, 0.02, 0.1, 0.5 * rtt_s, rtt_s, 2 * rtt_s}) {
    for (const double depth_m : {0.002, 0.008, 0.045}) {
      add(fmt::format("square of {:g} mm, {:g} ms a side", 1e3 * depth_m, 1e3 * half_s), make_square, depth_m,
          half_s);
    }
  }
  index = 0;
  for (const double rate_hz : {3.0, 30.0, 300.0}) {
    for (const double range_m : {0.003, 0.012}) {
      add(fmt::format("telegraph of {:g} mm, {:g} turns a second", 1e3 * range_m, rate_hz), make_telegraph,
          range_m, rate_hz);
    }
  }
  index = 0;
  for (const double patience_s : {0.0, 0.01, 0.5 * rtt_s}) {
    for (const double in_m_s : {0.02, 0.1, v}) {
      add(fmt::format("greedy, in at {:g} m/s, out after {:g} ms", in_m_s, 1e3 * patience_s), make_greedy,
          in_m_s, patience_s);
    }
  }
  index = 0;
  for (const double arm_kg : {0.2, 1.0, 500.0}) {
    for (const double hz : {4.0, 20.0, 80.0, 200.0, 300.0, 450.0}) {
      add(fmt::format("passive arm of {:g} kg, {:g} Hz", arm_kg, hz), make_mass_spring, arm_kg, hz);
    }
  }
  return hands;
}

Climbed climb(const AttackConfig& config, double knot_s, int tries, const std::vector<double>& start_m) {
  const double period_s = config.hand.period_s;
  const auto stride = static_cast<std::size_t>(std::max(1.0, std::round(knot_s / period_s)));
  const std::size_t count = static_cast<std::size_t>(config.ticks()) / stride + 2;
  Climbed best;
  best.knots_m.resize(count, -config.clearance_m);
  for (std::size_t i = 0; i < count && !start_m.empty(); ++i)
    best.knots_m[i] = start_m[std::min(i * stride, start_m.size() - 1)];
  const PathRange range{-config.clearance_m - 0.030, -config.clearance_m + 0.010, kLowestM, kHighestM};
  const auto run = [&](const std::vector<double>& knots_m) {
    // Between two points on a line.
    const auto hand = driven(config, [&knots_m, stride](const DrivenHand::View& view) {
      const auto tick = static_cast<std::size_t>(view.tick + 1);
      const std::size_t knot = std::min(tick / stride, knots_m.size() - 2);
      const double part = static_cast<double>(tick - knot * stride) / static_cast<double>(stride);
      return knots_m[knot] + std::min(1.0, part) * (knots_m[knot + 1] - knots_m[knot]);
    });
    const AttackOutcome outcome = attack(config, hand);
    best.steps += outcome.steps;
    return outcome;
  };
  best.outcome = run(best.knots_m);
  Random random(config.seed * 1000003 + stride);
  for (int i = 0; i < tries; ++i) {
    std::vector<double> knots_m = best.knots_m;
    change_a_stretch(knots_m, period_s * static_cast<double>(stride), range, random);
    const AttackOutcome outcome = run(knots_m);
    if (outcome.extracted_j > best.outcome.extracted_j) {
      best.outcome = outcome;
      best.knots_m = std::move(knots_m);
    }
  }
  return best;
}

WorstAttack worst_attack(const AttackConfig& given, const AttackEffort& effort) {
  WorstAttack worst;
  worst.config = given;
  worst.config.seconds = effort.seconds;
  AttackConfig config = worst.config;
  std::vector<double> best_path_m;
  double best_driven_j = -1;
  std::uint64_t best_seed = config.seed;
  const auto note = [&](const AttackOutcome& outcome, const std::string& name) {
    worst.limits_kept = worst.limits_kept && outcome.limits_kept;
    worst.stopped += outcome.stopped;
    worst.generated_j = std::max(worst.generated_j, outcome.generated_j);
    if (worst.attacks == 0 || outcome.extracted_j > worst.outcome.extracted_j) {
      worst.outcome = outcome;
      worst.hand = name;
      worst.config.seed = config.seed;
    }
    ++worst.attacks;
  };
  for (const NamedHand& named : named_hands(config, effort.every)) {
    config.seed = given.seed + 1000 * static_cast<std::uint64_t>(worst.attacks);  // restarts, losses
    const auto hand = named.make(config, named.a, named.b);
    const AttackOutcome outcome = attack(config, hand);
    worst.steps += outcome.steps;
    note(outcome, named.name);
    const auto* driven_hand = dynamic_cast<const DrivenHand*>(hand.get());
    if (driven_hand != nullptr && outcome.extracted_j > best_driven_j) {
      best_driven_j = outcome.extracted_j;
      best_path_m = driven_hand->path_m();
      best_seed = config.seed;
    }
  }
  config.seed = best_seed;  // the same link, on which that path was the best
  for (const double knot_s : {config.hand.period_s, 0.025}) {
    if (effort.climb_tries == 0) break;
    const Climbed climbed = climb(config, knot_s, effort.climb_tries, best_path_m);
    worst.steps += climbed.steps;
    note(climbed.outcome, knot_s < 0.01 ? "hill climbing, white" : "hill climbing, below 20 Hz");
    worst.attacks += effort.climb_tries;
  }
  return worst;
}

}  // namespace telenano::studies
