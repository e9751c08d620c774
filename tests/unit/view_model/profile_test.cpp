#include "telenano/master/view_model/profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

namespace telenano::view_model {
namespace {

/// Heights 0.05 x + 0.02 y: exact in every spline.
Ground slope() {
  surface::HeightGrid grid;
  grid.columns = grid.rows = 101;
  grid.dx_nm = grid.dy_nm = 2;
  for (int row = 0; row < 101; ++row)
    for (int column = 0; column < 101; ++column) grid.z_nm.push_back(0.1 * column + 0.04 * row);
  return Ground(std::move(grid));
}

TEST(Profile, MeasuresDistanceAndHeight) {
  const Profile profile = profile_of(slope(), Vec3(40, 60, 99), Vec3(70, 100, -7));
  EXPECT_NEAR(profile.level_nm(), 50, 1e-9);
  EXPECT_NEAR(profile.rise_nm(), 0.05 * 30 + 0.02 * 40, 1e-9);
  EXPECT_NEAR(profile.straight_nm(), std::hypot(50, 2.3), 1e-9);
  EXPECT_NEAR(profile.lowest_w_nm, 0.05 * 40 + 0.02 * 60, 1e-9);
  EXPECT_NEAR(profile.highest_w_nm, 0.05 * 70 + 0.02 * 100, 1e-9);
  EXPECT_EQ(profile.points.size(), 51u) << "two a pixel";
  for (const auto& point : profile.points)
    EXPECT_NEAR(point.pos_w_nm.z(), 0.05 * point.pos_w_nm.x() + 0.02 * point.pos_w_nm.y(), 1e-9);
}

TEST(Profile, APointIsAProfileToo) {
  const Profile profile = profile_of(slope(), Vec3(40, 60, 0), Vec3(40, 60, 0));
  EXPECT_EQ(profile.points.size(), 2u);
  EXPECT_EQ(profile.level_nm(), 0);
  EXPECT_EQ(profile_of(slope(), Vec3(-1e6, 0, 0), Vec3(1e6, 0, 0)).points.size(), 2000u);
}

TEST(Profile, TheTableSaysWhatWasMeasured) {
  const std::string csv = profile_csv(profile_of(slope(), Vec3(40, 60, 0), Vec3(70, 100, 0)));
  EXPECT_NE(csv.find("# distance: 50 nm level, 50.0529 nm straight\n# height difference: 2.3 nm\n"),
            std::string::npos)
      << csv;
  std::istringstream lines(csv);
  int rows = 0;
  for (std::string line; std::getline(lines, line);) rows += line[0] != '#' ? 1 : 0;
  EXPECT_EQ(rows, 52);
  EXPECT_NE(csv.find("along_nm,x_nm,y_nm,z_nm\n0,40,60,3.2\n1,40.6,60.8,"), std::string::npos) << csv;
}

// There and back again: what projection puts at a pixel is seen there.
TEST(Profile, TheGroundIsSeenWhereItIsDrawn) {
  const Ground ground = slope();
  const Vec3 origin(100, 100, 0);
  constexpr double kTaller = 5;
  for (const auto& [azimuth, elevation] : {std::pair{-62.0, 32.0}, {140.0, 60.0}, {10.0, 85.0}}) {
    Camera camera;
    camera.azimuth_deg = azimuth;
    camera.elevation_deg = elevation;
    camera.distance_nm = 500;
    camera.depth_range_nm = 600;
    const Mat4 clip = camera.clip_of_scene(1.5);
    for (const auto& [x, y] : {std::pair{100.0, 100.0}, {20.0, 150.0}, {180.0, 40.0}}) {
      const double z = 0.05 * x + 0.02 * y;
      const ScreenPoint p = project(clip, Vec3(x - 100, y - 100, kTaller * z), 900, 600);
      const auto seen = seen_at(ground, camera, origin, kTaller, p.x_px, p.y_px, 900, 600);
      ASSERT_TRUE(seen) << x << ", " << y;
      EXPECT_LT((*seen - Vec3(x, y, z)).norm(), 1e-3) << seen->transpose();
    }
    EXPECT_FALSE(seen_at(ground, camera, origin, kTaller, 5, elevation > 80 ? -4000 : 5, 900, 600));
  }
}

TEST(Measurement, FirstFromThenToThenNone) {
  const Ground ground = slope();
  Measurement measurement;
  EXPECT_FALSE(measurement.profile(ground, Vec3(0, 0, 0)));
  measurement.choose(Vec3(10, 10, 0));
  EXPECT_NEAR(measurement.profile(ground, Vec3(13, 14, 0))->level_nm(), 5, 1e-9) << "follows the tip";
  measurement.choose(Vec3(10, 40, 0));
  EXPECT_NEAR(measurement.profile(ground, Vec3(13, 14, 0))->level_nm(), 30, 1e-9) << "and stands";
  measurement.choose(Vec3(1, 1, 0));
  EXPECT_FALSE(measurement.any());
  measurement.choose(Vec3(10, 10, 0));
  EXPECT_FALSE(measurement.profile(ground, Vec3(std::nan(""), 0, 0)));
}

}  // namespace
}  // namespace telenano::view_model
