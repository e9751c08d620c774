// Fields that are made tile by tile. Oracle: the same made at once, to the last bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <random>
#include <span>
#include <thread>
#include <vector>

#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "tests/support/sampled_ground.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;
constexpr double kLayer_nm = 0.41;

SofteningRule rule() {
  return softening_rule(kRadius, 0.4, 52.5, 0.165);
}

/// Rough, with a few cliffs, so that coarse levels must be held up; some tiles along either side.
HeightGrid rough(int columns, int rows, unsigned seed) {
  std::mt19937 random(seed);
  HeightGrid grid{columns, rows, 1.6, 1.7, -3.0, 5.0, {}};
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const double cliff = (i / 23 + j / 31) % 2 == 0 ? 14.0 : 0.0;
      grid.z_nm.push_back(cliff + static_cast<double>(random() % 10000) * 3e-4);
    }
  }
  return grid;
}

/// Any law that attracts.
std::shared_ptr<const RetractionKernel> some_law() {
  return std::make_shared<RetractionKernel>(
      [](double gap, double) { return gap < 0.1 ? -1 - 3 * (gap - 0.1) : -std::exp(-(gap - 0.1) / 0.1); },
      kRadius);
}

ScanFields tiled(const HeightGrid& grid, const std::shared_ptr<const RetractionKernel>& pull_off = {}) {
  return ScanFields::by_tiles(grid, std::make_shared<const BicubicSpline>(BicubicSpline::interpolating(grid)),
                              kRadius, rule(), {kLayer_nm}, pull_off);
}

bool same(const ContactJet& a, const ContactJet& b) {
  return std::memcmp(&a.overlap_nm, &b.overlap_nm, sizeof a.overlap_nm) == 0 &&
         a.log_radius == b.log_radius && a.overlap_grad == b.overlap_grad &&
         a.overlap_hess_per_nm == b.overlap_hess_per_nm &&
         a.log_radius_grad_per_nm == b.log_radius_grad_per_nm &&
         a.log_radius_hess_per_nm2 == b.log_radius_hess_per_nm2;
}

/// Apexes in and about the scan, near touch and far.
Vec3 somewhere(const HeightGrid& grid, std::mt19937& random) {
  const auto between = [&](double a, double b) {
    return a + (b - a) * 1e-6 * static_cast<double>(random() % 1000001);
  };
  const double width = grid.columns * grid.dx_nm, length = grid.rows * grid.dy_nm;
  return {grid.x_first_nm + between(-0.2, 1.2) * width, grid.y_first_nm + between(-0.2, 1.2) * length,
          between(-5, 40)};
}

void expect_same_coefficients(const ScanFields& a, const ScanFields& b) {
  const auto all = a.coefficients(), others = b.coefficients();
  ASSERT_EQ(all.size(), others.size());
  for (std::size_t g = 0; g < all.size(); ++g) {
    ASSERT_EQ(all[g].size(), others[g].size());
    std::size_t different = 0;
    for (std::size_t k = 0; k < all[g].size(); ++k)
      different += std::bit_cast<std::uint64_t>(all[g][k]) != std::bit_cast<std::uint64_t>(others[g][k]);
    EXPECT_EQ(different, 0u) << "of " << all[g].size() << " in grid " << g;
  }
}

// 150 × 117 samples: more than one tile of 64 nodes of the dilation, and rims that end within a tile.
TEST(ScanTiles, AreTheSameBitsInWhateverOrder) {
  for (const auto& [columns, rows] : {std::pair{150, 117}, std::pair{97, 40}, std::pair{18, 130}}) {
    const HeightGrid grid = rough(columns, rows, 3);
    const auto pull_off = some_law();
    const ScanFields whole(grid, kRadius, rule(), {kLayer_nm}, {}, pull_off);
    const ScanFields tiles = tiled(grid, pull_off);
    EXPECT_EQ(tiles.bytes(), 0u);
    EXPECT_NE(whole.hash(), ScanFields(grid, kRadius, rule(), {kLayer_nm}).hash());
    std::mt19937 random(static_cast<unsigned>(columns));
    int different = 0;
    for (int n = 0; n < 400; ++n) {
      const Vec3 at = somewhere(grid, random);
      ContactJet a, b;
      if (n % 5 == 0) {
        whole.at_softening(at, kLayer_nm, a);
        tiles.at_softening(at, kLayer_nm, b);
      } else {
        whole.contact_at(at, a);
        tiles.contact_at(at, b);
      }
      different += !same(a, b);
    }
    EXPECT_EQ(different, 0) << columns;
    expect_same_coefficients(whole, tiles);
    EXPECT_EQ(whole.hash(), tiles.hash());
    EXPECT_GE(tiles.bytes(), whole.bytes());  // in the end: all of it
  }
}

// What is not held up or clamped is no test of what reaches across a tile's rim.
TEST(ScanTiles, GroundOfTheTestIsHeldUp) {
  const HeightGrid grid = rough(150, 117, 3);
  const ScanFields whole(grid, kRadius, rule());
  SofteningRule one = rule();
  int held = 0;
  const auto coefficients = whole.coefficients();
  // Where a level is held its odd H is just at the bound below its even one.
  for (std::size_t g = 0; g < coefficients.size(); ++g) {
    const double fall = 0.53 * one.finest_nm * (1 << (2 * g));
    for (std::size_t k = 0; k < coefficients[g].size(); k += 6)
      held += std::abs(coefficients[g][k] - fall - coefficients[g][k + 3]) < 1e-12;
  }
  EXPECT_GT(held, 100);
}

TEST(ScanTiles, LevelGroundIsLevel) {
  const HeightGrid grid = support::sampled(60, 2.0, [](double, double) { return 4.0; });
  const ScanFields whole(grid, kRadius, rule(), {kLayer_nm});
  expect_same_coefficients(whole, tiled(grid));
}

// A place that is looked at makes what its stencils need, not the scan; who is ahead has made what comes.
TEST(ScanTiles, MakesWhatIsLookedAtAndWhatIsWished) {
  const HeightGrid grid = rough(400, 300, 5);
  const ScanFields tiles = tiled(grid);
  ContactJet jet;
  EXPECT_FALSE(tiles.make_wished());
  tiles.contact_at({200, 200, 200}, jet);
  tiles.contact_at({200, 200, tiles.touch_height_nm(200, 200)}, jet);
  const std::size_t looked = tiles.bytes();
  const double all = 2.7 * 800 * 600 * 48;
  EXPECT_GT(looked, 0u);
  EXPECT_LT(static_cast<double>(looked), 0.3 * all);
  while (tiles.make_wished()) {
  }
  const std::size_t ahead = tiles.bytes();
  EXPECT_GT(ahead, looked);
  // On and on, here and there coming from above: whoever moves finds all made.
  std::size_t before = ahead;
  int late = 0;
  for (double x = 200; x < 300; x += 4) {
    for (const double z : {0.0, 2.0, 20.0, 150.0}) {
      tiles.contact_at({x, 260 - 0.3 * x, z + tiles.touch_height_nm(x, 260 - 0.3 * x)}, jet);
    }
    late += tiles.bytes() != before;
    while (tiles.make_wished()) {
    }
    before = tiles.bytes();
  }
  EXPECT_EQ(late, 0);
  tiles.make_around(500, 100, 20);
  const std::size_t asked = tiles.bytes();
  EXPECT_GT(asked, ahead);
  for (double x = 481; x < 519; x += 0.5) {
    for (const double z : {10.0, 60.0, 300.0}) tiles.contact_at({x, 100, z}, jet);
  }
  EXPECT_EQ(tiles.bytes(), asked);
}

// A tip that goes on, moving sideways too, finds made what is further ahead than what is made around, though the maker comes by once in
// 60 nm. A second tip that goes its own way elsewhere does not hide where the first one goes.
TEST(ScanTiles, WhoGoesOnFindsTheWayMade) {
  struct Way {
    double x, y;  // nm a step
  };
  for (const Way way : {Way{-1, 0}, Way{0.7, 0.7}, Way{-0.3, 0.95}}) {
    for (const int tips : {1, 2}) {
      const HeightGrid grid = rough(400, 400, 5);
      const ScanFields tiles = tiled(grid);
      int late = 0;
      const auto look = [&](double x, double y, bool counts) {
        ContactJet jet;
        const std::size_t before = tiles.bytes();
        tiles.contact_at({x, y, tiles.touch_height_nm(x, y) - 1}, jet);
        late += counts && tiles.bytes() != before;
      };
      for (int k = 0; k < 250; ++k) {
        const double across = 1.5 * std::sin(0.7 * k);
        look(400 + k * way.x - across * way.y, 400 + k * way.y + across * way.x, k > 60);
        if (tips > 1) look(100, 700 - k, k > 60);
        if (k % 60 < 2)
          for (int n = 0; n < 8 * tips; ++n) tiles.make_wished();
      }
      EXPECT_EQ(late, 0) << way.x << ", " << way.y << ", " << tips << " tips";
    }
  }
}

// Three threads that look and one that is ahead, on the same tiles.
TEST(ScanTiles, AreMadeByManyThreads) {
  const HeightGrid grid = rough(150, 117, 7);
  const ScanFields whole(grid, kRadius, rule(), {kLayer_nm});
  const ScanFields tiles = tiled(grid);
  std::atomic<int> different{0};
  std::atomic<bool> done{false};
  std::thread ahead([&] {
    while (!done.load()) {
      if (!tiles.make_wished()) std::this_thread::yield();
    }
  });
  std::vector<std::thread> all;
  for (unsigned thread = 0; thread < 3; ++thread) {
    all.emplace_back([&, thread] {
      std::mt19937 random(thread / 2);  // two go the same way
      for (int n = 0; n < 200; ++n) {
        const Vec3 at = somewhere(grid, random);
        ContactJet a, b;
        whole.contact_at(at, a);
        tiles.contact_at(at, b);
        if (!same(a, b)) ++different;
      }
    });
  }
  for (std::thread& thread : all) thread.join();
  done = true;
  ahead.join();
  EXPECT_EQ(different.load(), 0);
  expect_same_coefficients(whole, tiles);
}

// Marks of a session on tiles: what they change is the same, whatever was made before.
TEST(ScanTiles, MarksAreTheSame) {
  const HeightGrid grid = rough(150, 117, 9);
  const ScanFields whole_ground(grid, kRadius, rule(), {kLayer_nm});
  const ScanFields tile_ground = tiled(grid);
  ScanFields whole = ScanFields::for_marks(whole_ground), tiles = ScanFields::for_marks(tile_ground);
  std::mt19937 random(11);
  for (int n = 0; n < 60; ++n) {
    const Vec3 at = somewhere(grid, random);
    FieldMark mark;
    mark.x_nm = at.x();
    mark.y_nm = at.y();
    mark.depth_nm = 0.01 * static_cast<double>(random() % 40);
    mark.radius_nm = 1.0 + static_cast<double>(random() % 14);
    mark.log_radius_rise = 0.02;
    mark.strain = n % 2 == 0 ? 0.05 : 0.0;
    mark.pile_up = n % 3 == 0 ? 1.0 : 0.0;
    whole.press(mark);
    tiles.press(mark);
    ASSERT_EQ(whole.marks_digest(), tiles.marks_digest()) << n;
    ContactJet a, b;
    const Vec3 near = somewhere(grid, random);
    whole.contact_at(near, a);
    tiles.contact_at(near, b);
    ASSERT_TRUE(same(a, b)) << n;
  }
  EXPECT_NE(tiles.marks_digest(), 0u);
  // Carried over to a session on tiles of which none is made.
  const ScanFields fresh_ground = tiled(grid);
  ScanFields fresh = ScanFields::for_marks(fresh_ground);
  int carried = 0;
  tiles.each_pressed([&](const ScanFields::Pressed& pressed) {
    EXPECT_TRUE(fresh.set_pressed(pressed));
    ++carried;
  });
  EXPECT_GT(carried, 1000);
  EXPECT_EQ(fresh.marks_digest(), tiles.marks_digest());
  tiles.unmark();
  EXPECT_EQ(tiles.marks_digest(), 0u);
}

// The digest of marks goes with each change and must be one of what there is alone. Two coefficients that change
// places, one bit of one value, a value in the other level: each is told apart; as it was: 0.
TEST(ScanTiles, DigestOfMarksIsOfPlacesAndValues) {
  const HeightGrid grid = rough(30, 30, 13);
  const ScanFields ground(grid, kRadius, rule(), {kLayer_nm});
  ScanFields fields = ScanFields::for_marks(ground);
  const std::span<const double> made = ground.coefficients()[0];
  const auto pressed = [&](std::uint32_t number, int value, double change) {
    const double* const at = &made[6 * number];
    ScanFields::Pressed one{0, number, {at[0], at[1], at[3], at[4]}};
    if (value >= 0) one.value[value] += change;
    return one;
  };
  std::vector<std::uint64_t> digests = {0};
  const auto look = [&](std::initializer_list<ScanFields::Pressed> all) {
    for (const ScanFields::Pressed& one : all) ASSERT_TRUE(fields.set_pressed(one));
    digests.push_back(fields.marks_digest());
    fields.unmark();
    EXPECT_EQ(fields.marks_digest(), 0u);
  };
  for (int value = 0; value < 4; ++value) {
    look({pressed(100, value, -0.5)});
    look({pressed(100, value, -0.5 + 1e-12)});
    look({pressed(101, value, -0.5)});
    look({pressed(100, value, -0.5), pressed(101, value, -0.5)});
  }
  const ScanFields::Pressed a{0, 100, {1, 2, 3, 4}}, b{0, 101, {1.5, 2, 3, 4}};
  look({a, b});
  look({{0, 101, {1, 2, 3, 4}}, {0, 100, {1.5, 2, 3, 4}}});
  look({{0, 100, {2, 1, 3, 4}}, b});
  look({{0, 100, {1, 2, 4, 3}}, b});
  look({{0, 100, {3, 4, 1, 2}}, b});
  std::sort(digests.begin(), digests.end());
  EXPECT_EQ(std::adjacent_find(digests.begin(), digests.end()), digests.end());
  // There and back in whatever order.
  EXPECT_TRUE(fields.set_pressed(pressed(100, 0, -1)) && fields.set_pressed(pressed(7, 2, 3)) &&
              fields.set_pressed(pressed(100, -1, 0)));
  const std::uint64_t seven = fields.marks_digest();
  fields.unmark();
  EXPECT_TRUE(fields.set_pressed(pressed(7, 2, 3)));
  EXPECT_EQ(fields.marks_digest(), seven);
}

// The bound that a large scan gives for its ρ holds where all of it is made: a pit of the tip's own radius.
TEST(ScanTiles, NoRadiusIsBeyondTheMost) {
  const HeightGrid pit = support::sampled(60, 1.0, [](double x, double y) {
    const double r2 = (x - 30) * (x - 30) + (y - 30) * (y - 30);
    return r2 < 300 ? 20.0 - std::sqrt(400.0 - r2) : 20.0 - std::sqrt(100.0);
  });
  const ScanFields whole(pit, kRadius, rule());
  EXPECT_LE(whole.largest_log_radius(), std::log(ScanFields::kMostRadii * kRadius) * (1 + 1e-15));
  EXPECT_GT(whole.largest_log_radius(), std::log(8 * kRadius));
  EXPECT_GE(tiled(pit).largest_log_radius(), whole.largest_log_radius());
}

}  // namespace
}  // namespace telenano::physics
