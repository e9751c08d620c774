#include "tests/studies/stress/profile.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <set>

#include "telenano/common/base/error.h"
#include "telenano/common/control/methods.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {
namespace {

using control::Method;

TEST(Profile, TheFullOneIsAsLargeAsItSaysAndRepeats) {
  ProfileOptions options;
  options.full = true;
  options.methods.assign(control::kAllMethods.begin(), control::kAllMethods.end());
  options.scenes = {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPolystyrene,
                    SceneKind::kPdms, SceneKind::kScan,  SceneKind::kHard};
  const auto runs = make_profile(options);
  std::size_t long_ones = 0, defaults = 0, played_out = 0, repeated = 0, held_back = 0;
  std::set<std::uint64_t> seeds;
  for (const RunSpec& spec : runs) {
    long_ones += spec.seconds >= 10;
    defaults += spec.method == Method::kModel;
    played_out += spec.playout != RunSpec{}.playout;
    repeated += spec.redundancy > 0;
    held_back += spec.deadband_nm > 0;
    seeds.insert(spec.seed);
    for (const NumberField& field : number_fields()) {
      ASSERT_GE(spec.*field.value, field.low) << field.key;
      ASSERT_LE(spec.*field.value, field.high) << field.key;
    }
  }
  EXPECT_GE(long_ones, 20'000u);
  EXPECT_GE(defaults, 6'000u);
  EXPECT_GE(std::min({played_out, repeated, held_back}), 2'000u);
  EXPECT_EQ(seeds.size(), runs.size());
  const auto again = make_profile(options);
  ASSERT_EQ(again.size(), runs.size());
  for (std::size_t i = 0; i < runs.size(); i += 101) ASSERT_EQ(to_text(again[i]), to_text(runs[i]));
}

TEST(Profile, TheOneOfRepliesLeavesSomeOutInEachRun) {
  ProfileOptions options;
  options.replies = true;
  options.methods.assign(control::kAllMethods.begin(), control::kAllMethods.end());
  options.scenes = {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPdms, SceneKind::kScan};
  const auto runs = make_profile(options);
  EXPECT_GE(runs.size(), 30'000u);
  for (const RunSpec& spec : runs) {
    ASSERT_GT(spec.reply_permille, 0);
    ASSERT_NE(spec.method, Method::kTwin);
    ASSERT_EQ(to_text(parse_run_spec(to_text(spec))), to_text(spec));
  }
  options.methods = {Method::kTwin};
  EXPECT_THROW(make_profile(options), UserError);
}

TEST(Profile, ARangeLeavesOutWhatIsBeyondIt) {
  ProfileOptions options;
  options.methods = {Method::kModel};
  options.scenes = {SceneKind::kWall};
  options.rtt_ms = {5, 50};
  options.loss = {0.1, 0.3};
  for (const RunSpec& spec : make_profile(options)) {
    ASSERT_TRUE(options.rtt_ms.holds(spec.rtt_ms) && options.loss.holds(spec.loss)) << to_text(spec);
    ASSERT_EQ(spec.scene, SceneKind::kWall);
  }
}

}  // namespace
}  // namespace telenano::studies::stress
