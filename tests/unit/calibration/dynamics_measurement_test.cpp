#include "telenano/master/calibration/dynamics_measurement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/error.h"
#include "tests/support/alloc_guard.h"
#include "tests/unit/calibration/measured_plant.h"

namespace telenano::calibration {
namespace {

using device::DeviceReading;
using device::DeviceStatus;

TEST(DynamicsMeasurement, MeasuresEachAxisInItsTurn) {
  const DynamicsMeasurement measurement = measure(free_device(0.25, 2, 0.02, 1e-5), 0, 12);
  EXPECT_EQ(measurement.end(), MeasurementEnd::kDone);
  EXPECT_EQ(measurement.done(), 1);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(static_cast<double>(measurement.track(axis).size()), 12e3, 2);
    EXPECT_EQ(identify_axis(measurement.track(axis)).verdict, DynamicsVerdict::kGood);
  }
}

// What a person's fingers meet: never more than was said, nowhere far, not fast, also without any damping.
TEST(DynamicsMeasurement, StaysSmall) {
  for (const double damping_n_s_m : {0.0, 2.0}) {
    for (const double mass_kg : {0.05, 0.25, 2.0}) {
      double most_n = 0;
      double furthest_m = 0;
      device::Plant plant(free_device(mass_kg, damping_n_s_m, 0, 1e-5));
      DynamicsMeasurement measurement({});
      DeviceReading reading;
      for (double time_s = 0; measurement.end() == MeasurementEnd::kRunning; time_s += 1e-3) {
        reading.hand_pos_h_m = plant.encoder_pos_m();
        const Vec3 force_n = measurement.force(CallTime::at(time_s), reading);
        measurement.applied(CallTime::at(time_s), force_n);
        plant.advance(force_n, Vec3::Zero());
        most_n = std::max(most_n, force_n.cwiseAbs().maxCoeff());
        furthest_m = std::max(furthest_m, plant.pos_m().cwiseAbs().maxCoeff());
        EXPECT_TRUE(time_s >= 0.5 || force_n.isZero(0));
      }
      EXPECT_EQ(measurement.end(), MeasurementEnd::kDone);
      EXPECT_LE(most_n, MeasurementConfig{}.force_max_n);
      EXPECT_LT(furthest_m, 0.03);
    }
  }
}

TEST(DynamicsMeasurement, AForceNeverSteps) {
  device::Plant plant(free_device(0.25, 2, 0.02, 1e-5));
  DynamicsMeasurement measurement({});
  DeviceReading reading;
  Vec3 last_n = Vec3::Zero();
  double most_n = 0;
  for (double time_s = 0; measurement.end() == MeasurementEnd::kRunning; time_s += 1e-3) {
    reading.hand_pos_h_m = plant.encoder_pos_m();
    const Vec3 force_n = measurement.force(CallTime::at(time_s), reading);
    plant.advance(force_n, Vec3::Zero());
    if (measurement.end() == MeasurementEnd::kRunning) most_n = std::max(most_n, (force_n - last_n).norm());
    last_n = force_n;
  }
  // 0.2 N at 7.9 Hz change by 10 mN in a millisecond, all seven by 30; an encoder step in the velocity by 5.
  EXPECT_LT(most_n, 0.06);
}

TEST(DynamicsMeasurement, EndsWithZeroForceForGood) {
  struct Case {
    const char* name;
    void (*act)(double time_s, DeviceReading& reading, Vec3& hand_m);
    MeasurementEnd end;
  };
  const Case cases[] = {
      {"force off",
       [](double t, DeviceReading& r, Vec3&) {
         if (t > 5) r.status = DeviceStatus::kForceOff;
       },
       MeasurementEnd::kDevice},
      {"failed",
       [](double t, DeviceReading& r, Vec3&) {
         if (t > 0.2) r.status = DeviceStatus::kFailed;
       },
       MeasurementEnd::kDevice},
      {"homing", [](double, DeviceReading& r, Vec3&) { r.status = DeviceStatus::kHoming; },
       MeasurementEnd::kDevice},
      {"moved from the start", [](double t, DeviceReading&, Vec3& hand) { hand.x() = 0.004 + 0.05 * t; },
       MeasurementEnd::kMoves},
      {"pulled away",
       [](double t, DeviceReading&, Vec3& hand) {
         if (t > 3) hand.z() = 0.001 + 0.1 * (t - 3);
       },
       MeasurementEnd::kTooFar},
      {"struck",
       [](double t, DeviceReading&, Vec3& hand) {
         if (t > 3) hand.y() = 0.03;
       },
       MeasurementEnd::kTooFast},
  };
  for (const Case& each : cases) {
    SCOPED_TRACE(each.name);
    device::PlantConfig plant = free_device(0.25, 2, 0.02, 1e-5);
    plant.grip_stiffness_n_m = 3000;  // whoever strikes it holds it
    plant.grip_damping_n_s_m = 5;
    plant.arm_stiffness_n_m = 3000;
    DynamicsMeasurement measurement = measure(plant, 0, 10, each.act);
    EXPECT_EQ(measurement.end(), each.end) << end_text(measurement.end());
    EXPECT_GT(std::string(end_text(measurement.end())).size(), 5u);
    DeviceReading well;
    EXPECT_EQ(measurement.force(CallTime::at(1e3), well).norm(), 0);
  }
}

TEST(DynamicsMeasurement, APositionThatIsNoNumberEndsIt) {
  DynamicsMeasurement measurement({});
  DeviceReading reading;
  for (double time_s = 0; time_s < 3; time_s += 1e-3) {
    if (time_s > 2) reading.hand_pos_h_m.y() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_TRUE(is_finite(measurement.force(CallTime::at(time_s), reading)));
  }
  EXPECT_EQ(measurement.end(), MeasurementEnd::kTooFar);
}

TEST(DynamicsMeasurement, TakesNothingFromTheHeap) {
  DynamicsMeasurement measurement({});
  DeviceReading reading;
  const support::AllocGuard guard;
  for (int i = 0; i < 70'000; ++i) {
    measurement.applied(CallTime::at(1e-3 * i), measurement.force(CallTime::at(1e-3 * i), reading));
  }
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_EQ(measurement.end(), MeasurementEnd::kDone);
}

TEST(DynamicsMeasurement, StopsWhenAsked) {
  DynamicsMeasurement measurement({});
  DeviceReading reading;
  measurement.force(CallTime::at(0), reading);
  measurement.stop();
  EXPECT_EQ(measurement.end(), MeasurementEnd::kStopped);
  EXPECT_EQ(measurement.force(CallTime::at(1), reading).norm(), 0);
}

TEST(DynamicsMeasurement, RefusesSettingsOutOfRange) {
  for (const MeasurementConfig& config :
       {MeasurementConfig{.rate_hz = 100}, MeasurementConfig{.seconds_per_axis = 1},
        MeasurementConfig{.seconds_per_axis = std::nan("")}, MeasurementConfig{.force_max_n = 12}})
    EXPECT_THROW(DynamicsMeasurement{config}, UserError);
}

}  // namespace
}  // namespace telenano::calibration
