#include "tests/studies/stress/search.h"

#include <gtest/gtest.h>

#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/scenes.h"
#include "tests/studies/stress/stress_run.h"

namespace telenano::studies::stress {
namespace {

TEST(Search, ClimbingFindsMoreAndShrinkingKeepsTheFault) {
  const Scenes& scenes = Scenes::of_this_tree();
  const RunSpec start = parse_run_spec("method=none hand=climb-slow hand-a=0 seconds=1 rtt-ms=50 seed=3");
  RunSpec climbing = start;
  climbing.hand_a = 30;
  const Outcome before = run(start, scenes);
  EXPECT_GT(run(climbing, scenes).extracted_mj, before.extracted_mj);

  const RunSpec whole = parse_run_spec(
      "method=ks-clamp mutant=no-clamp hand=greedy hand-a=0.1 hand-b=0.01 seconds=4 rtt-ms=100 scale=4 "
      "loss=0.1 "
      "duplicate=0.1 drift-ppm=100 leap-ms=50 seed=9");
  const auto bad = [](const Outcome& o) { return (o.violated & kInvariantEnergy) != 0; };
  ASSERT_TRUE(bad(run(whole, scenes)));
  const RunSpec small = shrink(whole, scenes, bad);
  EXPECT_TRUE(bad(run(small, scenes)));
  EXPECT_EQ(small.hand, HandKind::kPath);
  EXPECT_LT(small.seconds, 2);
  EXPECT_LT(small.knots_m.size(), 200u);
  EXPECT_EQ(small.leap_ms, 0);
  EXPECT_EQ(small.duplicate, 0);
  EXPECT_EQ(small.mutant, Mutant::kNoClamp);
}

}  // namespace
}  // namespace telenano::studies::stress
