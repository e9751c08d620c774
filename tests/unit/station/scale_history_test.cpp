#include "telenano/master/station/scale_history.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace telenano::station {
namespace {

TEST(ScaleHistory, EachCommandKeepsItsOwnPrice) {
  ScaleHistory history;
  for (std::uint64_t k = 1; k <= 100; ++k) history.sent(k, k < 50 ? 2 : 7);
  for (std::uint64_t k = 1; k <= 100; ++k) EXPECT_EQ(history.answered(k, 9), k < 50 ? 2 : 7) << k;
}

TEST(ScaleHistory, WhereRepliesAreLostOverAChangeTheLesserHolds) {
  ScaleHistory history;
  for (std::uint64_t k = 1; k <= 20; ++k) history.sent(k, k < 10 ? 7 : 2);
  EXPECT_EQ(history.answered(8, 9), 7);
  EXPECT_EQ(history.answered(12, 9), 2);
  ScaleHistory other;
  for (std::uint64_t k = 1; k <= 20; ++k) other.sent(k, k < 10 ? 2 : 7);
  EXPECT_EQ(other.answered(12, 9), 2) << "commands 1 to 12";
  EXPECT_EQ(other.answered(20, 9), 7) << "commands 13 to 20";
}

// Against a list of all commands, over loss, with a change at any of them.
TEST(ScaleHistory, NeverMoreThanTheLeastOfWhatMayHaveHappened) {
  std::mt19937_64 random(9);
  for (const unsigned change_of : {2u, 10u, 100u}) {
    ScaleHistory history;
    std::vector<double> price(1, 0);
    std::uint64_t next = 1;
    double now = 1;
    for (std::uint64_t k = 1; k <= 20'000; ++k) {
      if (random() % change_of == 0) now = 1 + static_cast<double>(random() % 1000);
      price.push_back(now);
      history.sent(k, now);
      if (k <= 100 || random() % 3 == 0) continue;
      const std::uint64_t answered = k - 100;  // a hundred on the way
      if (answered < next) continue;
      const double least = *std::min_element(price.begin() + static_cast<std::ptrdiff_t>(next),
                                             price.begin() + static_cast<std::ptrdiff_t>(answered) + 1);
      ASSERT_EQ(history.answered(answered, 1e9), least) << k;
      next = answered + 1;
    }
  }
}

TEST(ScaleHistory, WhatAnEarlierSessionDidIsToldByTheFirstReplyOfTheNext) {
  ScaleHistory history;
  history.sent(1, 3);
  history.sent(2, 8);
  history.begin_session(false);
  history.sent(1, 8);
  EXPECT_EQ(history.answered(1, 8), 3);
  history.sent(2, 8);
  EXPECT_EQ(history.answered(2, 8), 8);
  history.begin_session(true);  // another slave's sums begin at nothing
  history.sent(1, 5);
  EXPECT_EQ(history.answered(1, 5), 5);
}

TEST(ScaleHistory, ACommandThatWasNotSentAfterAllHasTheLastPrice) {
  ScaleHistory history;
  history.sent(1, 3);
  history.sent(2, 4);
  history.sent(2, 6);
  EXPECT_EQ(history.answered(1, 9), 3);
  EXPECT_EQ(history.answered(2, 9), 6);
}

}  // namespace
}  // namespace telenano::station
