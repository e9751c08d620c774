#include "telenano/master/device/pointer_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/random.h"

namespace telenano::device {
namespace {

constexpr std::int64_t kMs = 1'000'000;

DeviceReading reading_after(PointerDevice& device, std::int64_t dt_ns) {
  device.advance(dt_ns);
  DeviceReading reading;
  device.read(reading);
  return reading;
}

TEST(PointerDevice, ReachesWhatItIsPointedAtWithButtons) {
  rt::LatestValue<PointerState> source;
  PointerDevice device(source);
  DeviceReading reading;
  for (int k = 0; k < 1000; ++k) {
    source.store({{0.02, -0.01, 0.03}, kButtonDeadman});
    reading = reading_after(device, kMs);
  }
  // The point arrives after 0.15 s; the lag then shrinks by (1 + dt/τ)⁻¹ a tick: 850 ticks are e⁻²⁷.
  EXPECT_LT((reading.hand_pos_h_m - Vec3(0.02, -0.01, 0.03)).norm(), 1e-12);
  EXPECT_EQ(reading.buttons, kButtonDeadman);
  EXPECT_EQ(reading.status, DeviceStatus::kOk);
}

TEST(PointerDevice, NeverFasterThanItsSpeedWhateverItIsPointedAt) {
  rt::LatestValue<PointerState> source;
  PointerConfig config;
  PointerDevice device(source, config);
  Random random(7);
  Vec3 last = Vec3::Zero();
  double fastest_m_s = 0;
  for (int k = 0; k < 200'000; ++k) {
    if (random.chance(0.02)) {
      PointerState state;
      for (int axis = 0; axis < 3; ++axis)
        state.hand_pos_h_m[static_cast<std::size_t>(axis)] = random.uniform(-1, 1);
      if (random.chance(0.1)) state.hand_pos_h_m[1] = std::numeric_limits<double>::quiet_NaN();
      if (random.chance(0.1)) state.hand_pos_h_m[2] = std::numeric_limits<double>::infinity();
      source.store(state);
    }
    const std::int64_t dt_ns =
        1 + static_cast<std::int64_t>(random.below(random.chance(0.01) ? 100 * kMs : kMs));
    const Vec3 now = reading_after(device, dt_ns).hand_pos_h_m;
    ASSERT_TRUE(is_finite(now));
    ASSERT_LE(now.cwiseAbs().maxCoeff(), config.motion.half_m);
    // Rounding of positions up to 0.055 m (7e-18 m each) weighs most in a step of one nanosecond.
    ASSERT_LE((now - last).norm(), config.motion.speed_max_m_s * static_cast<double>(dt_ns) * 1e-9 + 3e-17);
    fastest_m_s = std::max(fastest_m_s, (now - last).norm() / (static_cast<double>(dt_ns) * 1e-9));
    last = now;
  }
  EXPECT_GT(fastest_m_s, 0.9 * config.motion.speed_max_m_s);  // the bound is used, not only kept
}

TEST(PointerDevice, SilentViewerLetsGoOfTheDeadmanNotOfTheStop) {
  rt::LatestValue<PointerState> source;
  PointerDevice device(source);
  source.store({{}, kButtonDeadman | kButtonStop});
  reading_after(device, kMs);
  for (int k = 0; k < 500; ++k) EXPECT_EQ(reading_after(device, kMs).buttons, kButtonDeadman | kButtonStop);
  EXPECT_EQ(reading_after(device, kMs).buttons, kButtonStop);
  source.store({{}, kButtonDeadman});
  EXPECT_EQ(reading_after(device, kMs).buttons, kButtonDeadman);
}

// A picture that stands still for a second: the tip stands, so the hand does, and goes on from there.
TEST(PointerDevice, TheHandStandsWhileTheViewerIsSilent) {
  rt::LatestValue<PointerState> source;
  PointerDevice device(source);
  source.store({{0.05, 0, 0}, kButtonDeadman});
  PointerConfig slow;
  slow.motion.speed_max_m_s = 0.05;
  PointerDevice late(source, slow);  // has half of its way before it when the deadman is let go of
  Vec3 at_silence = Vec3::Zero();
  for (int k = 0; k < 1000; ++k) {
    const DeviceReading now = reading_after(late, kMs);
    if (now.buttons == kButtonDeadman) at_silence = now.hand_pos_h_m;
  }
  EXPECT_NEAR(at_silence.x(), 0.025, 0.002);
  EXPECT_LT((reading_after(late, kMs).hand_pos_h_m - at_silence).norm(), 1e-4);
  // Nobody who had let go before stands still on the way back.
  for (int k = 0; k < 1000; ++k) {
    source.store({{0.05, 0, 0}, kButtonDeadman});
    reading_after(late, kMs);
  }
  EXPECT_NEAR(reading_after(late, kMs).hand_pos_h_m.x(), 0.05, 1e-4);
  source.store({{}, 0});
  for (int k = 0; k < 3000; ++k) reading_after(late, kMs);
  EXPECT_NEAR(reading_after(late, kMs).hand_pos_h_m.x(), 0, 1e-9);
}

TEST(PointerDevice, ShowsNoForceAndSaysSo) {
  rt::LatestValue<PointerState> source;
  PointerDevice device(source);
  EXPECT_FALSE(device.info().has_force);
  EXPECT_EQ(device.write_force(Vec3(1, 2, 3)), Vec3::Zero());
}

TEST(PointerDevice, BeforeTheFirstWordAndWithoutTimeItStandsStill) {
  rt::LatestValue<PointerState> source;
  PointerDevice device(source);
  EXPECT_EQ(reading_after(device, kMs).hand_pos_h_m, Vec3::Zero());
  source.store({{0.01, 0, 0}, 0});
  EXPECT_EQ(reading_after(device, 0).hand_pos_h_m, Vec3::Zero());
  EXPECT_EQ(reading_after(device, -kMs).hand_pos_h_m, Vec3::Zero());
}

}  // namespace
}  // namespace telenano::device
