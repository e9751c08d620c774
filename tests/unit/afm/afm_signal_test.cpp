// Signals that are no measurement: frozen, at an end of their range, noisy, inverted; and none of it from
// live ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

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

/// The signal of a tip in contact, bit for bit the same, over the given windows of the base: low, high.
SignalFault repeated_over(const std::vector<std::array<double, 2>>& windows_nm) {
  constexpr std::int64_t kPeriodNs = 5 * kMs;
  SignalWatch watch({40, 1, 2000, 10, kPeriodNs});
  // Quieter than the converter's step: no number of repeats is too many.
  const double air_v[] = {0.03, 0.03, 0.03 + kQuantum16V, 0.03, 0.03};
  watch.learn(air_v);
  SignalFault last = SignalFault::kNone;
  std::int64_t time_ns = 0;
  for (const auto& [low_nm, high_nm] : windows_nm) {
    SignalWatch::Reading r;
    r.time_ns = time_ns += kPeriodNs;
    r.volts = 0.09;
    r.force_nn = 126;
    r.base_nm = r.highest_nm = high_nm;
    r.lowest_nm = low_nm;
    r.way_nm = high_nm - low_nm;
    r.contact_nn = 5;
    r.stiffness_n_m = 37;
    last = watch.add(r);
    if (last != SignalFault::kNone) break;
  }
  return last;
}

// A reading may have been averaged anywhere in its window. One that shows the force of after a step down, in
// whose window the step lay, is the same as those that follow at rest.
TEST(AfmSignals, AValueThatRestsAfterAMotionIsNotFrozen) {
  EXPECT_EQ(repeated_over({{-4, -1}, {-4, -1}, {-4, -4}, {-4, -4}, {-4, -4}, {-4, -4}}), SignalFault::kNone);
  EXPECT_EQ(repeated_over({{-4, -1}, {-1, -1}, {-1, -1}, {-1, -1}}), SignalFault::kNone) << "up again";
  // The base has surely stood at two places, 3 nm apart, in each direction.
  EXPECT_EQ(repeated_over({{-1, -1}, {-4, -1}, {-4, -4}, {-4, -4}}), SignalFault::kFrozen);
  EXPECT_EQ(repeated_over({{-4, -4}, {-4, -1}, {-1, -1}, {-1, -1}}), SignalFault::kFrozen);
}

// Twice, more than half a second apart, a reading shows the force of after a step in whose window it lay, and
// the next one, at rest, the same: no step that the force did not follow.
TEST(AfmSignals, AForceThatIsAheadOfTheWindowsBeginningFollows) {
  constexpr std::int64_t kPeriodNs = 5 * kMs;
  const auto after = [](bool answers) {
    SignalWatch watch({40, 1, 2000, 10, kPeriodNs});
    const double air_v[] = {0.03, 0.03, 0.03 + kQuantum16V, 0.03, 0.03};
    watch.learn(air_v);
    SignalWatch::Reading r;
    r.contact_nn = 5;
    r.stiffness_n_m = 37;
    double at_nm = -1, force_nn = 26;
    const auto read = [&](double from_nm) {
      r.time_ns += kPeriodNs;
      // Noise of a step, so that no value repeats for long.
      r.force_nn = force_nn + (r.time_ns / kPeriodNs % 2 == 0 ? 0.6 : 0);
      r.volts = 0.03 + r.force_nn / 2000;
      r.base_nm = r.highest_nm = from_nm;
      r.lowest_nm = at_nm;
      r.way_nm = from_nm - at_nm;
      return watch.add(r);
    };
    SignalFault fault = SignalFault::kNone;
    for (int step = 0; step < 3 && fault == SignalFault::kNone; ++step) {
      for (int i = 0; i < (answers ? 101 : 60) && fault == SignalFault::kNone; ++i) fault = read(at_nm);
      at_nm -= 3;
      if (answers) force_nn += 100;
      if (fault == SignalFault::kNone) fault = read(at_nm + 3);
    }
    return fault;
  };
  EXPECT_EQ(after(true), SignalFault::kNone);
  EXPECT_EQ(after(false), SignalFault::kNotFollowing);
}

// In the air the lever has bent by 3.2 nN since the tare, as it does by temperature, and the noise of 2 nN
// lifts many a reading over what counts as contact, 5 nN. The base goes up and down by 20 nm: there is
// nothing to follow. Half an hour of readings.
TEST(AfmSignals, NoiseOverTheThresholdOfContactIsNoContact) {
  Random random(3);
  SignalWatch watch({40, 1, 2000, 10, 5 * kMs});
  std::vector<double> air_v(20);
  for (double& v : air_v) v = 1e-3 * random.normal();
  watch.learn(air_v);
  SignalWatch::Reading r;
  r.contact_nn = 5;
  r.stiffness_n_m = 28;
  double base_nm = 10, by_nm = -1;
  SignalFault fault = SignalFault::kNone;
  int i = 0;
  for (; i < 360'000 && fault == SignalFault::kNone; ++i) {
    if (base_nm < 5 || base_nm > 25) by_nm = -by_nm;
    r.time_ns += 5 * kMs;
    r.base_nm = r.highest_nm = std::max(base_nm, base_nm + by_nm);
    r.lowest_nm = std::min(base_nm, base_nm + by_nm);
    r.way_nm = 1;
    base_nm += by_nm;
    r.force_nn = 3.2 + 2 * random.normal();
    r.volts = r.force_nn / 2000;
    fault = watch.add(r);
  }
  EXPECT_EQ(name(fault), "good") << "after " << i << " readings";
}

/// Pressing, sliding, holding and lifting at random; `seconds` of it. How it ended: empty where the tip was
/// there all the time.
std::string task(Bench& b, double seconds, Random& random) {
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
    if (b.phase() != Phase::kFollowing)
      return std::string(name(b.afm->logic().state().cause)) + ": " + b.afm->logic().news() + " after " +
             std::to_string(1e-9 * static_cast<double>(b.afm->now_ns())) + " s";
  }
  return {};
}

/// An approach for each: a drift of 0.5 nm/s would leave the piezo's range in twenty minutes.
constexpr double kSessionS = 600;

/// Less than a minute for each of five rigs here; the hours' run sets TELENANO_AFM_TASK_S (5760: 8 h in all).
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
    std::uint64_t seed = 11;
    for (double left_s = task_s(); left_s > 0; left_s -= kSessionS, ++seed) {
      SCOPED_TRACE(::testing::Message()
                   << "noise " << rig.noise_nm_sqrt_hz << ", quantum " << rig.quantum_v << ", seed " << seed);
      Bench b;
      b.rig.seed = seed;
      b.rig.noise_nm_sqrt_hz = rig.noise_nm_sqrt_hz;
      b.rig.quantum_v = rig.quantum_v;
      b.rig.drift_z_nm_s = rig.drift_nm_s;
      b.start();
      ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
      Random random(seed);
      EXPECT_EQ(task(b, std::min(left_s, kSessionS), random), "");
      // Not only for want of contact.
      b.follow(Vec3(b.afm->logic().state().base_w_nm.x(), b.afm->logic().state().base_w_nm.y(), -12));
      b.run(2000);
      EXPECT_GT(b.afm->controller().tip().normal_force_nn(), 50);
    }
  }
}

// What withdraws for nothing does not pass for what never does.
TEST(AfmSignals, ASlaveThatWithdrawsInATaskDoesNotPassIt) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  Random random(11);
  EXPECT_EQ(task(b, 2, random), "");
  b.afm->logic().withdraw(Cause::kStaleForce, b.afm->now_ns());
  EXPECT_NE(task(b, 2, random), "");
}

}  // namespace
}  // namespace telenano::afm
