// Who opens sessions gets a bounded share of the loop's time, by what openings really take.
#include "telenano/nve_server/server/opening_budget.h"

#include <gtest/gtest.h>

namespace telenano::server {
namespace {

constexpr std::int64_t kMsNs = 1'000'000;

/// Openings that are let in within a second of attempts each 0.1 ms, each taking so long.
int opened_in_a_second(std::int64_t takes_ns) {
  OpeningBudget budget(0.25, 10 * kMsNs);
  int opened = 0;
  for (std::int64_t now_ns = 0; now_ns < 1000 * kMsNs; now_ns += kMsNs / 10) {
    if (!budget.allows(now_ns)) continue;
    budget.charge(takes_ns);
    ++opened;
  }
  return opened;
}

TEST(OpeningBudget, CheapOnesAreNotBound) {
  EXPECT_EQ(opened_in_a_second(10'000), 10'000);
}

TEST(OpeningBudget, CostlyOnesGetTheirShareAfterTheBurst) {
  EXPECT_NEAR(opened_in_a_second(5 * kMsNs), 52, 1);  // 10 ms and a quarter of the second, by 5 ms
}

TEST(OpeningBudget, OneThatTakesMoreThanTheBurstIsPaidOffAfterwards) {
  EXPECT_NEAR(opened_in_a_second(100 * kMsNs), 3, 1);
}

TEST(OpeningBudget, WhatWasNotUsedIsNotKept) {
  OpeningBudget budget(0.25, 10 * kMsNs);
  EXPECT_TRUE(budget.allows(0));
  EXPECT_TRUE(budget.allows(1'000'000 * kMsNs));
  budget.charge(20 * kMsNs);
  EXPECT_FALSE(budget.allows(1'000'000 * kMsNs));
}

}  // namespace
}  // namespace telenano::server
