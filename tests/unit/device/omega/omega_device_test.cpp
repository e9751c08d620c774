// A tick with the device: frames, forces, buttons, states, faults of the SDK; through the vendor's symbols.
#include "telenano/master/device/omega/omega_device.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <chrono>
#include <limits>
#include <thread>

#include "tests/support/alloc_guard.h"
#include "tests/unit/device/omega/omega_rig.h"

namespace telenano::device {
namespace {

using support::DrdCall;
using support::StandinSdk;

class OmegaDeviceTest : public ::testing::Test {
 protected:
  OmegaDevice& open(const OmegaConfig& config = {}) {
    device_ = std::make_unique<OmegaDevice>(config, standin_search(), usb_.roots());
    return *device_;
  }
  DeviceReading tick(const Vec3& force_h_n = Vec3::Zero()) {
    DeviceReading reading;
    device_->read(reading);
    applied_h_n_ = device_->write_force(force_h_n);
    return reading;
  }
  /// The state is looked at every so many ticks.
  DeviceReading ticks(const Vec3& force_h_n = Vec3::Zero()) {
    DeviceReading reading;
    for (int k = 0; k < OmegaDevice::kStatusEveryTicks; ++k) reading = tick(force_h_n);
    return reading;
  }

  FakeUsb usb_;
  StandinSdk sdk_;
  std::unique_ptr<OmegaDevice> device_;
  Vec3 applied_h_n_ = Vec3::Zero();
};

TEST_F(OmegaDeviceTest, TheFirstForceIsZeroThenGravityIsCompensatedAndTheWatchdogRuns) {
  open();
  EXPECT_EQ(sdk_->first_force_n, 0.0);
  EXPECT_EQ(sdk_->gravity, 1);
  EXPECT_EQ(sdk_->force_enabled, 1);
  EXPECT_EQ(sdk_->watchdog_units, 0) << "nobody feeds it yet";
  tick();
  EXPECT_EQ(sdk_->watchdog_units, 80);  // 10 ms
  const std::uint64_t before = sdk_->calls_of(DrdCall::kSetForce);
  for (int k = 0; k < 100; ++k) tick();
  EXPECT_EQ(sdk_->calls_of(DrdCall::kSetForce) - before, 100u) << "zero force is sent at every tick";
  device_.reset();
  EXPECT_EQ(sdk_->stopped, 1);
  EXPECT_EQ(sdk_->open, 0);
}

TEST_F(OmegaDeviceTest, MakersFrameToTheOperators) {
  // The maker: x towards the operator, y to the right, z up. H: x right, y away, z up.
  OmegaConfig config;
  config.centre_d_m = Vec3(0.01, 0, 0);
  open(config);
  sdk_->pos_d_m[0] = 0.04;   // 30 mm nearer to the operator than the centre
  sdk_->pos_d_m[1] = 0.02;   // right
  sdk_->pos_d_m[2] = -0.05;  // down
  EXPECT_LT((tick(Vec3(1, 2, 3)).hand_pos_h_m - Vec3(0.02, -0.03, -0.05)).norm(), 1e-17);
  EXPECT_EQ(sdk_->force_n[0], -2);
  EXPECT_EQ(sdk_->force_n[1], 1);
  EXPECT_EQ(sdk_->force_n[2], 3);
  EXPECT_EQ(applied_h_n_, Vec3(1, 2, 3));
}

TEST_F(OmegaDeviceTest, SaturationReturnsTheForceReallyApplied) {
  open();
  sdk_->saturation_n = 5;
  tick(Vec3(6, 0, 8));
  EXPECT_LT((applied_h_n_ - Vec3(3, 0, 4)).norm(), 1e-14);
  tick(Vec3(1, 0, 0));
  EXPECT_EQ(applied_h_n_, Vec3(1, 0, 0));
  sdk_->result_of(DrdCall::kGetForce) = -1;  // unknown: what was asked for is the larger one
  tick(Vec3(6, 0, 8));
  EXPECT_EQ(applied_h_n_, Vec3(6, 0, 8));
}

TEST_F(OmegaDeviceTest, ATimeGuardIsNoError) {
  open();
  sdk_->time_guard = 1;
  sdk_->pos_d_m[2] = 0.01;
  const DeviceReading reading = ticks();
  EXPECT_EQ(reading.status, DeviceStatus::kOk);
  EXPECT_EQ(reading.hand_pos_h_m.z(), 0.01);
}

TEST_F(OmegaDeviceTest, EveryCauseOfForceOffIsNamedAndForceIsNotCommanded) {
  open();
  for (int cause = 1; cause <= 7; ++cause) {
    sdk_->force_off_cause = cause;
    const DeviceReading reading = ticks(Vec3(1, 0, 0));
    EXPECT_EQ(reading.status, DeviceStatus::kForceOff);
    EXPECT_EQ(reading.cause, cause <= 6 ? static_cast<ForceOffCause>(cause) : ForceOffCause::kUnknown);
    EXPECT_NE(std::string(force_off_text(reading.cause)), force_off_text(ForceOffCause::kNone));
    EXPECT_EQ(applied_h_n_, Vec3::Zero());
    EXPECT_EQ(sdk_.force_n(), 0);
  }
  sdk_->force_off_cause = 0;
  EXPECT_EQ(ticks().status, DeviceStatus::kOk) << "a button pressed at the device brings it back";
}

TEST_F(OmegaDeviceTest, UncalibratedIsHomingWithoutForceUntilItIs) {
  sdk_->calibrated = 0;
  open();
  EXPECT_EQ(ticks(Vec3(1, 0, 0)).status, DeviceStatus::kHoming);
  EXPECT_EQ(sdk_.force_n(), 0);
  sdk_->calibrated = 1;
  EXPECT_EQ(ticks().status, DeviceStatus::kOk);
}

TEST_F(OmegaDeviceTest, FailuresStayAndTheForceGoesToZero) {
  struct Case {
    const char* what;
    void (*script)(support::StandinState&);
    ForceOffCause cause;
  };
  const Case cases[] = {
      {"position", [](auto& s) { s.result_of(DrdCall::kGetPosition) = -1; }, ForceOffCause::kUnplugged},
      {"status", [](auto& s) { s.result_of(DrdCall::kGetStatus) = -1; }, ForceOffCause::kUnplugged},
      {"power", [](auto& s) { s.power = 0; }, ForceOffCause::kNoPower},
      {"error", [](auto& s) { s.error = 1; }, ForceOffCause::kDeviceError},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    StandinSdk fresh;
    open();
    tick(Vec3(2, 0, 0));
    EXPECT_EQ(fresh.force_n(), 2);
    one.script(*fresh);
    const DeviceReading reading = ticks(Vec3(2, 0, 0));
    EXPECT_EQ(reading.status, DeviceStatus::kFailed);
    EXPECT_EQ(reading.cause, one.cause);
    EXPECT_EQ(fresh.force_n(), 0);
    EXPECT_EQ(applied_h_n_, Vec3::Zero());
    new (&*fresh) support::StandinState;  // all is well again: a person must look all the same
    fresh->open = 1;
    EXPECT_EQ(ticks(Vec3(2, 0, 0)).status, DeviceStatus::kFailed);
    device_.reset();
  }
}

TEST_F(OmegaDeviceTest, ForceRefusedIsCountedAsTheOneThatStillActs) {
  open();
  tick(Vec3(2, 0, 0));
  sdk_->result_of(DrdCall::kSetForce) = -1;
  tick(Vec3(-1, 0, 0));
  EXPECT_EQ(applied_h_n_, Vec3(2, 0, 0));
  sdk_->result_of(DrdCall::kSetForce) = 0;
  EXPECT_EQ(tick(Vec3(3, 0, 0)).status, DeviceStatus::kFailed);
  EXPECT_EQ(applied_h_n_, Vec3::Zero());
  EXPECT_EQ(sdk_.force_n(), 0);
}

TEST_F(OmegaDeviceTest, UnpluggedFailsAndItsButtonsAreNotBelieved) {
  open();
  sdk_->buttons = 1;
  EXPECT_EQ(tick().buttons, kButtonDeadman);
  sdk_->unplugged = 1;  // the mask comes back as -1: every button
  const DeviceReading reading = tick();
  EXPECT_EQ(reading.status, DeviceStatus::kFailed);
  EXPECT_EQ(reading.cause, ForceOffCause::kUnplugged);
  EXPECT_EQ(reading.buttons, 0u);
}

TEST_F(OmegaDeviceTest, WhatIsNotFiniteIsNeverSentAndAlwaysSeen) {
  open();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  tick(Vec3(nan, 0, 0));
  EXPECT_EQ(applied_h_n_, Vec3::Zero());
  EXPECT_EQ(sdk_.force_n(), 0);
  sdk_->pos_d_m[1] = nan;
  EXPECT_FALSE(is_finite(tick().hand_pos_h_m)) << "the station must see it, and stop";
}

TEST_F(OmegaDeviceTest, ButtonsMapAsConfigured) {
  OmegaConfig config;
  config.buttons.clutch = 1u << 1;
  config.buttons.stop = 1u << 2 | 1u << 3;
  open(config);
  sdk_->buttons = 0b0011;
  EXPECT_EQ(tick().buttons, kButtonDeadman | kButtonClutch);
  sdk_->buttons = 0b1000;
  EXPECT_EQ(tick().buttons, kButtonStop);
}

TEST_F(OmegaDeviceTest, InfoIsOfTheDevice) {
  EXPECT_EQ(open().info().force_max_n, 12);  // -1, no limit set: what the maker publishes
  EXPECT_TRUE(device_->info().has_force);
  EXPECT_TRUE(device_->info().moves_by_itself);
  device_.reset();
  sdk_->force_max_n = 8;
  EXPECT_EQ(open().info().force_max_n, 8);
}

TEST_F(OmegaDeviceTest, AStuckCallIsSeenFromOutsideAndTheWatchdogTakesTheForce) {
  open();
  tick(Vec3(2, 0, 0));
  sdk_->stall_of(DrdCall::kGetPosition) = 150'000;
  std::thread loop([&] { tick(Vec3(2, 0, 0)); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  const CallWatch::Look look = device_->calls().look();
  EXPECT_TRUE(look.inside());
  EXPECT_STREQ(look.name, "dhdGetPosition");
  EXPECT_EQ(sdk_.force_n(), 0);
  EXPECT_NE(sdk_->watchdog_fired_ns, 0);
  loop.join();
  EXPECT_FALSE(device_->calls().look().inside());
  device_->advance(150'000'000);  // told by the loop: the state is looked at before a force is shown
  const DeviceReading reading = tick(Vec3(2, 0, 0));
  EXPECT_EQ(reading.status, DeviceStatus::kForceOff);
  EXPECT_EQ(reading.cause, ForceOffCause::kWatchdog);
  EXPECT_EQ(sdk_.force_n(), 0);
}

TEST_F(OmegaDeviceTest, TicksDoNotAllocate) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  open();
  const support::AllocGuard guard;
  for (int k = 0; k < 1000; ++k) {
    if (k == 300) sdk_->saturation_n = 1;
    if (k == 600) sdk_->force_off_cause = 1;
    if (k == 800) sdk_->unplugged = 1;
    tick(Vec3(2, 0, 0));
  }
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST(AxisMapTest, RightHandedMapsGoThereAndBackMirrorsAreRefused) {
  int good = 0;
  const std::array<std::string, 6> all{"+x", "-x", "+y", "-y", "+z", "-z"};
  for (const auto& a : all) {
    for (const auto& b : all) {
      for (const auto& c : all) {
        try {
          const AxisMap map = AxisMap::parse({a, b, c}, "test");
          ++good;
          const Vec3 v(1, -2, 3);
          EXPECT_EQ(map.to_device(map.to_hand(v)), v);
          Mat3 matrix;
          for (int i = 0; i < 3; ++i) matrix.col(i) = map.to_hand(Vec3::Unit(i));
          EXPECT_EQ(matrix.determinant(), 1);
          EXPECT_EQ(map.names(), (std::array<std::string, 3>{a, b, c}));
        } catch (const std::exception&) {
        }
      }
    }
  }
  EXPECT_EQ(good, 24);  // the rotations of a cube
}

}  // namespace
}  // namespace telenano::device
