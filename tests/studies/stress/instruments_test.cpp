// The measuring instruments: nothing that they say of a method is worth more than they are.
#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/base/random.h"
#include "tests/studies/stress/arm.h"
#include "tests/studies/stress/true_account.h"
#include "tests/support/plant_oracle.h"

namespace telenano::studies::stress {
namespace {

// Against the power series of the plant's oracle, which shares no method with the matrix exponential.
TEST(StressArm, FollowsTheOracleWithAMovingAim) {
  ArmConfig config;
  ArmAxis arm(config);
  support::PlantOracleConfig same;
  same.device_mass_kg = config.device_mass_kg;
  same.device_damping_n_s_m = config.device_damping_n_s_m;
  same.arm_mass_kg = config.arm_mass_kg;
  same.arm_stiffness_n_m = config.arm_stiffness_n_m;
  same.arm_damping_n_s_m = config.arm_damping_n_s_m;
  same.grip_stiffness_n_m = config.grip_stiffness_n_m;
  same.grip_damping_n_s_m = config.grip_damping_n_s_m;
  support::PlantOracle oracle(same);
  oracle.reset(0);
  Random random(3);
  for (int k = 1; k <= 400; ++k) {
    const double force_n = random.uniform(-3, 3), aim_m = 0.01 * std::sin(0.02 * k);
    arm.advance(force_n, aim_m);
    oracle.advance(force_n, aim_m, config.period_s);
    // Both in long double; its rounding, 400 times, in a damped system.
    ASSERT_NEAR(arm.pos_m(), static_cast<double>(oracle.pos_m()), 1e-15) << k;
  }
  EXPECT_NEAR(static_cast<double>(arm.stored_j()), static_cast<double>(oracle.stored_j()), 1e-14);
  EXPECT_GT(std::fabs(arm.pos_m()), 1e-4) << "something happened";
}

// A sampled spring K that is moved by x = A sin ωt gives away ½KΔx² a step (tests/studies/methods): 39.5 mJ.
TEST(StressAccount, ASampledSpringGivesAwayWhatTheClosedFormSays) {
  constexpr double kK = 1000, kA = 0.010, kHz = 2, kT = 1e-3;
  constexpr int kSteps = 10'000;
  TrueAccount account(0, kT, 0);
  const auto at = [&](int k) { return kA * std::sin(2 * M_PI * kHz * kT * k); };
  // Along a diagonal: a third of the energy on each axis.
  const Vec3 along = Vec3(1, 1, 1).normalized();
  for (int k = 1; k <= kSteps; ++k) account.add(-kK * at(k - 1) * along, (at(k) - at(k - 1)) * along);
  const double expected_j = 0.5 * kK * kA * kA * kSteps * (1 - std::cos(2 * M_PI * kHz * kT));
  // 1e4 terms of up to 1e-5 J, each of three products rounded in double.
  EXPECT_NEAR(account.given_j(), expected_j, 1e-11);
  EXPECT_EQ(account.quantum_bound_j(), 0);
}

// Q must hold whatever is hidden below a quantum: positions off by ±q/2 in the worst way for each change of
// force reach it.
TEST(StressAccount, TheQuantumsBoundIsReachedByTheWorstEncoderAndNeverPassed) {
  constexpr double kQ = 1e-5;
  Random random(5);
  TrueAccount account(0, 1e-3, kQ);
  double hidden_j = 0, x = 0, last_f = 0, last_e = 0;
  for (int k = 0; k < 2000; ++k) {
    const double f = random.uniform(-5, 5), next = x + random.uniform(-1e-4, 1e-4);
    // Error after the interval: against the change of force that follows is best done at random here.
    const double e = kQ * (random.uniform() - 0.5);
    account.add(Vec3(0, 0, f), Vec3(0, 0, next - x));
    hidden_j += f * (e - last_e);
    last_e = e;
    last_f = f;
    x = next;
    ASSERT_LE(std::fabs(hidden_j), account.quantum_bound_j());
  }
  // Worst: the error flips with the sign of each step of force.
  TrueAccount worst(0, 1e-3, kQ);
  hidden_j = last_e = 0;
  for (int k = 0; k < 1000; ++k) {
    const double f = k % 2 == 0 ? 1 : -1, e = kQ / 2 * f;
    worst.add(Vec3(0, 0, f), Vec3::Zero());
    hidden_j += f * (e - last_e);
    last_e = e;
  }
  EXPECT_NEAR(hidden_j, worst.quantum_bound_j(), 2e-3 * hidden_j) << "to a term of the first sample";
  (void)last_f;
}

}  // namespace
}  // namespace telenano::studies::stress
