#include "telenano/master/device/sim_device.h"

#include <gtest/gtest.h>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

TEST(SimDevice, HandFollowsTheIntentionFromItsStart) {
  SimDevice device({}, IntendedMotion::for_task(Task::kPosition, {}));
  DeviceReading reading;
  device.read(reading);
  EXPECT_EQ(reading.hand_pos_h_m, Vec3(0, 0, 0));
  EXPECT_EQ(reading.buttons, kButtonDeadman);
  for (int k = 0; k < 1000; ++k) device.advance(1'000'000);
  EXPECT_EQ(device.plant().pos_m(), Vec3(0, 0, 0));  // the operator waits until the motion is started
  device.start_motion();
  for (int k = 0; k < 3000; ++k) device.advance(1'000'000);
  EXPECT_NEAR(device.motion_time_s(), 3, 1e-12);
  // From 40 to 20 nm above the surface at 1 mm/nm; friction 0.02 N against the arm's 400 N/m leaves up to
  // 0.06 mm.
  EXPECT_NEAR(device.plant().pos_m().z(), -0.020, 1e-4);
}

TEST(SimDevice, TimeIsCountedInWholePeriods) {
  SimDevice a({}, IntendedMotion::for_task(Task::kIndent, {}));
  SimDevice b({}, IntendedMotion::for_task(Task::kIndent, {}));
  a.start_motion();
  b.start_motion();
  a.write_force(Vec3(0, 0, 1));
  b.write_force(Vec3(0, 0, 1));
  for (int k = 0; k < 300; ++k) a.advance(1'000'000);
  for (int k = 0; k < 1200; ++k) b.advance(250'000);
  EXPECT_EQ(a.plant().pos_m(), b.plant().pos_m());
}

// A program that was kept from running for a second has led no hand meanwhile: the tip would not have
// followed it, and would never come down to the sample. The plant is the same as after one period, to the
// bit.
TEST(SimDevice, ATickThatIsFarTooLateIsOnePeriod) {
  SimDevice late({}, IntendedMotion::for_task(Task::kContact, {}));
  SimDevice good({}, IntendedMotion::for_task(Task::kContact, {}));
  for (SimDevice* device : {&late, &good}) {
    device->start_motion();
    for (int k = 0; k < 1500; ++k) device->advance(1'000'000);
  }
  late.advance(1'000'000'000);
  good.advance(1'000'000);
  EXPECT_EQ(late.plant().pos_m(), good.plant().pos_m());
  EXPECT_EQ(late.motion_time_s(), good.motion_time_s());
  // What an ordinary machine is late by is time that has passed for the hand too.
  late.advance(49'000'000);
  for (int k = 0; k < 49; ++k) good.advance(1'000'000);
  EXPECT_EQ(late.plant().pos_m(), good.plant().pos_m());
  EXPECT_EQ(late.motion_time_s(), good.motion_time_s());
}

// While the tip stands still because the server is silent the operator does not go on, and is not lost: the
// motion takes as much longer as that took, and goes through the same places.
TEST(SimDevice, WaitsWhileTheTipIsHeld) {
  SimDevice device({}, IntendedMotion::for_task(Task::kContact, {}));
  device.start_motion();
  for (int k = 0; k < 1500; ++k) device.advance(1'000'000);
  const double before_s = device.motion_time_s();
  TipSeen held;
  held.held = true;
  device.see_tip(held);
  for (int k = 0; k < 700; ++k) device.advance(1'000'000);
  EXPECT_EQ(device.motion_time_s(), before_s);
  // At rest at its intention, but for friction: 0.02 N against the arm's 400 N/m.
  EXPECT_NEAR(device.plant().pos_m().z(), device.intended_hand_pos_h_m(before_s).z(), 1e-4);
  TipSeen free;
  free.engaged = true;
  device.see_tip(free);
  for (int k = 0; k < 100; ++k) device.advance(1'000'000);
  EXPECT_NEAR(device.motion_time_s(), before_s + 0.1, 1e-12);
}

TEST(SimDevice, SaysWhatIsReallyApplied) {
  SimDevice device({}, IntendedMotion::for_task(Task::kPosition, {}));
  EXPECT_NEAR(device.write_force(Vec3(0, 0, 100)).z(), 12, 1e-14);
  EXPECT_EQ(device.write_force(Vec3(0, 0, 1)).z(), 1);
}

TEST(SimDevice, RefusesAMotionOutsideItsWorkspace) {
  TaskOptions options;
  options.start_height_nm = 100;
  SimDeviceConfig config;
  config.start_height_nm = 100;  // 1 mm/nm: the surface is 100 mm below the hand
  try {
    SimDevice device(config, IntendedMotion::for_task(Task::kContact, options));
    FAIL();
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("scaling.velocity"), std::string::npos) << error.what();
  }
}

TEST(SimDevice, ApproachesAScriptThatBeginsElsewhere) {
  const IntendedMotion script({{0, Vec3(5, 0, 10)}, {1, Vec3(5, 0, 5)}});
  SimDevice device({}, script);
  EXPECT_EQ(device.intended_hand_pos_h_m(0), Vec3(0, 0, 0));
  EXPECT_NEAR(device.intended_hand_pos_h_m(2).x(), 0.005, 1e-15);
  EXPECT_NEAR(device.intended_hand_pos_h_m(3).z(), -0.035, 1e-15);
}

}  // namespace
}  // namespace telenano::device
