#include "tests/studies/stress/results.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/studies/stress/summary.h"

namespace telenano::studies::stress {
namespace {

TEST(Invariants, ARateIsBoundedExactly) {
  MethodSummary s;
  EXPECT_EQ(s.rate_at_most(), 1);
  s.runs = 1000;
  // (1 − p)^N = 0.05; the rule of three is 0.14 % above.
  const double none = 1 - std::pow(0.05, 1.0 / 1000);
  EXPECT_NEAR(s.rate_at_most(), none, 1e-9 * none);
  s.broken = 1;
  const double p = s.rate_at_most();
  EXPECT_NEAR(std::pow(1 - p, 1000) + 1000 * p * std::pow(1 - p, 999), 0.05, 1e-9);
  s.broken = s.runs;
  EXPECT_EQ(s.rate_at_most(), 1);
}

TEST(Results, GroupsHaveEveryRunOnce) {
  std::vector<Row> rows(5);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i].spec.scene = i < 2 ? SceneKind::kOxide : SceneKind::kWall;
    rows[i].outcome.shown_ratio = i == 0 ? NAN : 0.1 * static_cast<double>(i);
    rows[i].outcome.margin_mj = 20 - static_cast<double>(i);
  }
  rows[4].outcome.violated = kInvariantEnergy;
  const std::string csv = groups_csv(rows);
  EXPECT_NE(csv.find("model,wall,press,3,1,2,0,0,16,0,0.3\n"), std::string::npos) << csv;
  EXPECT_NE(csv.find("model,oxide,press,2,0,2,0,0,19,0,0.1\n"), std::string::npos) << csv;
}

}  // namespace
}  // namespace telenano::studies::stress
