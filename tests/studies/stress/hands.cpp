#include "tests/studies/stress/hands.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/random.h"
#include "telenano/master/device/intended_motion.h"
#include "tests/studies/stress/arm.h"
#include "tests/studies/stress/operator_acts.h"

namespace telenano::studies::stress {
namespace {

constexpr double kTouchN = 0.05;
constexpr double kAboveM = 0.010;  // how high over the ground a driven hand goes

double turns_sin(double turns) noexcept {
  return det_sin_cos(2 * kPi * (turns - std::floor(turns))).sin;
}

struct View {
  std::int64_t tick = 0;  ///< since the motion began
  double force_n = 0;     ///< along z, upwards, until the next sample
  double pos_m = 0;       ///< over the ground
};

/// Goes along z where a policy sends it, as fast as allowed, as strong as it wants to be.
class Driven final : public HandMotion {
 public:
  using Policy = std::function<double(const View&)>;
  Driven(const HandConfig& config, double wall_m, Policy policy)
      // One part in 10⁹ less than allowed, so that no rounding of Δx is ever too fast; and no faster than
      // what the encoder will not make too fast.
      : reach_m_(config.velocity_max_m_s * config.period_s * (1 - 1e-9) - config.quantum_m),
        wall_m_(wall_m),
        policy_(std::move(policy)) {}
  Vec3 next(const Vec3& pos_h_m, const Vec3& force_h_n) noexcept override {
    const double goal_m = wall_m_ + policy_({tick_++, force_h_n.z(), pos_h_m.z() - wall_m_});
    Vec3 next_h_m = pos_h_m;
    next_h_m.z() += std::clamp(goal_m - pos_h_m.z(), -reach_m_, reach_m_);
    return next_h_m;
  }

 private:
  double reach_m_, wall_m_;
  Policy policy_;
  std::int64_t tick_ = 0;
};

/// Device and arm on each axis that the aim leaves, z at least.
class Arms final : public HandMotion {
 public:
  using Aim = std::function<Vec3(std::int64_t tick, const Vec3& force_h_n)>;
  Arms(const ArmConfig& config, bool lateral, Aim aim)
      : x_(config), y_(config), z_(config), lateral_(lateral), aim_(std::move(aim)) {}
  Vec3 next(const Vec3&, const Vec3& force_h_n) noexcept override {
    const Vec3 aim_h_m = aim_(++tick_, force_h_n);
    z_.advance(force_h_n.z(), aim_h_m.z());
    if (!lateral_) return {0, 0, z_.pos_m()};
    x_.advance(force_h_n.x(), aim_h_m.x());
    y_.advance(force_h_n.y(), aim_h_m.y());
    return {x_.pos_m(), y_.pos_m(), z_.pos_m()};
  }

 private:
  ArmAxis x_, y_, z_;
  bool lateral_;
  Aim aim_;
  std::int64_t tick_ = 0;
};

device::IntendedMotion intended(const RunSpec& spec, const Ground& ground) {
  const double start_nm = -ground.wall_m / ground.metres_per_nm;
  if (spec.hand == HandKind::kPress) {
    // As deep as a firm hand goes to feel some newtons: 10 mm, of which it yields most.
    const double deep_nm = -0.010 / ground.metres_per_nm;
    const PressTimes t = press_times(spec.seconds);
    const auto at = [](double time_s, double z_nm) {
      return device::IntendedMotion::Waypoint{time_s, Vec3(0, 0, z_nm)};
    };
    return device::IntendedMotion({at(0, start_nm), at(t.down_s, start_nm), at(t.held_s, deep_nm),
                                   at(t.out_s, deep_nm), at(t.free_s, start_nm)});
  }
  device::TaskOptions options;
  options.start_height_nm = start_nm;
  options.duration_s = 0.9 * spec.seconds;
  options.retract_nm = start_nm;
  options.depth_nm = std::min(5.0, 0.012 / ground.metres_per_nm);
  options.hover_low_nm = std::min(10.0, 0.5 * start_nm);
  options.hover_high_nm = std::min(20.0, start_nm);
  options.scan_size_nm = std::min(40.0, 0.04 / ground.metres_per_nm);
  options.scan_lines = 3;
  device::Task task = device::Task::kIndent;
  if (spec.hand == HandKind::kPosition) task = device::Task::kPosition;
  if (spec.hand == HandKind::kContact) task = device::Task::kContact;
  if (spec.hand == HandKind::kRaster) task = device::Task::kScan;
  return device::IntendedMotion::for_task(task, options);
}

/// One task after the other, each for as long as the operator lets it be (OperatorActs), from where the last
/// one has led.
std::unique_ptr<HandMotion> make_tasks(const ArmConfig& arm, const HandConfig& hand, const Ground& ground) {
  constexpr device::Task kTurn[] = {device::Task::kIndent, device::Task::kScan, device::Task::kPosition,
                                    device::Task::kContact};
  constexpr double kApproachS = 0.25;
  const double start_nm = -ground.wall_m / ground.metres_per_nm;
  device::TaskOptions options;
  options.duration_s = 2;
  options.start_height_nm = options.retract_nm = start_nm;
  options.depth_nm = std::min(5.0, 0.012 / ground.metres_per_nm);
  options.hover_low_nm = std::min(10.0, 0.5 * start_nm);
  options.hover_high_nm = std::min(20.0, start_nm);
  options.scan_size_nm = std::min(20.0, 0.02 / ground.metres_per_nm);
  options.scan_lines = 3;
  std::vector<device::IntendedMotion> tasks;
  for (const device::Task task : kTurn) tasks.push_back(device::IntendedMotion::for_task(task, options));
  return std::make_unique<Arms>(
      arm, true,
      [=, now = tasks[0], aim_nm = Vec3(0, 0, start_nm), number = std::int64_t{0}, T = hand.period_s](
          std::int64_t tick, const Vec3&) mutable {
        const double t = T * static_cast<double>(tick);
        const auto wanted = static_cast<std::int64_t>(t / OperatorActs::kActEveryS);
        if (wanted != number) {
          number = wanted;
          now = tasks[static_cast<std::size_t>(number) % tasks.size()].beginning_at(aim_nm, kApproachS);
        }
        aim_nm = now.pos_nm(t - OperatorActs::kActEveryS * static_cast<double>(number));
        return Vec3(ground.metres_per_nm * (aim_nm - Vec3(0, 0, start_nm)));
      });
}

std::unique_ptr<HandMotion> make_task(const RunSpec& spec, const HandConfig& hand, const Ground& ground) {
  ArmConfig arm;
  arm.period_s = hand.period_s;
  arm.device_damping_n_s_m = hand.damping_n_s_m;
  arm.device_mass_kg = hand.mass_kg;
  const bool human = spec.hand == HandKind::kHuman;
  if (spec.act == Act::kTask) return make_tasks(arm, hand, ground);
  Random random(spec.seed ^ 0x68616e64u);
  struct Tremor {
    double hz = 0, phase = 0, m = 0;
  };
  std::array<Tremor, 4> tremor{};
  for (std::size_t i = 0; i < tremor.size() && human; ++i) {
    // Physiological tremor, 8–12 Hz, some tenths of a millimetre [Riviere et al. 1997: 0.1 mm and less in
    // trained hands]; the last one is the wandering of the aim.
    tremor[i] = i < 3 ? Tremor{random.uniform(8, 12), random.uniform(), 1.5e-4}
                      : Tremor{random.uniform(0.2, 0.6), random.uniform(), 1.5e-3};
  }
  return std::make_unique<Arms>(
      arm, spec.hand == HandKind::kRaster || human,
      [=, motion = intended(spec, ground), T = hand.period_s](std::int64_t tick, const Vec3&) {
        const double t = T * static_cast<double>(tick);
        Vec3 aim_h_m =
            ground.metres_per_nm * (motion.pos_nm(t) + Vec3(0, 0, ground.wall_m / ground.metres_per_nm));
        if (human) {
          double shake_m = 0;
          for (const Tremor& w : tremor)
            shake_m += w.m * (turns_sin(w.hz * t + w.phase) - turns_sin(w.phase));
          aim_h_m += Vec3(0.3 * shake_m, -0.2 * shake_m, shake_m);
        }
        return aim_h_m;
      });
}

// A passive device and hand: what grows in it has come out of the port. It leans on the ground from 6 mm
// below, and follows what gives way.
std::unique_ptr<HandMotion> make_passive(const RunSpec& spec, const HandConfig& hand, const Ground& ground) {
  ArmConfig arm;
  arm.period_s = hand.period_s;
  arm.device_damping_n_s_m = hand.damping_n_s_m;
  arm.device_mass_kg = hand.mass_kg;
  arm.arm_mass_kg = spec.hand_a;
  arm.arm_damping_n_s_m = arm.grip_damping_n_s_m = 0;
  const double omega = 2 * kPi * spec.hand_b;
  arm.grip_stiffness_n_m = omega * omega / (1 / hand.mass_kg + 1 / spec.hand_a);
  return std::make_unique<Arms>(
      arm, false,
      [=, T = hand.period_s, aim_m = 0.0, unfelt_s = 0.0](std::int64_t, const Vec3& force) mutable {
        const double step_m = 0.05 * T;
        unfelt_s = force.z() == 0 ? unfelt_s + T : 0;
        const double lean_m = ground.wall_m - 0.006;
        const double goal_m = unfelt_s > 0.1 && aim_m <= lean_m ? ground.wall_m - 0.03 : lean_m;
        if (aim_m > goal_m) aim_m = std::max(goal_m, aim_m - step_m);
        return Vec3(0, 0, aim_m);
      });
}

Driven::Policy policy_of(const RunSpec& spec, const HandConfig& hand, const Ground& ground) {
  const double T = hand.period_s, a = spec.hand_a, b = spec.hand_b;
  const double lowest_m = -ground.deepest_nm * ground.metres_per_nm;
  switch (spec.hand) {
    case HandKind::kSine:
      return [=](const View& v) { return -0.3 * a + a * turns_sin(b * T * static_cast<double>(v.tick)); };
    case HandKind::kSquare:
      return [=](const View& v) {
        const auto half = static_cast<std::int64_t>(std::max(1.0, std::round(b / T)));
        return v.tick / half % 2 == 0 ? -a : 0.002;
      };
    case HandKind::kTelegraph:
      return [=, random = Random(spec.seed + 77), down = true](const View& v) mutable {
        if (random.chance(b * T)) down = !down;
        if (v.pos_m < -a) down = false;
        if (v.pos_m > 0.3 * a) down = true;
        return down ? lowest_m : kAboveM;
      };
    case HandKind::kGreedy:
      // Where there is nothing to be felt below, it comes up again.
      return [=, wait_s = 0.1 + 1.5e-3 * spec.rtt_ms, felt_s = 0.0, low_s = 0.0,
              up = false](const View& v) mutable {
        const double in_m = std::max(lowest_m, v.pos_m - a * T);
        if (std::fabs(v.force_n) < kTouchN) {
          felt_s = 0;
          low_s = v.pos_m <= lowest_m ? low_s + T : 0;
          if (low_s > wait_s) up = true;
          if (v.pos_m >= kAboveM) up = false;
          return up ? kAboveM : in_m;
        }
        felt_s += T;
        if (felt_s < b) return in_m;
        return v.force_n > 0 ? v.pos_m + 1 : v.pos_m - 1;
      };
    case HandKind::kWalk:
      // White noise through two poles at 20 Hz, about the ground.
      return [=, random = Random(spec.seed + 78), x = 0.0, y = 0.0](const View&) mutable {
        const double k = 2 * kPi * 20 * T / (1 + 2 * kPi * 20 * T);
        x += k * (a * random.normal() / std::sqrt(k) - x);
        y += k * (x - y);
        return std::clamp(y - 0.3 * a, lowest_m, kAboveM);
      };
    case HandKind::kPath:
      return [=, knots_m = spec.knots_m](const View& v) {
        const double at = static_cast<double>(v.tick + 1) * T / b;
        const std::size_t knot = std::min(static_cast<std::size_t>(at), knots_m.size() - 2);
        const double part = std::min(1.0, at - static_cast<double>(knot));
        return knots_m[knot] + part * (knots_m[knot + 1] - knots_m[knot]);
      };
    default:
      return [](const View&) { return 0.0; };
  }
}

}  // namespace

PressTimes press_times(double seconds) noexcept {
  PressTimes t;
  t.down_s = 0.05 * seconds;
  t.held_s = 0.15 * seconds;
  t.out_s = 0.70 * seconds;
  t.free_s = 0.80 * seconds;
  return t;
}

bool is_task(HandKind kind) noexcept {
  return kind <= HandKind::kHuman;
}
bool is_driven(HandKind kind) noexcept {
  return kind > HandKind::kPassive;
}

std::unique_ptr<StressHand> make_hand(const RunSpec& spec, const Ground& ground) {
  HandConfig config;
  config.period_s = 1 / spec.rate_hz;
  config.damping_n_s_m = spec.damping_n_s_m;
  config.quantum_m = spec.quantum_m;
  std::unique_ptr<HandMotion> motion;
  if (is_task(spec.hand)) {
    motion = make_task(spec, config, ground);
  } else if (spec.hand == HandKind::kPassive) {
    motion = make_passive(spec, config, ground);
  } else {
    motion = std::make_unique<Driven>(config, ground.wall_m, policy_of(spec, config, ground));
  }
  return std::make_unique<StressHand>(config, std::move(motion));
}

}  // namespace telenano::studies::stress
