#include "tests/studies/coupling/mode_table.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace telenano::studies {
namespace {

using physics::ModeIntegrator;

TEST(ModeTable, HasTheOrdersOfTheMethods) {
  for (const double ratio : {1.0, 10.0}) {
    const auto gain = [&](ModeIntegrator method) {
      return mode_row(method, 1.0 / 256, ratio, false).error /
             mode_row(method, 1.0 / 512, ratio, false).error;
    };
    // First, first and second order, to what the next order is at these steps.
    EXPECT_NEAR(gain(ModeIntegrator::kBackwardEuler), 2, 0.2);
    EXPECT_NEAR(gain(ModeIntegrator::kHeldForce), 2, 0.2);
    EXPECT_NEAR(gain(ModeIntegrator::kMeanForce), 4, 0.4);
  }
  // Free, two of them are exact: rounding of some hundred steps.
  EXPECT_LT(mode_row(ModeIntegrator::kMeanForce, 0.5, 0, false).error, 1e-12);
  EXPECT_LT(mode_row(ModeIntegrator::kHeldForce, 0.5, 0, false).error, 1e-12);
  EXPECT_GT(mode_row(ModeIntegrator::kBackwardEuler, 0.5, 0, false).error, 0.1);
}

TEST(ModeTable, WritesOneColumnForEachName) {
  const auto commas = [](const std::string& s) { return std::count(s.begin(), s.end(), ','); };
  const auto rows = mode_table(false);
  EXPECT_EQ(rows.size(), 3u * 4 * 8);
  for (const auto& row : rows) EXPECT_EQ(commas(mode_csv(row)), commas(mode_csv_header()));
  EXPECT_GT(mode_row(ModeIntegrator::kMeanForce, 0.5, 1, true).ns_a_step, 0);
}

}  // namespace
}  // namespace telenano::studies
