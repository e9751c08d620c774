// The hand that a puck moves: speed, deadman, silence, stop, unplugging.
#include "telenano/master/device/hid/hid_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/puck_bytes.h"

namespace telenano::device {
namespace {

constexpr std::int64_t kMs = 1'000'000;

class HidDeviceTest : public ::testing::Test {
 protected:
  void say(const support::Bytes& report) {
    take_puck_report(report, news_);
    source_.store(news_);
  }
  DeviceReading tick(std::int64_t dt_ns = kMs) {
    DeviceReading reading;
    device_.advance(dt_ns);
    device_.read(reading);
    return reading;
  }
  /// With reports coming as from a puck that is held.
  DeviceReading hold(const support::Bytes& report, int ticks) {
    DeviceReading reading;
    for (int k = 0; k < ticks; ++k) {
      if (k % 8 == 0) say(report);
      reading = tick();
    }
    return reading;
  }

  HidNews news_{};
  rt::LatestValue<HidNews> source_;
  HidConfig config_{};
  HidDevice device_{source_, config_};
};

TEST_F(HidDeviceTest, DeflectionIsVelocityInTheOperatorsFrame) {
  say(support::kLeftPressed);
  hold(support::kSplitForwards, 200);
  const Vec3 before = tick().hand_pos_h_m;
  const Vec3 after = hold(support::kSplitForwards, 100).hand_pos_h_m;
  // After 200 ms the lag of 30 ms is gone to e^-6.7: away from the operator at full speed.
  EXPECT_LT((after - before - Vec3(0, 0.1 * config_.speed_m_s, 0)).norm(), 2e-3 * 0.1 * config_.speed_m_s);
  hold(support::kSplitRest, 200);
  const Vec3 low = tick().hand_pos_h_m;
  const Vec3 high = hold(support::kSplitLifted, 300).hand_pos_h_m;
  EXPECT_GT(high.z(), low.z());
  EXPECT_NEAR(high.y(), low.y(), 1e-5);  // what is left of the lag
}

// At a quarter of the greatest force half the speed, at all of it a fifth; across and along the whole of it.
TEST_F(HidDeviceTest, AForceHoldsTheHandBackAgainstItAlone) {
  say(support::kLeftPressed);
  const double most_n = device_.info().force_max_n;
  // After the lag has gone; back in the middle each time.
  const auto speed_m_s = [&](const Vec3& force_h_n) {
    say(support::kNonePressed);
    for (int k = 0; k < 3000; ++k) tick();
    say(support::kLeftPressed);
    EXPECT_EQ(device_.write_force(force_h_n), Vec3::Zero()) << "no motors";
    hold(support::kSplitForwards, 300);
    const Vec3 before = tick().hand_pos_h_m;
    const Vec3 after = hold(support::kSplitForwards, 100).hand_pos_h_m;
    return Vec3((after - before) / 0.1);
  };
  const double whole = config_.speed_m_s;
  EXPECT_NEAR(speed_m_s(Vec3(0, -0.25 * most_n, 0)).y(), whole / 2, 2e-3 * whole);
  EXPECT_NEAR(speed_m_s(Vec3(0, -most_n, 0)).y(), whole / 5, 2e-3 * whole);
  EXPECT_NEAR(speed_m_s(Vec3(0, most_n, 0)).y(), whole, 2e-3 * whole) << "along it";
  EXPECT_NEAR(speed_m_s(Vec3(0, 0, most_n)).y(), whole, 2e-3 * whole) << "across it";
  const Vec3 slanting = speed_m_s(Vec3(0, -most_n, most_n) / std::sqrt(2.0));
  // Of (0, 1, 0), the part along (0, -1, 1)/√2 is divided by 5: (0, 1, 0) - 4/5·½·(0, 1, -1).
  EXPECT_NEAR(slanting.y(), 0.6 * whole, 2e-3 * whole);
  EXPECT_NEAR(slanting.z(), 0.4 * whole, 2e-3 * whole);
  EXPECT_NEAR(speed_m_s(Vec3::Constant(std::nan(""))).y(), whole, 2e-3 * whole);
  EXPECT_NEAR(speed_m_s(Vec3::Zero()).y(), whole, 2e-3 * whole);
}

TEST_F(HidDeviceTest, NoMotionWithoutTheDeadman) {
  const DeviceReading reading = hold(support::kSplitRight, 500);
  EXPECT_EQ(reading.hand_pos_h_m, Vec3::Zero());
  EXPECT_EQ(reading.buttons, 0u);
}

TEST_F(HidDeviceTest, ReleasedItStopsAndGoesBackToTheMiddleSlowly) {
  say(support::kLeftPressed);
  hold(support::kSplitRight, 1000);
  const Vec3 far = tick().hand_pos_h_m;
  EXPECT_GT(far.x(), 0.04);
  say(support::kNonePressed);
  Vec3 last = tick().hand_pos_h_m;
  for (int k = 0; k < 1500; ++k) {
    const Vec3 now = hold(support::kSplitRight, 1).hand_pos_h_m;
    EXPECT_LE((now - last).norm(), 1.001e-3 * config_.speed_m_s);
    last = now;
  }
  EXPECT_LT(last.norm(), 1e-9);
}

TEST_F(HidDeviceTest, AMotionOfWhichNothingIsHeardEnds) {
  say(support::kLeftPressed);
  hold(support::kSplitRight, 100);
  for (int k = 0; k < 700; ++k) tick();  // 0.5 s of hold, then the lag
  const Vec3 still = tick().hand_pos_h_m;
  for (int k = 0; k < 300; ++k) EXPECT_LT((tick().hand_pos_h_m - still).norm(), 2e-5);
  const Vec3 again = hold(support::kSplitRight, 100).hand_pos_h_m;
  EXPECT_GT(again.x(), still.x() + 0.002) << "the next word sets it going again";
}

TEST_F(HidDeviceTest, AStopBetweenTwoTicksCounts) {
  tick();
  say(support::kRightPressed);
  say(support::kNonePressed);
  EXPECT_EQ(tick().buttons, kButtonStop);
  EXPECT_EQ(tick().buttons, 0u);
}

TEST_F(HidDeviceTest, PressesBeforeTheSessionAreNoneOfIts) {
  say(support::kRightPressed);
  say(support::kNonePressed);
  EXPECT_EQ(tick().buttons, 0u);
}

TEST_F(HidDeviceTest, UnpluggedFailsForGoodAndStandsStill) {
  say(support::kLeftPressed);
  hold(support::kSplitRight, 100);
  news_.gone = true;
  source_.store(news_);
  Vec3 last = tick().hand_pos_h_m;
  for (int k = 0; k < 300; ++k) {
    const DeviceReading reading = tick();
    EXPECT_EQ(reading.status, DeviceStatus::kFailed);
    EXPECT_EQ(reading.cause, ForceOffCause::kUnplugged);
    EXPECT_EQ(reading.buttons, 0u) << "the deadman is not held by a device that has gone";
    EXPECT_LE((reading.hand_pos_h_m - last).norm(), 1.001e-3 * config_.speed_m_s);
    last = reading.hand_pos_h_m;
  }
}

TEST_F(HidDeviceTest, NeverFasterThanItsSpeedNorOutsideWhateverIsSaid) {
  Random random(5);
  Vec3 last = Vec3::Zero();
  for (int k = 0; k < 200'000; ++k) {
    if (random.chance(0.2)) {
      for (auto& axis : news_.puck.axes) axis = static_cast<std::int16_t>(random.bits());
      news_.puck.buttons = static_cast<std::uint32_t>(random.below(2));
      ++news_.reports;
      source_.store(news_);
    }
    const std::int64_t dt_ns = 1 + static_cast<std::int64_t>(random.below(3 * kMs));
    const Vec3 now = tick(dt_ns).hand_pos_h_m;
    // The target moves at speed_m_s at most, towards its old or its new side; the smoothing adds none.
    ASSERT_LE((now - last).norm(),
              config_.speed_m_s * static_cast<double>(dt_ns) * 1e-9 * (1 + 1e-9) + 3e-17);
    ASSERT_LE(now.cwiseAbs().maxCoeff(), config_.motion.half_m);
    last = now;
  }
}

TEST_F(HidDeviceTest, APuckAtRestThatIsNotQuiteAtZeroStandsStill) {
  say(support::kLeftPressed);
  news_.puck.axes = {17, -17, 17, 0, 0, 0};
  for (int k = 0; k < 300; ++k) {
    ++news_.reports;
    source_.store(news_);
    EXPECT_EQ(tick().hand_pos_h_m, Vec3::Zero());
  }
}

TEST_F(HidDeviceTest, RefusesToBeWithoutDeadman) {
  HidConfig config;
  config.buttons.deadman = 0;
  EXPECT_THROW(HidDevice(source_, config), UserError);
  config = {};
  config.speed_m_s = 0.3;
  EXPECT_THROW(HidDevice(source_, config), UserError);
}

TEST_F(HidDeviceTest, TicksDoNotAllocate) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  const support::AllocGuard guard;
  for (int k = 0; k < 1000; ++k) tick();
  EXPECT_EQ(device_.write_force(Vec3(1, 1, 1)), Vec3::Zero());
  EXPECT_EQ(guard.allocations(), 0u);
}

}  // namespace
}  // namespace telenano::device
