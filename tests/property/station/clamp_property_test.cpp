#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "telenano/common/control/passivity_controller.h"
#include "telenano/master/station/force_limits.h"
#include "tests/support/watched_controller.h"

// The hard guarantee: below v_max, no hand and no environment extract more than the allowance beyond what the
// device certainly dissipates. The account of the test is its own: long double, true positions.
namespace telenano::control {
namespace {

using support::WatchedController;

constexpr double kT = 1e-3, kVmax = 0.5;

enum class Hand { kHillClimb, kRandom, kSine, kTelegraph, kPushPull };

struct Outcome {
  long double least_j = 0;  ///< least of the energy put in so far
  long double least_with_loss_j = 0;
  long double margin_j = 1e9;  ///< least of put in + loss + Q
};

Outcome attack(WatchedController& controller, Hand hand, double damping, double quantum_m, int steps,
               std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  Vec3 pos_m = Vec3::Zero(), force_n = Vec3::Zero();
  long double put_in_j = 0, loss_j = 0;
  Outcome outcome;
  const auto seen = [&](const Vec3& p) {
    if (quantum_m == 0) return p;
    Vec3 q;
    for (int axis = 0; axis < 3; ++axis) q[axis] = std::floor(p[axis] / quantum_m + 0.5) * quantum_m;
    return q;
  };
  Vec3 telegraph = Vec3::UnitX();
  controller.observe(force_n, seen(pos_m), kT);
  for (int k = 0; k < steps; ++k) {
    Vec3 step_m = Vec3::Zero();
    switch (hand) {
      case Hand::kHillClimb:  // always with the force, as fast as allowed
        if (force_n.norm() > 0) step_m = force_n.normalized() * kVmax * kT;
        break;
      case Hand::kRandom:
        step_m = Vec3(normal(random), normal(random), normal(random));
        step_m *= uniform(random) * kVmax * kT / step_m.norm();
        break;
      case Hand::kSine:
        step_m.z() = kVmax * kT * std::cos(0.3 * k);
        break;
      case Hand::kTelegraph:
        if (uniform(random) < 0.05)
          telegraph = Vec3(normal(random), normal(random), normal(random)).normalized();
        step_m = telegraph * kVmax * kT;
        break;
      case Hand::kPushPull:  // pays in slowly, takes out at once
        step_m =
            force_n.norm() > 0 ? Vec3(force_n.normalized() * kT * (k % 50 < 40 ? -0.05 : kVmax)) : step_m;
        break;
    }
    pos_m += step_m;
    put_in_j -= static_cast<long double>(force_n.dot(step_m));
    loss_j += static_cast<long double>(damping) * step_m.squaredNorm() / kT;
    outcome.least_j = std::min(outcome.least_j, put_in_j);
    controller.observe(force_n, seen(pos_m), kT);
    outcome.margin_j =
        std::min(outcome.margin_j,
                 put_in_j + loss_j + static_cast<long double>(controller.observer().quantisation_bound_j()));
    // An environment without any sense: sticks to a direction, jumps, or pushes where the hand goes.
    Vec3 wanted_n;
    switch ((k / 200) % 3) {
      case 0:
        wanted_n = 10 * Vec3(normal(random), normal(random), normal(random));
        break;
      case 1:
        wanted_n = 12 * (step_m.norm() > 0 ? Vec3(step_m.normalized()) : Vec3(Vec3::UnitX()));
        break;
      default:
        wanted_n = Vec3(0, 0, 12);
        break;
    }
    bool cut = false;
    force_n = station::limit_norm(wanted_n + controller.damper_force_h_n(), 12, cut);
    force_n = station::limit_norm(force_n, controller.force_bound_n(), cut);
  }
  return outcome;
}

constexpr Hand kHands[] = {Hand::kHillClimb, Hand::kRandom, Hand::kSine, Hand::kTelegraph, Hand::kPushPull};

TEST(ClampProperty, NoHandBelowVmaxExtractsMoreThanTheAllowance) {
  std::mt19937_64 random(20);
  for (Hand hand : kHands) {
    for (double damping : {0.0, 2.0}) {
      for (double quantum_m : {0.0, 1e-5}) {
        PassivityConfig config;
        config.damping_certain_n_s_m = damping;
        config.shown_stiffness_n_m = 1000;
        config.position_quantum_m = quantum_m;
        WatchedController controller(config);
        const Outcome outcome =
            attack(controller, hand, damping, quantum_m, 100'000, random);  // 2e6 steps in all
        // Rounding of 1e5 additions of ~6 mJ at most: far below 1e-12 J.
        ASSERT_GE(static_cast<double>(outcome.margin_j), -config.allowance_j - 1e-12)
            << static_cast<int>(hand) << ' ' << damping << ' ' << quantum_m;
        if (damping == 0 && quantum_m == 0) {
          ASSERT_GE(static_cast<double>(outcome.least_j), -config.allowance_j - 1e-12);
        }
      }
    }
  }
}

TEST(ClampProperty, ALateTickOverdrawsOnceAndIsRepaidFirst) {
  // Nobody can know before that the next interval will be k periods long. It may then cost (k −
  // 1)·|F|·v_max·T beyond the allowance; but only once, however many late ticks there are, as nothing is
  // given until that is repaid.
  constexpr double kForceN = 12;
  constexpr int kLongest = 20;
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    PassivityConfig config;
    WatchedController controller(config);
    Vec3 pos_m = Vec3::Zero(), force_n = Vec3::Zero();
    long double put_in_j = 0, least_j = 0;
    controller.observe(force_n, pos_m, kT);
    for (int k = 0; k < 20'000; ++k) {
      const int periods = uniform(random) < 0.05 ? 1 + static_cast<int>(uniform(random) * kLongest) : 1;
      const double dt_s = kT * periods;
      // Pays in slowly, takes out as fast as allowed.
      const double velocity_m_s = k % 100 < 60 ? -0.05 * uniform(random) : kVmax;
      const Vec3 step_m = velocity_m_s * dt_s * Vec3::UnitZ();
      pos_m += step_m;
      put_in_j -= static_cast<long double>(force_n.dot(step_m));
      least_j = std::min(least_j, put_in_j);
      controller.observe(force_n, pos_m, dt_s);
      bool cut = false;
      force_n = station::limit_norm(Vec3(0, 0, kForceN), controller.force_bound_n(), cut);
    }
    ASSERT_GE(static_cast<double>(least_j),
              -config.allowance_j - (kLongest - 1) * kForceN * kVmax * kT - 1e-12)
        << seed;
  }
}

TEST(ClampProperty, TheControllersWithoutAClampGiveJoulesAway) {
  for (Method method : {Method::kNone, Method::kKs}) {
    PassivityConfig config;
    config.method = method;
    config.damping_certain_n_s_m = 2;
    WatchedController controller(config);
    std::mt19937_64 random(20);
    const Outcome outcome = attack(controller, Hand::kSine, 2, 0, 100'000, random);
    EXPECT_LT(static_cast<double>(outcome.least_j), -1.0) << method_name(method);
  }
}

TEST(ClampProperty, AMutantThatCreditsItsDamperLeaks) {
  // The same account, but what the damper dissipates is credited once more: it must fail the assertion above.
  double put_in_j = 0, account_j = 0, pos_m = 0, last_m = 0, force_n = 0;
  double least_j = 0;
  for (int k = 0; k < 20'000; ++k) {
    pos_m += kVmax * kT * std::cos(0.3 * k);
    const double moved_m = pos_m - last_m;
    last_m = pos_m;
    put_in_j -= force_n * moved_m;
    account_j -= force_n * moved_m;
    const double damper = account_j < 0 ? 0.8 : 0.0;
    account_j += damper * moved_m * moved_m / kT;
    least_j = std::min(least_j, put_in_j);
    const double bound_n = std::max(0.0, account_j + 0.01) / (kVmax * kT);
    force_n = std::min(bound_n, 12.0) * (moved_m > 0 ? 1 : -1);
  }
  EXPECT_LT(least_j, -0.02);
}

}  // namespace
}  // namespace telenano::control
