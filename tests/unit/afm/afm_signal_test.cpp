// Signals that are no measurement: frozen, at an end of their range, noisy, inverted; and none of it from
// live ones.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "tests/unit/afm/afm_bench.h"

namespace telenano::afm {
namespace {

using afm_sim::SensorFault;

constexpr double kQuantum16V = 20.0 / 65536;

void sensor(Bench& b, SensorFault fault) {
  b.afm->apply({0, afm_sim::FaultKind::kSensor, 0, 0, fault});
}

/// What a signal that stood still may add to the limit: a step, the drift while it is believed, the thermal
/// bending since the tare, and the noise of the last true reading.
double allowed_nn(const Bench& b, double believed_s) {
  const double k = b.config.spring_constant_n_m;
  return b.config.force_max_nn +
         k * (b.config.step_nm + std::fabs(b.rig.drift_z_nm_s) * believed_s + 2 * b.rig.thermal_nm) +
         6 * b.afm->logic().state().noise_nn;
}

TEST(AfmSignals, AFrozenOneIsFoundAndNoFurtherPressedThanTheLastTrueReadingAllows) {
  for (const double quantum_v : {0.0, kQuantum16V}) {
    for (const double from_nm : {10.0, -1.0, -4.0}) {
      SCOPED_TRACE(::testing::Message() << from_nm << " nm, quantum " << quantum_v);
      Bench b;
      b.rig.quantum_v = quantum_v;
      b.start();
      ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
      b.follow(Vec3(0, 0, from_nm));
      b.run(500);
      ASSERT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
      b.afm->controller().tip().forget_peak();
      sensor(b, SensorFault::kFrozen);
      b.follow(Vec3(0, 0, -30));
      b.run(5000);
      EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible");
      EXPECT_NE(b.afm->logic().news().find("signal"), std::string::npos) << b.afm->logic().news();
      EXPECT_TRUE(b.afm->controller().withdrawn());
      EXPECT_LT(b.afm->controller().tip().peak_force_nn(), allowed_nn(b, 5));
    }
  }
}

TEST(AfmSignals, OneAtAnEndOfItsRangeWithdraws) {
  for (const SensorFault end : {SensorFault::kHighEnd, SensorFault::kLowEnd}) {
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing));
    b.follow(Vec3(0, 0, -4));
    b.run(500);
    // Without the controller's own protection, which may act at either end.
    b.afm->controller().begin({nanonis::CommandId::kSafeTipOnOffSet, {2}}, -1, b.afm->now_ns());
    sensor(b, end);
    b.run(400);
    if (end == SensorFault::kLowEnd) {
      EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
    }
    EXPECT_TRUE(b.afm->controller().withdrawn());
    EXPECT_LT(b.afm->controller().tip().peak_force_nn(), allowed_nn(b, 1));
  }
}

TEST(AfmSignals, OneWithAHundredTimesTheNoiseWithdraws) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, 10));
  b.run(500);
  sensor(b, SensorFault::kNoisy);
  b.run(1000);
  EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
  EXPECT_TRUE(b.afm->controller().withdrawn());
}

TEST(AfmSignals, OneThatAnswersMotionTheWrongWayWithdraws) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, -3));
  b.run(500);
  ASSERT_TRUE(b.afm->logic().state().touching);
  sensor(b, SensorFault::kInverted);
  for (int i = 0; i < 70; ++i) {
    b.follow(Vec3(0, 0, -3 - 0.1 * i));
    b.run(10);
  }
  b.run(400);
  EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_LT(b.afm->controller().tip().peak_force_nn(), b.config.force_max_nn);
}

TEST(AfmSignals, OneThatIsFrozenBeforeTheFirstTouchPressesNoFurther) {
  for (const Phase phase : {Phase::kTaring, Phase::kTouching}) {
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(phase));
    b.run(phase == Phase::kTouching ? 60 : 0);
    sensor(b, SensorFault::kFrozen);
    b.run(70'000);
    EXPECT_EQ(b.phase(), Phase::kWithdrawn) << name(phase);
    EXPECT_TRUE(b.afm->controller().withdrawn());
    EXPECT_LT(b.afm->controller().tip().peak_force_nn(), allowed_nn(b, 5)) << name(phase);
  }
}

/// Pressing, sliding, holding and lifting at random; `seconds` of it.
void task(Bench& b, double seconds, Random& random) {
  Vec3 at(0, 0, 10);
  for (const std::int64_t end = b.afm->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
       b.afm->now_ns() < end;) {
    const double speed_nm_s = random.uniform(5, 400);
    Vec3 to(random.uniform(-40, 40), random.uniform(-40, 40), random.uniform(-12, 30));
    if (random.chance(0.5)) to.head<2>() = at.head<2>();
    if (random.chance(0.3)) to = at;
    // Back to where the surface is known, every few legs: slowly down, as one who measures does.
    if (random.chance(0.25)) {
      for (const Vec3& by : {Vec3(at.x(), at.y(), 10), Vec3(0, 0, 10), Vec3(0, 0, -6), Vec3(0, 0, 10)}) {
        const int steps = static_cast<int>((by - at).norm() / (by.z() < 0 ? 15 : 100) / 0.02) + 1;
        for (int i = 1; i <= steps && b.phase() == Phase::kFollowing; ++i) {
          b.follow(at + (by - at) * (static_cast<double>(i) / steps));
          b.run(20);
        }
        at = by;
      }
      continue;
    }
    const double way_s = std::max(0.2, (to - at).norm() / speed_nm_s);
    const int steps = static_cast<int>(way_s * 1000 / 20) + 1;
    for (int i = 1; i <= steps && b.phase() == Phase::kFollowing; ++i) {
      // A link with 100 ms of round trip and 2 % of loss: what is heard is old, and now and then older still.
      if (!random.chance(0.02)) b.follow(at + (to - at) * (static_cast<double>(i) / steps));
      b.run(20);
    }
    at = to;
    ASSERT_EQ(b.phase(), Phase::kFollowing)
        << name(b.afm->logic().state().cause) << ": " << b.afm->logic().news() << " after "
        << 1e-9 * static_cast<double>(b.afm->now_ns()) << " s";
  }
}

/// A minute for each rig here; the hours' run sets TELENANO_AFM_TASK_S.
double task_s() {
  const char* const text = std::getenv("TELENANO_AFM_TASK_S");
  return text != nullptr ? std::atof(text) : 40;
}

TEST(AfmSignals, LiveOnesNeverWithdraw) {
  struct Rig {
    double noise_nm_sqrt_hz, quantum_v, drift_nm_s;
  };
  // As it is; coarse; quieter than a sixth of the converter's step, and than any; drifting.
  for (const Rig& rig : {Rig{5e-4, 0, -0.05}, Rig{5e-4, kQuantum16V, -0.05}, Rig{1e-4, kQuantum16V, -0.05},
                         Rig{0, kQuantum16V, -0.05}, Rig{5e-3, kQuantum16V, 0.5}}) {
    SCOPED_TRACE(::testing::Message() << "noise " << rig.noise_nm_sqrt_hz << ", quantum " << rig.quantum_v);
    Bench b;
    b.rig.noise_nm_sqrt_hz = rig.noise_nm_sqrt_hz;
    b.rig.quantum_v = rig.quantum_v;
    b.rig.drift_z_nm_s = rig.drift_nm_s;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    Random random(11);
    task(b, task_s(), random);
    if (::testing::Test::HasFatalFailure()) return;
    // Not only for want of contact.
    b.follow(Vec3(b.afm->logic().state().base_w_nm.x(), b.afm->logic().state().base_w_nm.y(), -12));
    b.run(2000);
    EXPECT_GT(b.afm->controller().tip().normal_force_nn(), 50);
  }
}

}  // namespace
}  // namespace telenano::afm
