#include "tests/studies/stress/table.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <iterator>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "tests/source_dir.h"
#include "tests/studies/stress/profile.h"
#include "tests/studies/stress/sweep.h"

namespace telenano::studies::stress {
namespace {

namespace fs = std::filesystem;

std::string slurp(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

class StressTable : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("telenano_stress_table_" + std::to_string(::getpid()) + "_" +
                                           testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static Row row(std::size_t index) {
    Random random(index + 1);
    Row r;
    r.index = index;
    r.spec.rtt_ms = random.uniform();
    r.spec.seed = random.bits() >> 1;
    r.spec.restart = Restart::kSnapIn;
    r.outcome.extracted_mj = random.normal();
    r.outcome.force_error_n = std::nan("");
    r.outcome.hash = random.bits();
    r.outcome.violated = static_cast<std::uint32_t>(index % 3);
    return r;
  }
  void fill(std::size_t number, std::size_t of, std::size_t rows) {
    ShardTable table(folder_, manifest(), {number, of});
    std::size_t at = table.rows();
    for (std::size_t i = number + at * of; i < manifest().runs && at < rows; i += of, ++at)
      table.append(row(i));
  }
  static Manifest manifest(int seed = 1) {
    return {"test seed=" + std::to_string(seed) + " runs=10 commit=x", 10};
  }
  fs::path shard(const std::string& name) const { return folder_ / "shards" / name; }

  fs::path folder_;
};

TEST_F(StressTable, ARowReadsBackToTheBit) {
  for (std::size_t i = 0; i < 100; ++i) {
    const Row once = row(i);
    const Row again = parse_row(to_csv(once));
    EXPECT_EQ(to_csv(again), to_csv(once));
    EXPECT_EQ(again.spec.rtt_ms, once.spec.rtt_ms);
    EXPECT_EQ(again.outcome.extracted_mj, once.outcome.extracted_mj);
    EXPECT_TRUE(std::isnan(again.outcome.force_error_n));
    EXPECT_EQ(again.outcome.hash, once.outcome.hash);
  }
  EXPECT_THROW(parse_row("1,2,3"), RunError);
}

TEST_F(StressTable, AnyNumberOfShardsGivesTheSameTable) {
  fill(0, 1, 10);
  ASSERT_EQ(merge(folder_).size(), 10u);
  const std::string one = slurp(folder_ / "runs.csv");
  for (const std::size_t of : {2u, 3u, 7u}) {
    fs::remove_all(folder_);
    for (std::size_t i = 0; i < of; ++i) fill(i, of, 10);
    merge(folder_);
    EXPECT_EQ(slurp(folder_ / "runs.csv"), one) << of;
    merge(folder_);  // once more changes nothing
    EXPECT_EQ(slurp(folder_ / "runs.csv"), one) << of;
  }
}

TEST_F(StressTable, GoesOnWhereItWasCutWhereverThatWas) {
  fill(0, 1, 10);
  const std::string whole = slurp(shard("0000-of-0001.csv"));
  for (std::size_t length = 0; length < whole.size(); length += 37) {
    std::ofstream(shard("0000-of-0001.csv"), std::ios::binary) << whole.substr(0, length);
    if (length > 0 && whole[length - 1] != '\n') {
      EXPECT_THROW(merge(folder_), UserError) << length;
    }
    fill(0, 1, 10);
    ASSERT_EQ(slurp(shard("0000-of-0001.csv")), whole) << length;
  }
}

TEST_F(StressTable, RefusesWhatIsOfAnotherSweepAndLeavesItAsItIs) {
  fill(0, 2, 3);
  const std::string before = slurp(shard("0000-of-0002.csv"));
  EXPECT_THROW(ShardTable(folder_, manifest(2), {0, 2}), UserError);
  EXPECT_THROW(ShardTable(folder_, manifest(2), {1, 2}), UserError);
  EXPECT_EQ(slurp(shard("0000-of-0002.csv")), before);
  // A file from elsewhere, under the right name.
  std::string foreign = before;
  foreign.replace(foreign.find("seed=1"), 6, "seed=2");
  std::ofstream(shard("0001-of-0002.csv"), std::ios::binary) << foreign;
  EXPECT_THROW(fill(1, 2, 10), UserError);
  EXPECT_EQ(slurp(shard("0001-of-0002.csv")), foreign);
  EXPECT_THROW(merge(folder_), UserError);
  // A damaged row in the middle.
  std::string damaged = before;
  damaged.replace(damaged.find("snap-in"), 7, "snap-xx");
  std::ofstream(shard("0000-of-0002.csv"), std::ios::binary) << damaged;
  EXPECT_THROW(fill(0, 2, 10), UserError);
  EXPECT_EQ(slurp(shard("0000-of-0002.csv")), damaged);
}

TEST_F(StressTable, TwoProcessesDoNotWriteOneShard) {
  const ShardTable first(folder_, manifest(), {0, 1});
  EXPECT_THROW(ShardTable(folder_, manifest(), {0, 1}), UserError);
  const ShardTable other(folder_, manifest(), {1, 2});
}

TEST_F(StressTable, MergingRefusesGapsAndOverlaps) {
  EXPECT_THROW(merge(folder_), UserError) << "nothing there";
  fill(0, 2, 10);
  EXPECT_THROW(merge(folder_), UserError) << "half of it";
  fill(1, 2, 4);
  EXPECT_THROW(merge(folder_), UserError) << "one row is missing";
  fill(1, 2, 10);
  EXPECT_EQ(merge(folder_).size(), 10u);
  std::ofstream(folder_ / "runs.csv", std::ios::app) << "more\n";
  EXPECT_THROW(merge(folder_), UserError) << "says something else";
  fs::remove(folder_ / "runs.csv");
  fill(0, 3, 1);
  EXPECT_THROW(merge(folder_), UserError) << "run 0 is there twice";
}

// Rows, threads, shards: the real thing, small.
TEST_F(StressTable, ASweepDoesNotDependOnThreadsOrShards) {
  SweepOptions options;
  options.profile.methods = {control::Method::kTank};
  options.profile.scenes = {SceneKind::kWall};
  options.profile.rtt_ms = {10, 20};
  options.profile.loss = {0, 0.01};
  options.scenes = fs::path(TELENANO_SOURCE_DIR) / "deploy" / "scenes";
  options.out = folder_ / "a";
  options.threads = 1;
  options.quiet = true;
  const SweepResult result = sweep(options);
  EXPECT_EQ(result.computed, result.runs);
  merge(options.out);
  const SweepResult again = sweep(options);
  EXPECT_EQ(again.computed, 0u);
  options.out = folder_ / "b";
  options.threads = 4;
  for (std::size_t i = 0; i < 3; ++i) {
    options.shard = {i, 3};
    sweep(options);
  }
  merge(options.out);
  EXPECT_EQ(slurp(folder_ / "a" / "runs.csv"), slurp(folder_ / "b" / "runs.csv"));
}

}  // namespace
}  // namespace telenano::studies::stress
