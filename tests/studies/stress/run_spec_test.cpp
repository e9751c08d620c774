#include "tests/studies/stress/run_spec.h"

#include <gtest/gtest.h>

#include "telenano/common/base/error.h"
#include "telenano/common/control/methods.h"
#include "tests/studies/stress/profile.h"

namespace telenano::studies::stress {
namespace {

// What the text says is what is run.
TEST(RunSpecText, ReadsBackToTheBit) {
  ProfileOptions options;
  options.methods.assign(control::kAllMethods.begin(), control::kAllMethods.end());
  options.scenes = {SceneKind::kWall, SceneKind::kOxide, SceneKind::kScan, SceneKind::kHard};
  for (const RunSpec& spec : make_profile(options)) {
    const RunSpec again = parse_run_spec(to_text(spec));
    EXPECT_EQ(to_text(again), to_text(spec));
    for (const NumberField& field : number_fields())
      ASSERT_EQ(again.*field.value, spec.*field.value) << field.key;
    ASSERT_EQ(again.seed, spec.seed);
    ASSERT_EQ(again.restart, spec.restart);
    ASSERT_EQ(again.playout, spec.playout);
  }
}

TEST(RunSpecText, SaysWhatIsWrong) {
  for (const char* text : {"method=magic",
                           "scene=moon",
                           "hand=foot",
                           "mutant=x",
                           "drops=x",
                           "restart=x",
                           "rtt-ms=-1",
                           "rtt-ms=nan",
                           "rtt-ms=1e",
                           "loss=1",
                           "speed=3",
                           "press",
                           "seed=-1",
                           "hand=path",
                           "playout=x",
                           "playout-ms=-1",
                           "redundancy=1.5",
                           "redundancy=5",
                           "deadband-nm=-1",
                           "reply-permille=1001",
                           "hand=path hand-b=0.1 knots-m=0.1",
                           "hand=path hand-b=0.1 knots-m=0,x"})
    EXPECT_THROW(parse_run_spec(text), UserError) << text;
}

}  // namespace
}  // namespace telenano::studies::stress
