// Marks of a recording at a moving moment; and what a recording that makes no sense does to them.
#include "telenano/master/view_model/marked_ground.h"

#include <gtest/gtest.h>

#include <limits>

#include "telenano/common/base/random.h"

namespace telenano::view_model {
namespace {

using recording::MarkRow;

std::vector<MarkRow> place(double time_s, double columns, double rows, double flat_nm) {
  const double values[] = {columns, rows, 2, 3, -10, -20, flat_nm};
  std::vector<MarkRow> all;
  for (std::uint32_t i = 0; i < 7; ++i) all.push_back({time_s, MarkRow::kPlace, i, values[i]});
  return all;
}

std::vector<MarkRow> operator+(std::vector<MarkRow> a, const std::vector<MarkRow>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(MarkedGround, OnAPlaneTheyComeAndGoWithTheMoment) {
  MarkedGround ground({},
                      place(1, 4, 3, 5) + std::vector<MarkRow>{{1, 2, 1, 4.5}, {2, 3, 2, 4}, {2, 2, 1, 3}});
  EXPECT_TRUE(ground.has_marks());
  EXPECT_FALSE(ground.move_to(0.5));
  EXPECT_EQ(ground.heights(), nullptr);
  EXPECT_TRUE(ground.move_to(1));
  ASSERT_NE(ground.heights(), nullptr);
  EXPECT_EQ(ground.heights()->columns, 4);
  EXPECT_EQ(ground.heights()->rows, 3);
  EXPECT_EQ(ground.heights()->dx_nm, 2);
  EXPECT_EQ(ground.heights()->dy_nm, 3);
  EXPECT_EQ(ground.heights()->x_first_nm, -10);
  EXPECT_EQ(ground.heights()->y_first_nm, -20);
  EXPECT_EQ(ground.heights()->z_nm, (std::vector<double>{5, 5, 5, 5, 5, 5, 4.5, 5, 5, 5, 5, 5}));
  EXPECT_FALSE(ground.move_to(1.9));
  EXPECT_TRUE(ground.move_to(9));
  EXPECT_EQ(ground.heights()->z_nm, (std::vector<double>{5, 5, 5, 5, 5, 5, 3, 5, 5, 5, 5, 4}));
  EXPECT_FALSE(ground.move_to(10));
  EXPECT_TRUE(ground.move_to(1.5)) << "back";
  EXPECT_EQ(ground.heights()->z_nm[6], 4.5);
  EXPECT_EQ(ground.heights()->z_nm[11], 5);
  EXPECT_TRUE(ground.move_to(0));
  EXPECT_EQ(ground.heights(), nullptr);
}

TEST(MarkedGround, OnAScanTheOtherNodesAreTheScenes) {
  const surface::HeightGrid scene{2, 2, 2, 3, -10, -20, {1, 2, 3, 4}};
  MarkedGround same(scene, place(1, 2, 2, 9) + std::vector<MarkRow>{{1, 1, 0, 0.5}});
  same.move_to(1);
  EXPECT_EQ(same.heights()->z_nm, (std::vector<double>{1, 0.5, 3, 4}));
  MarkedGround other(scene, place(1, 3, 2, 9) + std::vector<MarkRow>{{1, 1, 0, 0.5}});
  other.move_to(1);
  EXPECT_EQ(other.heights()->z_nm, (std::vector<double>{9, 0.5, 9, 9, 9, 9})) << "no scene of that size";
}

TEST(MarkedGround, AnotherPlaceBeginsAnew) {
  MarkedGround ground({}, place(1, 2, 2, 0) + std::vector<MarkRow>{{1, 1, 1, 7}} + place(2, 2, 3, 1));
  ground.move_to(1);
  EXPECT_EQ(ground.heights()->z_nm.back(), 7);
  ground.move_to(2);
  EXPECT_EQ(ground.heights()->z_nm, std::vector<double>(6, 1.0));
}

TEST(MarkedGround, NothingBeforeAPlaceAndNothingBesideIt) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  MarkedGround ground(
      {}, std::vector<MarkRow>{{0, 0, 0, 7}} + place(1, 2, 2, 0) +
              std::vector<MarkRow>{{1, 2, 0, 7}, {1, 0, 2, 7}, {1, 0, 0, kNan}, {1, 1u << 31, 0, 7}});
  ground.move_to(0);
  EXPECT_EQ(ground.heights(), nullptr);
  ground.move_to(5);
  EXPECT_EQ(ground.heights()->z_nm, std::vector<double>(4, 0.0));
  for (const double bad : {0.0, 1.0, -5.0, 1e9, kNan, 1e300}) {
    MarkedGround none({}, place(1, bad, 100, 0) + std::vector<MarkRow>{{1, 0, 0, 7}});
    none.move_to(5);
    EXPECT_EQ(none.heights(), nullptr) << bad;
  }
}

TEST(MarkedGround, RandomRowsDoNoHarm) {
  Random random(1);
  for (int run = 0; run < 300; ++run) {
    std::vector<MarkRow> rows;
    for (int i = 0; i < 60; ++i) {
      const bool is_place = random.uniform() < 0.6;
      rows.push_back({0.1 * i, is_place ? MarkRow::kPlace : static_cast<std::uint32_t>(random.bits() % 6),
                      static_cast<std::uint32_t>(is_place ? i % 7 : random.bits() % 6),
                      random.uniform() < 0.1 ? -1e308 : 6 * random.uniform()});
    }
    MarkedGround ground({}, rows);
    for (int i = 0; i < 20; ++i) {
      ground.move_to(6 * random.uniform());
      if (ground.heights() == nullptr) continue;
      ASSERT_EQ(ground.heights()->z_nm.size(),
                static_cast<std::size_t>(ground.heights()->columns * ground.heights()->rows));
    }
  }
}

}  // namespace
}  // namespace telenano::view_model
