// What a fault tree of the rig finds besides lost connections and signals that die. The force is the simulated
// rig's own. Here: units that are mistaken, drift, and a photodiode whose zero or gain changes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/random.h"
#include "tests/unit/afm/afm_bench.h"

namespace telenano::afm {
namespace {

TEST(AfmHazards, AUnitMistakenForTheDeflectionIsRefused) {
  for (const double factor : {0.001, 0.1, 10.0, 1000.0}) {
    SCOPED_TRACE(factor);
    Bench b;
    b.config.sensitivity_nm_v = 50 * factor;
    b.start();
    b.run(1000);
    EXPECT_EQ(b.phase(), Phase::kRefused);
    EXPECT_EQ(b.afm->controller().moves(), 0u);
    EXPECT_NE(b.afm->logic().refusal().find("sensitivity_nm_v"), std::string::npos)
        << b.afm->logic().refusal();
  }
}

// Where the controller's calibration is as wrong as the file, what the lever does in contact tells: it cannot
// bend by more than its base moves.
TEST(AfmHazards, ALeverThatBendsByMoreThanItsBaseMovesIsRefused) {
  Bench b;
  b.config.sensitivity_nm_v = 150;
  b.rig.deflection_nm_v = 50;
  b.rig.safe_tip_signal = afm_sim::kDeflectionSignal;
  b.start();
  b.afm->controller().scale_calibration(3);
  for (int i = 0; i < 30000 && !b.afm->logic().finished() && b.phase() != Phase::kFollowing; ++i) b.run(1);
  b.run(200);
  EXPECT_EQ(b.phase(), Phase::kWithdrawn) << b.afm->logic().news();
  EXPECT_NE(b.afm->logic().refusal().find("by more than its base moved"), std::string::npos)
      << b.afm->logic().refusal() << b.afm->logic().news();
  EXPECT_LT(b.afm->controller().tip().peak_force_nn(), b.config.force_max_nn);
}

// Ten minutes on a rig whose drift goes up and down, with creep of any size, touched every ten seconds at
// least: W's zero, the rig's own, and the bound that the slave states. Then a minute in the air.
TEST(AfmHazards, WsZeroAndItsBoundOnRigsOfAnyDriftAndCreep) {
  constexpr int kRigs = 8;
  double worst_nm = 0;
  int within = 0, all = 0, air_within = 0, air_all = 0;
  for (int seed = 1; seed <= kRigs; ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    Bench b;
    const int sign = random.chance(0.5) ? 1 : -1;
    const double period_s = random.uniform(100, 900), phase = random.uniform(0, 6);
    b.rig.seed = static_cast<std::uint64_t>(seed);
    b.rig.creep = random.uniform(0, 0.0045);
    b.rig.creep_s = random.uniform(6, 60);
    b.start();
    const auto run = [&](int ms) {
      for (int i = 0; i < ms; i += 10) {
        const double t_s = 1e-9 * static_cast<double>(b.afm->now_ns());
        b.afm->controller().tip().set_drift_z_nm_s(
            sign * (0.275 + 0.225 * det_sin_cos(2 * std::numbers::pi * t_s / period_s + phase).sin));
        b.run(10);
      }
    };
    for (int i = 0; i < 3000 && b.phase() != Phase::kFollowing; ++i) run(10);
    ASSERT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
    const auto off_nm = [&] {
      return b.afm->logic().state().base_w_nm.z() - b.afm->controller().tip().base_w_nm().z();
    };
    b.follow(Vec3(0, 0, 10));
    run(100);
    const double first_nm = off_nm();
    for (double t_s = 0; t_s < 600 && b.phase() == Phase::kFollowing;) {
      const int wait_ms = static_cast<int>(1000 * random.uniform(2, 7.5));
      b.follow(Vec3(0, 0, 5));
      for (int t = 0; t < wait_ms; t += 100) {
        run(100);
        const double off = std::fabs(off_nm() - first_nm);
        worst_nm = std::max(worst_nm, off);
        ++all;
        if (off <= b.afm->logic().state().surface_bound_nm) ++within;
      }
      for (int i = 0; i < 100; ++i) {  // down to -5 at 10 nm/s
        b.follow(Vec3(0, 0, 5 - 0.1 * i));
        run(10);
      }
      run(1500);
      t_s += 2.5 + 1e-3 * wait_ms;
    }
    b.follow(Vec3(0, 0, 15));
    for (int t = 0; t < 60'000 && b.phase() == Phase::kFollowing; t += 100) {
      run(100);
      ++air_all;
      if (std::fabs(off_nm() - first_nm) <= b.afm->logic().state().surface_bound_nm) ++air_within;
    }
    EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
  }
  std::printf(
      "%d rigs: W's zero off by at most %.2f nm; the bound covered %.1f %%, in a minute of air %.1f %%\n",
      kRigs, worst_nm, 100.0 * within / all, 100.0 * air_within / air_all);
  EXPECT_LE(worst_nm, 2);
  EXPECT_GE(within, 0.95 * all);
  EXPECT_GE(air_within, 0.95 * air_all);
}

/// Down to `depth_nm`, and `high_nm` up in between if that is positive, while the photodiode's zero drifts.
void press_while_the_zero_drifts(Bench& b, double nm_s, double high_nm, double duration_s) {
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  b.follow(Vec3(0, 0, 5));
  b.run(500);
  b.afm->controller().tip().forget_peak();
  const std::int64_t begin_ns = b.afm->now_ns();
  const auto run = [&](int ms) {
    for (int i = 0; i < ms; i += 10) {
      b.afm->controller().set_photodiode(1, nm_s * 1e-9 * static_cast<double>(b.afm->now_ns() - begin_ns));
      b.run(10);
    }
  };
  while (1e-9 * static_cast<double>(b.afm->now_ns() - begin_ns) < duration_s &&
         b.phase() == Phase::kFollowing) {
    b.follow(Vec3(0, 0, -30));  // far more than the limit allows
    run(4000);
    if (high_nm > 0) b.follow(Vec3(0, 0, high_nm));
    run(1000);
  }
}

// A laser that wanders on the photodiode moves the deflection's zero: what reads as a pull makes the force look
// smaller. High above the sample, where there is none, that is found at a tenth of the limit. In contact no
// signal tells: the force goes beyond the limit by what the zero has moved since the tip was last up.
TEST(AfmHazards, AZeroThatMovesIsFoundWhereverTheTipComesUp) {
  constexpr double kDrift_nm_s = -0.04;
  for (const double high_nm : {30.0, 0.0}) {
    SCOPED_TRACE(high_nm);
    Bench b;
    press_while_the_zero_drifts(b, kDrift_nm_s, high_nm, 60);
    const double k = b.config.spring_constant_n_m;
    const double peak_nn = b.afm->controller().tip().peak_force_nn();
    std::printf("zero at %g nm/s, %s: pressed with at most %.0f nN, %s\n", kDrift_nm_s,
                high_nm > 0 ? "up each 5 s" : "never up", peak_nn, std::string(name(b.phase())).c_str());
    if (high_nm > 0) {
      EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
      // A tenth of the limit, what moves in one more way down, and what the drift of the lever's own bending adds.
      EXPECT_LE(peak_nn, 1.1 * b.config.force_max_nn - k * 6 * kDrift_nm_s + k * 2 * b.rig.thermal_nm + 5);
      b.run(500);
      EXPECT_TRUE(b.afm->controller().withdrawn());
    } else {
      EXPECT_LE(peak_nn, b.config.force_max_nn - k * 62 * kDrift_nm_s + k * 2 * b.rig.thermal_nm + 5);
      EXPECT_GT(peak_nn, 1.1 * b.config.force_max_nn) << "so much is open";
    }
  }
}

// The other way the force looks larger: the tip is held back, and in the air it looks like a contact that does not
// follow the motion.
TEST(AfmHazards, AZeroThatMovesTheOtherWayErrsOnTheSafeSide) {
  Bench b;
  press_while_the_zero_drifts(b, 0.04, 30, 60);
  b.run(500);
  EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_LE(b.afm->controller().tip().peak_force_nn(), b.config.force_max_nn + 5);
}

// A laser that weakens by so much, where the controller does not divide by the sum: all forces are read smaller
// by as much, stiffness with them, and nothing tells. The limit holds what is read.
TEST(AfmHazards, AWeakerLaserMakesTheLimitLargerByAsMuch) {
  for (const double gain : {0.8, 0.5}) {
    SCOPED_TRACE(gain);
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    b.follow(Vec3(0, 0, 5));
    b.run(500);
    b.afm->controller().tip().forget_peak();
    for (int i = 0; i < 3000; ++i) {
      b.afm->controller().set_photodiode(1 - (1 - gain) * std::min(1.0, i / 2000.0), 0);
      b.follow(Vec3(0, 0, -30));
      b.run(10);
    }
    const double peak_nn = b.afm->controller().tip().peak_force_nn();
    std::printf("laser at %g: pressed with at most %.0f nN, %s\n", gain, peak_nn,
                std::string(name(b.phase())).c_str());
    EXPECT_LE(peak_nn, b.config.force_max_nn / gain + 5 / gain);
    EXPECT_EQ(b.afm->controller().safe_tips(), 0u);
  }
}

}  // namespace
}  // namespace telenano::afm
