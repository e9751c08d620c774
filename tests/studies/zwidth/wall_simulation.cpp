#include "tests/studies/zwidth/wall_simulation.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::studies {
namespace {

constexpr double kDiverged_m = 10.0;
constexpr double kStart_m = 1e-4;

double quantised(double value, double quantum) {
  return quantum > 0 ? std::nearbyint(value / quantum) * quantum : value;
}

}  // namespace

std::vector<PushingHand> trying_hands(const control::HapticDisplay& display) {
  std::vector<PushingHand> hands{{{}, 1.0}, {{}, 10.0}};
  // The mass of the hand decides how fast a swing grows, hardly from which stiffness on: a light one is
  // quick.
  const double mass = 0.4 * display.mass_kg;
  for (const double theta :
       {0.1, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7, 1.9, 2.1, 2.3, 2.5, 2.7, 2.9, 3.1}) {
    const double omega = theta / display.period_s;
    hands.push_back({{mass, (display.mass_kg + mass) * omega * omega, 0.0}, 10.0});
  }
  return hands;
}

WallRun simulate_wall(const WallPlant& plant, double stiffness, const PushingHand& hand,
                      std::vector<double>* trace_m) {
  const double period = plant.display.period_s;
  const double mass = plant.display.mass_kg + hand.arm.mass_kg;
  const HeldMotion h =
      held_motion(mass, plant.display.damping_n_s_m + hand.arm.damping_n_s_m, hand.arm.stiffness_n_m, period);
  const auto d = static_cast<std::size_t>(plant.damper.delay_samples);
  std::vector<double> line(d, hand.push_n);  // at rest, the wall pushes back what the hand pushes
  const double pole = plant.damper.filter_s / (plant.damper.filter_s + period);
  const double gain = 1.0 / (plant.damper.filter_s + period);
  const double friction = plant.coulomb_friction_n;
  const double duration_s = std::min(100.0, 4.0 + 80.0 * mass / plant.display.damping_n_s_m);
  const auto steps = static_cast<std::int64_t>(std::ceil(duration_s / period));
  const std::int64_t last_second = steps - static_cast<std::int64_t>(std::ceil(1.0 / period));

  // The hand's spring rests where wall and push balance, so that no hand leaves the wall by its spring alone.
  const double rest = hand.push_n / stiffness;  // inside the wall is positive
  double x = rest + kStart_m;
  double v = 0;
  double seen_before = quantised(rest, plant.encoder_quantum_m);
  double velocity = 0;
  std::size_t at = 0;
  double low = 1e300, high = -1e300, low_n = 1e300, high_n = -1e300;
  WallRun run;
  for (std::int64_t k = 0; k < steps; ++k) {
    const double seen = quantised(x, plant.encoder_quantum_m);
    velocity = pole * velocity + gain * (seen - seen_before);
    seen_before = seen;
    double force = seen > 0 ? std::max(0.0, stiffness * seen + plant.damper.damping_n_s_m * velocity)
                            : plant.outside_damping_n_s_m * velocity;
    if (plant.force_quantum_n > 0) force = quantised(force, plant.force_quantum_n);
    if (d > 0) {
      std::swap(force, line[at]);
      at = at + 1 == d ? 0 : at + 1;
    }
    if (k >= last_second) {
      low_n = std::min(low_n, force);
      high_n = std::max(high_n, force);
    }
    double net = hand.push_n - force;
    if (friction > 0) {
      // Held for a period like the rest, and not beyond stopping the mass within it.
      const double unchecked = h.vx * (x - rest) + h.vv * v + h.vf * net;
      const double stopping = unchecked / h.vf;
      net -= std::clamp(stopping, -friction, friction);
    }
    const double from_rest = x - rest;
    const double next_v = h.vx * from_rest + h.vv * v + h.vf * net;
    x = rest + h.xx * from_rest + h.xv * v + h.xf * net;
    v = next_v;
    ++run.steps;
    if (trace_m != nullptr) trace_m->push_back(x);
    if (!(std::fabs(x) < kDiverged_m)) {
      run.peak_to_peak_m = kDiverged_m;
      run.force_peak_to_peak_n = HUGE_VAL;
      return run;
    }
    if (k >= last_second) {
      low = std::min(low, x);
      high = std::max(high, x);
    }
  }
  run.peak_to_peak_m = high - low;
  run.force_peak_to_peak_n = high_n - low_n;
  return run;
}

namespace {

double swing_allowed_m(const WallPlant& plant) {
  return std::max(0.5e-3, 4.0 * plant.encoder_quantum_m);
}

}  // namespace

double reachable_damping(const WallPlant& given, double stiffness, bool feels) {
  WallPlant plant = given;
  std::vector<PushingHand> hands = trying_hands(plant.display);
  std::erase_if(hands, [](const PushingHand& hand) { return hand.push_n < kFirmPush_n; });
  const auto reaches = [&](double damping) {
    plant.damper.damping_n_s_m = damping;
    return std::all_of(hands.begin(), hands.end(), [&](const PushingHand& hand) {
      const WallRun run = simulate_wall(plant, stiffness, hand);
      return run.peak_to_peak_m <= swing_allowed_m(plant) &&
             (!feels || run.force_peak_to_peak_n <= kFeltSwing_n);
    });
  };
  double reached = 0;
  for (double damping = 0.01 * plant.display.damping_n_s_m; damping < 1e4; damping *= 1.05) {
    if (reaches(damping)) {
      reached = damping;
    } else if (reached > 0) {
      break;
    }
  }
  return reached;
}

double simulated_stiffness(const WallPlant& plant, std::int64_t* steps) {
  const std::vector<PushingHand> hands = trying_hands(plant.display);
  const double allowed = swing_allowed_m(plant);
  std::size_t first = 0;  // the hand that last set the wall off is asked first
  const auto stable = [&](double k) {
    for (std::size_t i = 0; i < hands.size(); ++i) {
      const std::size_t which = (first + i) % hands.size();
      const WallRun run = simulate_wall(plant, k, hands[which]);
      if (steps != nullptr) *steps += run.steps;
      if (run.peak_to_peak_m > allowed) {
        first = which;
        return false;
      }
    }
    return true;
  };
  const double scale = 2.0 * plant.display.damping_n_s_m / plant.display.period_s;
  double low = 0.01 * scale;
  if (!stable(low)) return std::numeric_limits<double>::quiet_NaN();
  double high = low;
  while (high < 1e4 * scale) {
    high = 1.25 * low;
    if (!stable(high)) break;
    low = high;
  }
  while (high > 1.01 * low) {
    const double middle = std::sqrt(low * high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace telenano::studies
