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

}  // namespace
}  // namespace telenano::security
