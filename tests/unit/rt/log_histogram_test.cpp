#include "telenano/common/rt/log_histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace telenano::rt {
namespace {

TEST(LogHistogram, BinsTileTheWholeRange) {
  for (std::size_t bin = 0; bin + 1 < LogHistogram::kBins; ++bin) {
    const auto upper = static_cast<std::uint64_t>(LogHistogram::upper_ns(bin));
    ASSERT_EQ(LogHistogram::bin_of(upper), bin);
    ASSERT_EQ(LogHistogram::bin_of(upper + 1), bin + 1);
  }
  EXPECT_EQ(LogHistogram::bin_of(~std::uint64_t{0}), LogHistogram::kBins - 1);
}

/// Oracle: the sorted values themselves. A bin is 1/16 of its lower border wide, so the percentile may be
/// that much too large, and never too small.
TEST(LogHistogram, PercentilesAreWithinASixteenth) {
  std::mt19937_64 random(1);
  std::lognormal_distribution<double> lateness(9.0, 1.5);
  LogHistogram histogram;
  std::vector<std::int64_t> values;
  for (int i = 0; i < 20'000; ++i) {
    values.push_back(static_cast<std::int64_t>(lateness(random)));
    histogram.add(values.back());
  }
  std::sort(values.begin(), values.end());
  for (const double q : {0.01, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size())));
    const std::int64_t exact = values[rank - 1];
    EXPECT_GE(histogram.percentile_ns(q), exact) << q;
    EXPECT_LE(histogram.percentile_ns(q), exact + exact / 16 + 1) << q;
  }
  EXPECT_EQ(histogram.max_ns(), values.back());
  EXPECT_EQ(histogram.percentile_ns(1.0), values.back());
}

TEST(LogHistogram, EmptyAndNegativeAreZero) {
  LogHistogram histogram;
  EXPECT_EQ(histogram.percentile_ns(0.99), 0);
  histogram.add(-5);
  EXPECT_EQ(histogram.count(), 1u);
  EXPECT_EQ(histogram.max_ns(), 0);
}

}  // namespace
}  // namespace telenano::rt
