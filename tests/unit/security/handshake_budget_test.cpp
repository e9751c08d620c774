#include "telenano/common/security/handshake_budget.h"

#include <gtest/gtest.h>

namespace telenano::security {
namespace {

// Handshakes of 1 ms asked for all the time: a burst of 10, then a tenth of the time.
TEST(HandshakeBudget, TakesItsShareAndNoMore) {
  HandshakeBudget budget(0.1, 10'000'000);
  std::int64_t now_ns = 0, taken_ns = 0, at_once_ns = 0;
  while (now_ns < 10'000'000'000) {
    if (budget.allows(now_ns)) {
      budget.charge(1'000'000);
      taken_ns += 1'000'000;
      now_ns += 1'000'000;
    } else {
      if (at_once_ns == 0) at_once_ns = taken_ns;
      now_ns += 100'000;
    }
  }
  // The debt falls by a tenth while the burst is taken: 11 of 1 ms, then one more before it is above 10 ms.
  EXPECT_GE(at_once_ns, 10'000'000);
  EXPECT_LE(at_once_ns, 13'000'000);
  EXPECT_NEAR(static_cast<double>(taken_ns), 0.1 * 10e9 + 10e6, 2e6);
}

TEST(HandshakeBudget, ForgivesWithTimeButSavesNothing) {
  HandshakeBudget budget(0.1, 10'000'000);
  budget.charge(50'000'000);
  EXPECT_FALSE(budget.allows(399'000'000));
  EXPECT_TRUE(budget.allows(401'000'000));
  EXPECT_TRUE(budget.allows(100'000'000'000));
  budget.charge(11'000'000);
  EXPECT_FALSE(budget.allows(100'000'000'001));
}

// Who was let in goes on beyond the budget, a step of 30 ms at a time; strangers pay for it: in the long run
// it is a tenth of the time for both together.
TEST(HandshakeBudget, WhoWasLetInGoesOnAndStrangersWait) {
  HandshakeBudget budget(0.1, 10'000'000);
  constexpr std::int64_t kStepNs = 30'000'000;
  std::int64_t taken_ns = 0, now_ns = 0;
  int begun = 0;
  while (now_ns < 100'000'000'000) {
    if (budget.allows(now_ns)) {
      ++begun;
      for (int step = 0; step < 3; ++step) {  // the first, and two more, a round trip of 15 ms later each
        EXPECT_TRUE(step == 0 || budget.allows_to_go_on(now_ns)) << step;
        budget.charge(kStepNs);
        taken_ns += kStepNs;
        now_ns += kStepNs + 15'000'000;
      }
    }
    now_ns += 1'000'000;
  }
  EXPECT_GT(begun, 100);
  // One handshake of 90 ms is begun with the debt below 10 ms.
  EXPECT_NEAR(static_cast<double>(taken_ns), 0.1 * 100e9 + 10e6, 100e6);
}

// Not all at once: those under way share one step in 10 ms.
TEST(HandshakeBudget, WhoWasLetInGoesOnAStepAtATime) {
  HandshakeBudget budget(0.1, 10'000'000);
  budget.charge(1'000'000'000);
  int steps = 0;
  for (std::int64_t now_ns = 0; now_ns < 1'000'000'000; now_ns += 100'000)
    steps += budget.allows_to_go_on(now_ns) ? 1 : 0;
  EXPECT_EQ(steps, 100);
}

}  // namespace
}  // namespace telenano::security
