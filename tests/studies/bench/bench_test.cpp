// The benches measure what they say: quantiles, verdicts, and that every exchange is one.
#include <gtest/gtest.h>

#include "tests/source_dir.h"
#include "tests/studies/bench/closed_loop.h"
#include "tests/studies/bench/codec_bench.h"
#include "tests/studies/bench/paced_load.h"
#include "tests/studies/bench/result_rows.h"
#include "tests/studies/bench/served.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

const std::string kFlat = std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flat_table.toml";

TEST(Quantile, IsTheSmallestThatSoManyDoNotExceed) {
  std::vector<double> v;
  for (int i = 100; i > 0; --i) v.push_back(i);
  EXPECT_EQ(quantile(v, 0.5), 50);
  EXPECT_EQ(quantile(v, 0.99), 99);
  EXPECT_EQ(quantile(v, 0.999), 100);
  EXPECT_EQ(quantile(v, 1), 100);
  EXPECT_EQ(median({3, 1, 2}), 2);
  std::vector<double> none;
  EXPECT_EQ(quantile(none, 0.5), 0);
}

TEST(Rows, HoldOnTheRightSideOfTheirTarget) {
  EXPECT_TRUE(holds({"a", "us", 3, 2.0, 1.5, false})) << "the target itself is reached";
  EXPECT_FALSE(holds({"a", "us", 3.1, 2.0, 1.5, false}));
  EXPECT_TRUE(holds({"a", "per_s", 8, 10.0, 0.8, true}));
  EXPECT_FALSE(holds({"a", "per_s", 7, 10.0, 0.8, true}));
  EXPECT_TRUE(holds({"a", "us", 999, {}, 1000.0, false})) << "no floor: the product itself";
  EXPECT_TRUE(holds({"a", "us", 1e9, {}, {}, false})) << "no target";
}

TEST(ClosedLoop, CountsWhatTheServerCounts) {
  Served served(scene::load_scene(kFlat), 0, false, 64);
  ClosedLoop stations(served.address(), 2, 16, true, false);
  const std::uint64_t answers = stations.run(50'000'000);
  EXPECT_GT(answers, 0u);
  EXPECT_GT(stations.reply_bytes(), 100u);
  // The loop tells its count once a millisecond, more or less; on a busy machine it still has before it what
  // the stations did not wait for.
  for (int i = 0; i < 1000 && served.exchanges() < answers + stations.lost(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_EQ(served.exchanges(), answers + stations.lost());
}

TEST(Paced, EveryCommandIsSentAndAnswered) {
  PacedOptions options;
  options.scene = kFlat;
  options.sessions = 10;
  options.rate_hz = 100;
  options.seconds = 0.3;
  options.client_cpu = std::thread::hardware_concurrency() > 1 ? 1 : 0;
  const PacedResult r = run_paced(options);
  EXPECT_EQ(r.commands + r.left_out, 300u);
  EXPECT_EQ(r.replies, r.commands);
  EXPECT_GT(r.p50_us, 0);
  EXPECT_LE(r.p50_us, r.p99_us);
  EXPECT_LE(r.p99_us, r.max_us);
  EXPECT_GT(r.sent_rate_hz, 0);
}

TEST(PacedLoad, TellsSecondsApartAndWhenAnAnswerWasDue) {
  PacedOptions options;
  options.sessions = 25;
  options.together = 10;
  options.seconds = 3;
  EXPECT_EQ(options.groups(), 3u);
  EXPECT_EQ(options.in_group(0, 3), 9u);
  EXPECT_EQ(options.in_group(2, 3), 8u);
  const PacedTimes times(options, 4, 5'000'000);
  EXPECT_EQ(times.due_ns(2, 1), 7'250'000);
  EXPECT_EQ(times.due_of_ns(7'250'000, 1), 7'250'000);
  EXPECT_EQ(times.due_of_ns(8'249'999, 1), 7'250'000);
  EXPECT_EQ(times.due_of_ns(8'250'000, 1), 8'250'000);

  PacedRecord account(options);
  account.begin(times);
  account.answered(0, 4'999'999, 6'000'000);  // sent before
  for (int second = 0; second < 3; ++second) {
    for (int k = 0; k < 100; ++k) {
      const std::int64_t sent_ns = times.due_ns(1000 * second + k, 0);
      account.sent(1, 0);
      account.answered(0, sent_ns, sent_ns + (second == 1 ? 2'000'000 : 100'000));
    }
  }
  account.left_out(100);
  account.sent(100, 0);
  account.answered(0, times.due_ns(3000, 0), times.due_ns(3000, 0) + 1);  // ends the third second
  const PacedResult r = account.result(times.due_ns(3000, 0), 1'500'000'000);
  EXPECT_EQ(r.replies, 301u);
  EXPECT_EQ(r.seconds, 3u);
  EXPECT_EQ(r.seconds_that_hold, 2u);
  EXPECT_NEAR(r.median_second_p99_us, 100, 100.0 / 16);  // a bin of the histogram
  EXPECT_NEAR(r.p99_us, 2000, 2000.0 / 16);
  EXPECT_DOUBLE_EQ(r.sent_part(), 0.8);
  EXPECT_DOUBLE_EQ(r.server_share, 0.5);
  EXPECT_FALSE(r.holds());
}

// It throws where a session leaves out another share than it should.
TEST(GateBench, EachSessionLeavesOutWhatItShould) {
  ServerBenchOptions options;
  options.flat = kFlat;
  options.only = "reply_gate";
  options.rounds = 1;
  const auto rows = run_gate_bench(options);
  ASSERT_EQ(rows.size(), 3u);
  for (const BenchRow& row : rows) EXPECT_TRUE(row.product > 0 && row.floor && *row.floor > 0) << row.what;
  options.only = "flat";
  EXPECT_TRUE(run_gate_bench(options).empty());
}

TEST(CodecBench, NothingIsRefusedAndNothingAllocated) {
  const auto rows = run_codec_bench(1);
  ASSERT_EQ(rows.size(), 4u);
  EXPECT_EQ(rows[2].quantity, "allocations");
  EXPECT_EQ(rows[2].product, 0);
  EXPECT_EQ(rows[3].quantity, "refused");
  EXPECT_EQ(rows[3].product, 0);
}

}  // namespace
}  // namespace telenano::studies
