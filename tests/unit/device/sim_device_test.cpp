#include "master/device/sim_device.h"

#include <gtest/gtest.h>

#include "common/base/error.h"

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
