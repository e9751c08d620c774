#include "telenano/master/device/replay_device.h"

#include <gtest/gtest.h>

#include <limits>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

HandTrack track() {
  return {{{0, Vec3(0, 0, 0.01), kButtonDeadman},
           {0.001, Vec3(0, 0, 0.02), kButtonDeadman},
           {0.003, Vec3(0.004, 0, 0.02), kButtonDeadman | kButtonStop},
           {0.004, Vec3(0.004, 0, 0), 0}}};
}

DeviceReading look(ReplayDevice& device, std::int64_t dt_ns) {
  device.advance(dt_ns);
  DeviceReading reading;
  device.read(reading);
  return reading;
}

TEST(ReplayDevice, HoldsStillUntilStartedThenGoesOnALineBetweenThePoints) {
  ReplayDevice device(track());
  EXPECT_EQ(look(device, 5'000'000).hand_pos_h_m, Vec3(0, 0, 0.01));
  EXPECT_EQ(look(device, 0).buttons, kButtonDeadman);
  device.start_motion();
  EXPECT_EQ(look(device, 0).hand_pos_h_m, Vec3(0, 0, 0.01));
  EXPECT_LT((look(device, 500'000).hand_pos_h_m - Vec3(0, 0, 0.015)).norm(), 1e-17);
  EXPECT_LT((look(device, 1'500'000).hand_pos_h_m - Vec3(0.002, 0, 0.02)).norm(), 1e-17);
  EXPECT_FALSE(device.motion_done());
  const DeviceReading later = look(device, 1'000'000);
  EXPECT_LT((later.hand_pos_h_m - Vec3(0.004, 0, 0.02)).norm(), 1e-17);
  EXPECT_EQ(later.buttons, kButtonDeadman) << "the stop that ended that session is not pressed again";
  EXPECT_EQ(look(device, 10'000'000).hand_pos_h_m, Vec3(0.004, 0, 0));
  EXPECT_EQ(look(device, 10'000'000).buttons, 0u);
  EXPECT_TRUE(device.motion_done());
  EXPECT_EQ(device.motion_duration_s(), 0.004);
}

// A hand that went on while the tip stood still would be elsewhere than it was in the recording.
TEST(ReplayDevice, WaitsWhileTheTipIsHeld) {
  ReplayDevice device(track());
  device.start_motion();
  look(device, 500'000);
  TipSeen held;
  held.held = true;
  device.see_tip(held);
  EXPECT_LT((look(device, 20'000'000).hand_pos_h_m - Vec3(0, 0, 0.015)).norm(), 1e-17);
  EXPECT_FALSE(device.motion_done());
  device.see_tip({});
  EXPECT_LT((look(device, 1'500'000).hand_pos_h_m - Vec3(0.002, 0, 0.02)).norm(), 1e-17);
}

// A station that was blind for so long lets go of the tip: what the hand did meanwhile would move nothing.
TEST(ReplayDevice, WaitsInATickThatIsFarTooLate) {
  ReplayDevice device(track());
  device.start_motion();
  look(device, 500'000);
  EXPECT_LT((look(device, 100'000'000).hand_pos_h_m - Vec3(0, 0, 0.015)).norm(), 1e-17);
  EXPECT_LT((look(device, 1'500'000).hand_pos_h_m - Vec3(0.002, 0, 0.02)).norm(), 1e-17);
}

TEST(ReplayDevice, TakesForceUpToThatOfAnOmega) {
  ReplayDevice device(track());
  EXPECT_EQ(device.write_force(Vec3(1, 2, 3)), Vec3(1, 2, 3));
  EXPECT_NEAR(device.write_force(Vec3(0, 30, 40)).norm(), 12, 1e-12);
  EXPECT_EQ(device.write_force(Vec3(0, std::numeric_limits<double>::quiet_NaN(), 0)), Vec3::Zero());
}

TEST(ReplayDevice, RefusesWhatIsNoMotion) {
  EXPECT_THROW(ReplayDevice(HandTrack{}), UserError);
  HandTrack bad = track();
  bad.points[2].time_s = 0.001;
  EXPECT_THROW(ReplayDevice{bad}, UserError);
  bad = track();
  bad.points[1].hand_pos_h_m.x() = std::numeric_limits<double>::infinity();
  EXPECT_THROW(ReplayDevice{bad}, UserError);
  bad = track();
  bad.points[0].time_s = 1e-4;
  EXPECT_THROW(ReplayDevice{bad}, UserError);
}

}  // namespace
}  // namespace telenano::device
