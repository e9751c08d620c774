// Which runs are held to what is true, and that each rule is broken by what it is about. That right methods
// keep them and wrong renderers do not is the sweep's and FidelitySensitivity's affair.
#include "tests/studies/stress/felt_limits.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/studies/stress/invariants.h"

namespace telenano::studies::stress {
namespace {

RunSpec calm(control::Method method = control::Method::kModel) {
  RunSpec spec;
  spec.method = method;
  spec.scene = SceneKind::kOxide;
  spec.hand = HandKind::kPress;
  spec.rtt_ms = 20;
  return spec;
}

TEST(FeltLimits, AreAskedOfCalmRunsOfMethodsThatShowTheSample) {
  using control::Method;
  for (const Method method : {Method::kNone, Method::kTank, Method::kModel, Method::kTwin})
    EXPECT_TRUE(felt_limits(calm(method))) << control::method_name(method);
  for (const Method method : {Method::kKs, Method::kKsClamp}) {
    ASSERT_TRUE(felt_limits(calm(method))) << control::method_name(method);
    EXPECT_GE(felt_limits(calm(method))->share_low, 0.7) << "and nothing else";
    EXPECT_EQ(felt_limits(calm(method))->nrmse, FeltLimits::kAny);
  }
  for (const Method method : {Method::kTdpa, Method::kWave}) {
    EXPECT_FALSE(felt_limits(calm(method))) << control::method_name(method);
    RunSpec near = calm(method);
    near.rtt_ms = 0;
    EXPECT_TRUE(felt_limits(near)) << control::method_name(method);
  }
  std::vector<RunSpec> rough(9, calm());
  rough[0].loss = 0.01;
  rough[1].jitter = 0.1;
  rough[2].outage_ms = 100;
  rough[3].hand = HandKind::kGreedy;
  rough[4].scale = 4;
  rough[5].late = 0.1;
  rough[6].restart = Restart::kContact;
  rough[7].drops = Drops::kSpite;
  rough[8].scene = SceneKind::kHard;
  for (const RunSpec& spec : rough) EXPECT_FALSE(felt_limits(spec)) << to_text(spec);
}

TEST(FeltLimits, ATwinIsHeldToThemOverAnyDelay) {
  RunSpec spec = calm(control::Method::kTwin);
  spec.rtt_ms = 500;
  ASSERT_TRUE(felt_limits(spec));
  EXPECT_LE(felt_limits(spec)->nrmse, 0.02);
  spec.method = control::Method::kModel;
  EXPECT_FALSE(felt_limits(spec)) << "a plane over a long way is no such promise";
}

TEST(FeltLimits, ATwinIsHeldToThemWhateverBecomesOfDatagrams) {
  RunSpec spec = calm(control::Method::kTwin);
  spec.rtt_ms = 200;
  spec.jitter = 0.1;
  spec.loss = 0.3;
  spec.burst_ms = 3;
  EXPECT_TRUE(felt_limits(spec));
  spec.burst_ms = 20;
  EXPECT_FALSE(felt_limits(spec)) << "in ten seconds some burst is so long that the force fades, as it must";
  spec.burst_ms = 3;
  spec.jitter = 0.5;
  EXPECT_FALSE(felt_limits(spec));
}

TEST(FeltLimits, TheTipIsWhereTheHandHasLedIt) {
  RunSpec spec = calm();
  spec.loss = 0.5;
  spec.restart = Restart::kContact;
  ASSERT_TRUE(drift_limit_mm(spec)) << "positions are sent, so nothing that is lost stays away";
  EXPECT_LE(*drift_limit_mm(spec), 0.1);
  RunSpec free = spec;
  free.act = Act::kScale;
  EXPECT_FALSE(drift_limit_mm(free));
  free = spec;
  free.deadband_nm = 0.1;
  EXPECT_NEAR(*drift_limit_mm(free), *drift_limit_mm(spec) + 0.1, 1e-12)
      << "a nanometre of the tip is a millimetre of the hand";
  for (const control::Method method :
       {control::Method::kTwin, control::Method::kTank, control::Method::kTdpa, control::Method::kWave}) {
    spec.method = method;
    EXPECT_FALSE(drift_limit_mm(spec))
        << control::method_name(method) << ": a log that was cut, energy that was lost";
  }
  spec.restart = Restart::kNever;
  spec.method = control::Method::kTank;
  EXPECT_TRUE(drift_limit_mm(spec));
  spec.rtt_ms = 500;
  spec.jitter = 0.9;
  EXPECT_FALSE(drift_limit_mm(spec)) << "still on the way";
}

TEST(FeltLimits, AfterAnActTheShareIsAskedWhereTheScaleCanBeShown) {
  RunSpec spec = calm();
  spec.rtt_ms = 0;
  spec.hand = HandKind::kPress;
  spec.scene = SceneKind::kPdms;
  spec.method = control::Method::kModel;
  EXPECT_FALSE(share_limits_of_acts(spec)) << "nothing is done";
  spec.act = Act::kScale;
  ASSERT_TRUE(share_limits_of_acts(spec));
  EXPECT_GE(share_limits_of_acts(spec)->low, 0.9);
  spec.scene = SceneKind::kOxide;
  EXPECT_FALSE(share_limits_of_acts(spec)) << "five times as strong is more than the device shows";
  spec.act = Act::kImpedance;
  EXPECT_TRUE(share_limits_of_acts(spec));
  spec.loss = 0.1;
  EXPECT_FALSE(share_limits_of_acts(spec));
}

TEST(FeltLimits, EachRuleIsBrokenByWhatItIsAbout) {
  FeltLimits limits = *felt_limits(calm());
  limits.share_low = 0.7;
  limits.share_high = 1.02;
  fidelity::FeltMetrics right;
  right.true_rms_n = 1;
  right.true_lateral_rms_n = 0.1;
  right.nrmse = right.nrmse_at_lag = 0.01;
  right.lag_ms = 2;
  right.pull_off_error = 0.01;
  right.lateral_correlation = 0.999;
  EXPECT_EQ(felt_violations(right, {1, 1}, limits), 0u);
  auto wrong = right;
  wrong.nrmse_at_lag = 0.5;
  EXPECT_EQ(felt_violations(wrong, {1, 1}, limits), kInvariantFelt);
  wrong = right;
  wrong.lag_ms = 100;
  EXPECT_EQ(felt_violations(wrong, {1, 1}, limits), kInvariantInTime);
  wrong = right;
  wrong.pull_off_error = -1;
  EXPECT_EQ(felt_violations(wrong, {1, 1}, limits), kInvariantPull);
  wrong = right;
  wrong.lateral_correlation = -1;
  EXPECT_EQ(felt_violations(wrong, {1, 1}, limits), kInvariantLateral);
  // No lateral force felt where there is one: no correlation is no excuse.
  wrong.lateral_correlation = fidelity::FeltMetrics::kNone;
  EXPECT_EQ(felt_violations(wrong, {1, 1}, limits), kInvariantLateral);
  // No force at all: nothing correlates, and no lag fits.
  wrong = {};
  wrong.true_rms_n = wrong.nrmse = 1;
  EXPECT_NE(felt_violations(wrong, {1, 1}, limits) & kInvariantFelt, 0u);
  // Half of the force, and a quarter too much of it.
  EXPECT_EQ(felt_violations(right, {0.5, 1}, limits), kInvariantFelt);
  EXPECT_EQ(felt_violations(right, {1.25, 1}, limits), kInvariantFelt);
  EXPECT_EQ(felt_violations(right, {std::nan(""), 1}, limits), 0u) << "ground that is not level";
  limits.lateral_share_low = 0.9;
  limits.lateral_share_high = 1.1;
  EXPECT_EQ(felt_violations(right, {1, 1}, limits), 0u);
  EXPECT_EQ(felt_violations(right, {1, 0.3}, limits), kInvariantLateral);
  EXPECT_EQ(felt_violations(right, {1, -1}, limits), kInvariantLateral);
  // Nothing to be felt.
  EXPECT_EQ(felt_violations({}, {1, 1}, limits), 0u);
}

}  // namespace
}  // namespace telenano::studies::stress
