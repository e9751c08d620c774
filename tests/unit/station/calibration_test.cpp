#include "telenano/master/app/devices/calibration.h"

#include <gmock/gmock.h>

#include "telenano/master/app/station_file.h"

namespace telenano::app {
namespace {

using ::testing::HasSubstr;

TEST(Calibration, APushIsItsAxisWithItsSign) {
  EXPECT_EQ(judge_push(Vec3(0.03, 0.001, -0.002), 0.02).axis, "+x");
  EXPECT_EQ(judge_push(Vec3(0.01, -0.03, 0.015), 0.02).axis, "-y");
  EXPECT_EQ(judge_push(Vec3(0, 0, -0.02), 0.02).axis, "-z");
}

TEST(Calibration, WhatCannotBeToldIsSaid) {
  EXPECT_THAT(judge_push(Vec3(0.019, 0, 0), 0.02).problem, HasSubstr("only 19.0 mm"));
  EXPECT_THAT(judge_push(Vec3(0.03, 0.016, 0), 0.02).problem, HasSubstr("30 mm along x and 16 mm along y"));
  EXPECT_THAT(judge_push(Vec3(0.03, 0.0 / 0.0, 0), 0.02).problem, HasSubstr("no position"));
}

TEST(Calibration, WhatIsPrintedIsReadBack) {
  ReachedBox box;
  box.add(Vec3(-0.07, -0.05, 0));
  box.add(Vec3(0.09, 0.07, 0.1));
  box.add(Vec3(0, 0.0 / 0.0, 5));
  const auto axes = device::AxisMap::parse({"-x", "-y", "+z"}, "test");
  const StationFile file = parse_station_file(calibration_toml("omega", axes, &box), "c.toml");
  EXPECT_EQ(file.device.kind, "omega");
  EXPECT_EQ(file.device.axes->names(), axes.names());
  EXPECT_LT((*file.device.centre_m - Vec3(0.01, 0.01, 0.05)).norm(), 1e-12);
  EXPECT_NEAR(*file.device.workspace_half_m, 0.05, 1e-12);
  EXPECT_FALSE(parse_station_file(calibration_toml("hid", axes, nullptr), "c.toml").device.centre_m);
}

}  // namespace
}  // namespace telenano::app
