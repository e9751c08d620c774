#include "telenano/common/control/energy_observer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "telenano/common/base/constants.h"
#include "tests/support/plant_oracle.h"

namespace telenano::control {
namespace {

constexpr double kPeriodS = 1e-3;

/// Force at the wrong end of the interval: the mistake that the observer must not make.
struct MutantObserver {
  bool started = false;
  double last_m = 0;
  double energy_j = 0;
  void update(double new_force_n, double pos_m) {
    if (started) energy_j += -new_force_n * (pos_m - last_m);
    started = true;
    last_m = pos_m;
  }
};

/// Wall of 1000 N/m on both sides of zero, moved 10 mm at 2 Hz for 10 s. The truth: ∫ of the held force times
/// the continuous velocity, by 5-point Gauss–Legendre in each interval (exact to rounding for so slow a
/// sine).
struct MovedWall {
  double truth_j = 0;
  double exchanged_j = 0;
  double observed_j = 0;
  double mutant_j = 0;
};

MovedWall moved_wall() {
  constexpr double kStiffness = 1000, kAmplitude = 0.01, kOmega = 2 * kPi * 2;
  constexpr long double kNode[] = {0, 0.538469310105683091036314420700L, 0.906179845938663992797626878299L};
  constexpr long double kWeight[] = {0.568888888888888888888888888889L, 0.478628670499366468041291514836L,
                                     0.236926885056189087514264040720L};
  EnergyObserver observer;
  MutantObserver mutant;
  long double truth_j = 0;
  double force_n = 0;
  for (int k = 0; k <= 10'000; ++k) {
    const double pos_m = kAmplitude * std::sin(kOmega * k * kPeriodS);
    observer.update(Vec3(force_n, 0, 0), Vec3(pos_m, 0, 0));
    force_n = -kStiffness * pos_m;
    mutant.update(force_n, pos_m);
    if (k == 10'000) break;
    const long double middle = (k + 0.5L) * 1e-3L;
    long double moved = 0;
    const auto velocity = [&](long double t) {
      return static_cast<long double>(kAmplitude) * kOmega * std::cos(static_cast<long double>(kOmega) * t);
    };
    for (int i = 0; i < 3; ++i) {
      const long double offset = kNode[i] * 0.5e-3L;
      moved += kWeight[i] * 0.5e-3L *
               (i == 0 ? velocity(middle) : velocity(middle - offset) + velocity(middle + offset));
    }
    truth_j -= force_n * moved;
  }
  return {static_cast<double>(truth_j), observer.exchanged_j(), observer.energy_j(), mutant.energy_j};
}

TEST(EnergyObserver, AgreesWithTheTrueWorkOfAMovedWall) {
  const MovedWall wall = moved_wall();
  EXPECT_NEAR(wall.truth_j, -39.5e-3, 0.05e-3);  // −½KΣΔx² = −½·1000·(0.01·4π·1e-3)²/2·1e4
  // 1e-12·Σ|FΔx| is the promise; sin() itself is good to half an ulp of 10 mm (1e-18 m), which is far less.
  EXPECT_NEAR(wall.observed_j, wall.truth_j, 1e-12 * wall.exchanged_j);
}

TEST(EnergyObserver, TheForceOfTheWrongSampleReversesTheSign) {
  const MovedWall wall = moved_wall();
  EXPECT_NEAR(wall.mutant_j, 39.5e-3, 0.05e-3);
  // The assertion of the test above tells the two apart by ten orders of magnitude.
  EXPECT_GT(std::fabs(wall.mutant_j - wall.truth_j), 1e9 * 1e-12 * wall.exchanged_j);
}

TEST(EnergyObserver, AgreesWithAnIndependentPlantInAClosedLoop) {
  support::PlantOracleConfig config;
  config.coulomb_friction_n = 0.02L;
  support::PlantOracle plant(config);
  plant.reset(0);
  constexpr double kQuantum = 1e-5;
  EnergyObserver exact;
  EnergyObserver quantised(kQuantum);
  double force_n = 0;
  for (int k = 0; k < 5'000; ++k) {
    const double pos_m = static_cast<double>(plant.pos_m());
    const double seen_m = std::floor(pos_m / kQuantum + 0.5) * kQuantum;
    exact.update(Vec3(0, force_n, 0), Vec3(0, pos_m, 0));
    quantised.update(Vec3(0, force_n, 0), Vec3(0, seen_m, 0));
    force_n = seen_m < 0 ? std::fmin(-10'000 * seen_m, 8.0) : 0;
    plant.advance(force_n, -0.005L * std::sin(2 * static_cast<long double>(kPi) * (k + 1) * 1e-3L), 1e-3L);
  }
  const double pos_m = static_cast<double>(plant.pos_m());
  exact.update(Vec3(0, force_n, 0), Vec3(0, pos_m, 0));
  quantised.update(Vec3(0, force_n, 0), Vec3(0, std::floor(pos_m / kQuantum + 0.5) * kQuantum, 0));
  const double truth_j = -static_cast<double>(plant.force_work_j);
  ASSERT_GT(exact.exchanged_j(), 0.01);
  ASSERT_GT(plant.reversals, 5);
  EXPECT_NEAR(exact.energy_j(), truth_j, 1e-12 * exact.exchanged_j());
  EXPECT_NEAR(quantised.energy_j(), truth_j,
              1e-12 * quantised.exchanged_j() + quantised.quantisation_bound_j());
  // The oracle's accounts balance by themselves: work done on the plant = stored + lost. Long double, 2e4
  // sub-steps.
  const long double balance = plant.force_work_j + plant.intent_work_j - plant.stored_j() -
                              plant.device_loss_j - plant.friction_loss_j - plant.arm_loss_j;
  EXPECT_LT(std::fabs(static_cast<double>(balance)), 1e-14);
}

TEST(EnergyObserver, QuantisationErrorStaysWithinItsBound) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 200; ++trial) {
    const double quantum_m = 1e-5;
    EnergyObserver exact;
    EnergyObserver quantised(quantum_m);
    Vec3 pos_m = Vec3::Zero(), force_n = Vec3::Zero();
    for (int k = 0; k < 500; ++k) {
      for (int axis = 0; axis < 3; ++axis) pos_m[axis] += 2e-5 * uniform(random);
      Vec3 seen_m;
      for (int axis = 0; axis < 3; ++axis)
        seen_m[axis] = std::floor(pos_m[axis] / quantum_m + 0.5) * quantum_m;
      exact.update(force_n, pos_m);
      quantised.update(force_n, seen_m);
      for (int axis = 0; axis < 3; ++axis) {
        // Adversarial half of the time: the force follows the error, which is what the bound must cover.
        force_n[axis] = trial % 2 ? 10 * uniform(random) : 1e6 * (seen_m[axis] - pos_m[axis]);
      }
      ASSERT_LE(std::fabs(quantised.energy_j() - exact.energy_j()),
                quantised.quantisation_bound_j() + 1e-12 * exact.exchanged_j());
    }
  }
}

TEST(EnergyObserver, SplitsMonotonically) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  EnergyObserver observer;
  double in_j = 0, out_j = 0;
  for (int k = 0; k < 100'000; ++k) {
    observer.update(Vec3(normal(random), normal(random), normal(random)),
                    0.01 * Vec3(normal(random), normal(random), normal(random)));
    ASSERT_GE(observer.energy_in_j(), in_j);
    ASSERT_GE(observer.energy_out_j(), out_j);
    in_j = observer.energy_in_j();
    out_j = observer.energy_out_j();
  }
  EXPECT_NEAR(in_j - out_j, observer.energy_j(),
              1e-13 * observer.exchanged_j());  // a few roundings of the terms
}

TEST(CompensatedSum, LosesNothingOfAMillionSmallTerms) {
  CompensatedSum sum;
  sum.add(1e6);
  for (int i = 0; i < 1'000'000; ++i) sum.add(1e-10);
  sum.add(-1e6);
  // The carry adds a million terms itself: at worst 1e6·ulp(1e-4)/2. Plain summation loses all of it (ulp of
  // 1e6 is 1.2e-10).
  EXPECT_NEAR(sum.value(), 1e-4, 1e-14);
}

TEST(EnergyObserver, TheFirstCallOnlySetsThePosition) {
  EnergyObserver observer;
  EXPECT_EQ(observer.update(Vec3(5, 5, 5), Vec3(1, 1, 1)), 0);
  EXPECT_EQ(observer.energy_j(), 0);
  EXPECT_NEAR(observer.update(Vec3(0, 0, -2), Vec3(1, 1, 1.5)), 1.0, 1e-15);  // pushing 0.5 m against 2 N
}

}  // namespace
}  // namespace telenano::control
