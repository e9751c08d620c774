#include "telenano/master/view_model/region.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>

#include "telenano/common/base/random.h"

namespace telenano::view_model {
namespace {

constexpr double kLeast_nm = 20;

/// 128 heights a side over 600 nm: two hills and a wave.
Ground sample() {
  surface::HeightGrid grid{128, 128, 600.0 / 127, 600.0 / 127, 25, -40, {}};
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const double x = column * grid.dx_nm;
      const double y = row * grid.dy_nm;
      grid.z_nm.push_back(30 * std::exp(-((x - 180) * (x - 180) + (y - 420) * (y - 420)) / 1e4) +
                          12 * std::exp(-((x - 450) * (x - 450) + (y - 150) * (y - 150)) / 4e3) +
                          std::sin(x / 25) * std::cos(y / 40));
    }
  }
  return Ground(std::move(grid));
}
Vec3 middle_of(const Ground& ground) {
  return 0.5 * (ground.min_w_nm() + ground.max_w_nm());
}
void expect_inside(const Ground& ground, const MapBox& box) {
  constexpr double kRounding_nm = 1e-9;
  EXPECT_GE(box.x_min_nm, ground.min_w_nm().x() - kRounding_nm);
  EXPECT_LE(box.x_max_nm, ground.max_w_nm().x() + kRounding_nm);
  EXPECT_GE(box.y_min_nm, ground.min_w_nm().y() - kRounding_nm);
  EXPECT_LE(box.y_max_nm, ground.max_w_nm().y() + kRounding_nm);
}

TEST(Region, IsAQuarterAsWideEachTimeAndAtLastTheWhole) {
  const Ground ground = sample();
  Region region;
  EXPECT_FALSE(region.box());
  ASSERT_TRUE(region.narrow(ground, middle_of(ground), kLeast_nm));
  EXPECT_NEAR(region.box()->width_nm(), ground.width_nm() / 4, 1e-9);
  EXPECT_NEAR(region.box()->depth_nm(), ground.depth_nm() / 4, 1e-9);
  EXPECT_TRUE(region.box()->contains(middle_of(ground)));
  // A sixteenth of 128 pixels is too few.
  EXPECT_FALSE(region.narrow(ground, middle_of(ground), 1e3));
  EXPECT_FALSE(region.box());
  EXPECT_FALSE(region.narrow(ground, Vec3(std::nan(""), 0, 0), kLeast_nm));
}

TEST(Region, StaysOnTheSampleWhereverItIsPut) {
  const Ground ground = sample();
  Region region;
  Random random(5);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 far(3e3 * (random.uniform() - 0.5), 3e3 * (random.uniform() - 0.5), 0);
    region.whole();
    ASSERT_TRUE(region.narrow(ground, far, kLeast_nm));
    expect_inside(ground, *region.box());
    region.move_to(ground, -far);
    expect_inside(ground, *region.box());
    EXPECT_NEAR(region.box()->width_nm(), ground.width_nm() / 4, 1e-9);
  }
}

TEST(Region, GoesWithATipThatLeavesIt) {
  const Ground ground = sample();
  Region region;
  EXPECT_FALSE(region.follow(ground, middle_of(ground)));
  ASSERT_TRUE(region.narrow(ground, middle_of(ground), kLeast_nm));
  Vec3 tip = middle_of(ground);
  int moves = 0;
  for (int i = 0; i < 2000; ++i) {
    tip.x() += 0.1;
    moves += region.follow(ground, tip) ? 1 : 0;
    ASSERT_TRUE(region.box()->contains(tip) || tip.x() > ground.max_w_nm().x());
  }
  // By half of its width each time: 200 nm in steps of 75.
  EXPECT_GE(moves, 2);
  EXPECT_LE(moves, 4);
  EXPECT_FALSE(region.follow(ground, Vec3(std::nan(""), std::nan(""), 0)));
}

TEST(Region, AMovedOneWaitsForTheTip) {
  const Ground ground = sample();
  Region region;
  ASSERT_TRUE(region.narrow(ground, middle_of(ground), kLeast_nm));
  const Vec3 corner = ground.min_w_nm();
  region.move_to(ground, corner);
  const MapBox there = *region.box();
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(region.follow(ground, middle_of(ground)));
  EXPECT_EQ(region.box()->x_min_nm, there.x_min_nm);
  // Once the tip has come, it is followed again.
  EXPECT_FALSE(region.follow(ground, corner + Vec3(10, 10, 0)));
  EXPECT_TRUE(region.follow(ground, middle_of(ground)));
}

// A tip beside the sample does not make the region jump each frame.
TEST(Region, WaitsAtTheBorder) {
  const Ground ground = sample();
  Region region;
  const Vec3 beside = ground.max_w_nm() + Vec3(50, 0, 0);
  ASSERT_TRUE(region.narrow(ground, beside, kLeast_nm));
  int moves = 0;
  for (int i = 0; i < 100; ++i) moves += region.follow(ground, beside) ? 1 : 0;
  EXPECT_LE(moves, 1);
}

TEST(GroundPart, HasTheSameHeightsAndItsOwnRelief) {
  const Ground whole = sample();
  const Vec3 low = whole.min_w_nm();
  const MapBox box{low.x() + 101, low.x() + 231, low.y() + 57, low.y() + 187};
  const Ground part = whole.part(box);
  EXPECT_EQ(part.width_nm(), box.width_nm());
  EXPECT_EQ(part.min_w_nm().y(), box.y_min_nm);
  Random random(7);
  double lowest = std::numeric_limits<double>::max();
  double highest = -lowest;
  for (int i = 0; i < 20'000; ++i) {
    const double x = box.x_min_nm + box.width_nm() * random.uniform();
    const double y = box.y_min_nm + box.depth_nm() * random.uniform();
    const double z = whole.height_w_nm(x, y);
    EXPECT_EQ(part.height_w_nm(x, y), z);
    lowest = std::min(lowest, z);
    highest = std::max(highest, z);
  }
  // At random places against those of its texture.
  EXPECT_NEAR(part.min_w_nm().z(), lowest, 0.01 * whole.relief_nm());
  EXPECT_NEAR(part.max_w_nm().z(), highest, 0.01 * whole.relief_nm());
  EXPECT_LT(part.relief_nm(), whole.relief_nm());
  // Twice as fine as the scan, at least 64.
  EXPECT_GE((part.texture_side() - 1) * whole.pixel_nm() / box.width_nm(), 2);
  EXPECT_EQ(part.height_texture(65).size(), 3u * 65 * 65);
}

TEST(GroundPart, OfAPlaneIsAPlane) {
  const Ground plane(3, Vec3(0, 0, -60), Vec3(600, 600, 100));
  const Ground part = plane.part({100, 200, 100, 200});
  EXPECT_FALSE(part.is_scan());
  EXPECT_EQ(part.width_nm(), 100);
  EXPECT_EQ(part.height_w_nm(150, 150), 3);
  EXPECT_EQ(part.relief_nm(), 0);
}

}  // namespace
}  // namespace telenano::view_model
