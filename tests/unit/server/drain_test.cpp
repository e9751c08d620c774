// When a drain is over, and what a server that drains still does.
#include <gtest/gtest.h>

#include "telenano/nve_server/app/serve/drain_watcher.h"

namespace telenano::app {
namespace {

using State = DrainRule::State;
constexpr std::int64_t kSecondNs = 1'000'000'000;

TEST(DrainRule, OverWhenNobodyHasBeenThereTwice) {
  DrainRule rule(std::nullopt);
  EXPECT_EQ(rule.look(true, 2, 0), State::kGoesOn);
  EXPECT_EQ(rule.look(true, 0, 1), State::kGoesOn);
  EXPECT_EQ(rule.look(true, 1, 2), State::kGoesOn);  // it was between two workers
  EXPECT_EQ(rule.look(true, 0, 3), State::kGoesOn);
  EXPECT_EQ(rule.look(true, 0, 4), State::kEmpty);
}

TEST(DrainRule, NotWhileALoopMayStillTakeASession) {
  DrainRule rule(std::nullopt);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(rule.look(false, 0, i), State::kGoesOn);
}

TEST(DrainRule, LateAfterItsTimeAndNeverWithoutOne) {
  DrainRule rule(10 * kSecondNs);
  EXPECT_EQ(rule.look(true, 1, 5 * kSecondNs), State::kGoesOn);  // from here on
  EXPECT_EQ(rule.look(true, 1, 15 * kSecondNs - 1), State::kGoesOn);
  EXPECT_EQ(rule.look(true, 1, 15 * kSecondNs), State::kLate);
  DrainRule patient(std::nullopt);
  EXPECT_EQ(patient.look(true, 1, 0), State::kGoesOn);
  EXPECT_EQ(patient.look(true, 1, 1'000'000 * kSecondNs), State::kGoesOn);
}

}  // namespace
}  // namespace telenano::app
