// Strips, round trips, the trail and what has been touched.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "telenano/common/base/random.h"
#include "telenano/master/view_model/nice_step.h"
#include "telenano/master/view_model/round_trips.h"
#include "telenano/master/view_model/strip.h"
#include "telenano/master/view_model/trail.h"

namespace telenano::view_model {
namespace {

TEST(NiceStep, IsOneTwoOrFiveAndTheLargestThatFits) {
  const std::pair<double, double> cases[] = {{1, 1},       {1.99, 1},    {2, 2},          {4.9, 2},
                                             {5, 5},       {9.99, 5},    {10, 10},        {0.2, 0.2},
                                             {0.03, 0.02}, {7000, 5000}, {0.00123, 0.001}};
  for (const auto& [value, step] : cases) EXPECT_NEAR(nice_step(value), step, 1e-12 * step) << value;
  EXPECT_EQ(nice_step(0), 1);
  EXPECT_EQ(nice_step(-3), 1);
  EXPECT_EQ(nice_step(std::numeric_limits<double>::quiet_NaN()), 1);
  EXPECT_EQ(nice_step(std::numeric_limits<double>::infinity()), 1);
}

TEST(Strip, KeepsEveryPeak) {
  Strip strip(10, 100);
  for (int tick = 0; tick < 5000; ++tick) strip.add(1e-3 * tick, tick == 3333 ? 42 : std::sin(0.01 * tick));
  double least = 0;
  double greatest = 0;
  ASSERT_TRUE(strip.range(least, greatest));
  EXPECT_EQ(greatest, 42);
  EXPECT_NEAR(least, -1, 1e-3);
  // 3.333 s lies in bin 33 of those that end with the one of 4.999 s, number 49.
  EXPECT_EQ(strip.bin(99 - (49 - 33)).greatest, 42);
}

TEST(Strip, ForgetsWhatIsOlderThanItsWindow) {
  Strip strip(1, 10);
  strip.add(0.05, 100);
  for (int i = 0; i <= 9; ++i) strip.add(0.15 + 0.1 * i, 1);
  double least = 0;
  double greatest = 0;
  ASSERT_TRUE(strip.range(least, greatest));
  EXPECT_EQ(greatest, 1);
}

TEST(Strip, AGapInTimeStaysEmptyAndALongOneEmptiesIt) {
  Strip strip(1, 10);
  strip.add(0.0, 1);
  strip.add(0.55, 2);
  EXPECT_FALSE(strip.bin(9).empty);
  EXPECT_TRUE(strip.bin(8).empty);
  EXPECT_FALSE(strip.bin(4).empty);
  strip.add(1e6, 3);
  for (std::size_t i = 0; i < 9; ++i) EXPECT_TRUE(strip.bin(i).empty);
}

TEST(Strip, LeavesOutWhatIsNoNumberOrComesLate) {
  Strip strip(1, 10);
  double least = 0;
  double greatest = 0;
  strip.add(0, std::numeric_limits<double>::quiet_NaN());
  strip.add(std::numeric_limits<double>::infinity(), 1);
  strip.add(1e300, 1);
  strip.add(0, -1e300);
  EXPECT_FALSE(strip.range(least, greatest));
  strip.add(0.95, 5);
  strip.add(0.1, 7);
  ASSERT_TRUE(strip.range(least, greatest));
  EXPECT_EQ(greatest, 5);
}

TEST(RoundTrips, CountsTheNewestAsASortedListDoes) {
  RoundTrips trips;
  Random random(7);
  std::vector<double> all;
  for (int i = 0; i < 12'000; ++i) {
    const double rtt = 50 * std::exp(2 * random.normal());
    trips.add(rtt);
    all.push_back(rtt);
  }
  all.erase(all.begin(), all.end() - static_cast<std::ptrdiff_t>(RoundTrips::kKept));
  std::sort(all.begin(), all.end());
  EXPECT_EQ(trips.count(), static_cast<int>(RoundTrips::kKept));
  for (const double part : {0.1, 0.5, 0.9, 0.99}) {
    const double exact = all[static_cast<std::size_t>(part * static_cast<double>(all.size())) - 1];
    // Kept in single precision: three digits are written.
    EXPECT_NEAR(trips.percentile_us(part), exact, 1e-7 * exact) << part;
  }
}

// The border of the bin above, which a bar may have, is no percentile: 126 ms over a link of 100.
TEST(RoundTrips, AHundredMillisecondsAreShownAsAHundred) {
  RoundTrips trips;
  for (int i = 0; i < 99; ++i) trips.add(100'000);
  EXPECT_EQ(trips.percentile_us(0.5), 100'000);
  EXPECT_EQ(trips.percentile_us(0.99), 100'000);
  trips.add(250'000);
  EXPECT_EQ(trips.percentile_us(0.99), 100'000);
  EXPECT_EQ(trips.percentile_us(1), 250'000);
}

TEST(RoundTrips, TakesWhatLiesOutside) {
  RoundTrips trips;
  trips.add(0);
  trips.add(-1);
  trips.add(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(trips.count(), 0);
  trips.add(0.001);
  trips.add(1e12);
  trips.add(std::numeric_limits<double>::infinity());
  EXPECT_EQ(trips.counts().front(), 1);
  EXPECT_EQ(trips.counts().back(), 2);
}

TEST(Trail, HasAPointForEveryStepAndForEveryChange) {
  Trail trail(100, 1);
  for (int i = 0; i <= 100; ++i) trail.add({0.1 * i, 0, 0}, i >= 55);
  // 0, 1 … 5 free; contact from 5.5 on: 5.5, 6.5 … 9.5.
  ASSERT_EQ(trail.size(), 11u);
  EXPECT_FALSE(trail.point(5).contact);
  EXPECT_TRUE(trail.point(6).contact);
  EXPECT_NEAR(trail.point(6).pos_w_nm.x(), 5.5, 1e-12);
}

TEST(Trail, ForgetsTheOldest) {
  Trail trail(8, 0.5);
  for (int i = 0; i < 20; ++i) trail.add({static_cast<double>(i), 0, 0}, false);
  ASSERT_EQ(trail.size(), 8u);
  EXPECT_EQ(trail.point(0).pos_w_nm.x(), 12);
  EXPECT_EQ(trail.point(7).pos_w_nm.x(), 19);
  trail.add({std::numeric_limits<double>::quiet_NaN(), 0, 0}, false);
  EXPECT_EQ(trail.point(7).pos_w_nm.x(), 19);
}

TEST(TouchedGround, IsAMapOfCells) {
  TouchedGround touched(3000, 1);
  std::map<std::pair<int, int>, double> model;
  Random random(3);
  for (int i = 0; i < 20'000; ++i) {
    const Vec3 p(100 * random.uniform() - 50, 40 * random.uniform() - 20, random.uniform());
    const std::pair cell{static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y()))};
    if (model.contains(cell) || model.size() < 3000) model[cell] = p.z();
    touched.add(p);
  }
  ASSERT_EQ(touched.points_w_nm().size(), model.size());
  for (const Vec3& p : touched.points_w_nm()) {
    const std::pair cell{static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y()))};
    ASSERT_TRUE(model.contains(cell));
    EXPECT_EQ(model[cell], p.z());
  }
}

}  // namespace
}  // namespace telenano::view_model
