#include "tests/studies/loop_bench/loop_bench.h"

#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/base/error.h"
#include "tests/studies/loop_bench/cyclictest.h"

namespace telenano::studies {
namespace {

// As cyclictest 2.4 prints it.
constexpr const char* kPrinted =
    "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000001 000000\n000002 000090\n000003 "
    "000008\n000004 000000\n"
    "# Min Latencies: 00002\n# Histogram Overflows: 00002\n# Thread 0: 00017 00042\n";

TEST(Cyclictest, ReadsItsHistogram) {
  const LatenessHistogram histogram = parse_cyclictest(kPrinted, 5);
  EXPECT_EQ(histogram, (LatenessHistogram{0, 0, 90, 8, 0, 2}));
  EXPECT_EQ(quantile_us(histogram, 0.5), 2);
  EXPECT_EQ(quantile_us(histogram, 0.9), 2);
  EXPECT_EQ(quantile_us(histogram, 0.91), 3);
  EXPECT_EQ(quantile_us(histogram, 0.98), 3);
  EXPECT_EQ(quantile_us(histogram, 0.99), 5);
  EXPECT_EQ(quantile_us(histogram, 1), 5);
  EXPECT_TRUE(std::isnan(quantile_us({0, 0}, 0.5)));
}

TEST(Cyclictest, AnythingElseIsAnError) {
  EXPECT_THROW(parse_cyclictest("policy: fifo\n", 5), RunError);
  EXPECT_THROW(parse_cyclictest("000009 000001\n", 5), RunError);
  EXPECT_THROW(parse_cyclictest("000001 -4\n", 5), RunError);
}

TEST(LoopBench, MedianOfThePairsRatios) {
  std::vector<LoopBenchRow> rows;
  const double station[] = {2, 30, 8}, floor[] = {4, 10, 8};
  for (int pair = 0; pair < 3; ++pair) {
    rows.push_back({1000, pair, "cyclictest", floor[pair], 0, 0, 0, 1});
    rows.push_back({1000, pair, "station", station[pair], 0, 0, 0, 1});
    rows.push_back({4000, pair, "station", 1000, 0, 0, 0, 1});
  }
  EXPECT_EQ(median_ratio(rows, 1000, &LoopBenchRow::p50_us), 1.0);  // of 0.5, 3, 1
  EXPECT_EQ(median_ratio(rows, 1000, &LoopBenchRow::p99_us), 1.0);  // both below a microsecond
  EXPECT_TRUE(std::isnan(median_ratio(rows, 4000, &LoopBenchRow::p50_us)));
}

}  // namespace
}  // namespace telenano::studies
