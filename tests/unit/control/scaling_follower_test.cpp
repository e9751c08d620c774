// The scale that follows the link: within the exact bound at every delay, lower at once, higher only at rest.
#include <gtest/gtest.h>

#include <vector>

#include "telenano/common/control/scaling_follower.h"

namespace telenano::control {
namespace {

ScalingPlanInput session(Method method = Method::kKs, int delay = 2) {
  ScalingPlanInput input;
  input.method = method;
  input.plant.device_damping_n_s_m = 2;
  input.plant.coupling_stiffness_n_m = 20;
  input.plant.coupling_damping_n_s_m = 0.01;
  input.plant.period_s = 1e-3;
  input.plant.delay_samples = delay;
  input.tip_force_max_nn = 1;  // so that passivity binds, not the device
  return input;
}

ScalingFollower following(const ScalingPlanInput& input = session()) {
  return {input, plan_scaling(input).scaling.force};
}

/// Ticks of 1 ms; how often it changed.
int run(ScalingFollower& follower, double rtt_s, double seconds, bool at_rest, double jitter_s = 0) {
  int changes = 0;
  for (int i = 0; i < static_cast<int>(seconds * 1000); ++i)
    changes += follower.update({rtt_s, jitter_s, at_rest}, 1e-3) ? 1 : 0;
  return changes;
}

TEST(ScalingFollower, IsPassiveAtTheDelayThatThereIs) {
  for (const double rtt_s : {0.01, 0.033, 0.1, 0.3, 0.7}) {
    ScalingFollower follower = following(session());
    const double before = follower.force();
    EXPECT_EQ(run(follower, rtt_s, 0.49, false), 0);
    for (int i = 0; i < 2000; ++i) {
      const double was = follower.force();
      follower.update({rtt_s, 0, false}, 1e-3);
      ASSERT_GE(follower.force(), 0.79 * was) << "in contact, but not at once";
      ASSERT_LE(follower.force(), was);
    }
    EXPECT_EQ(run(follower, rtt_s, 5, false), 0);
    EXPECT_LT(follower.force(), before);
    // The oracle is the bound itself, at the very delay.
    ScalingPlant plant = session().plant;
    plant.delay_samples = loop_delay_samples(rtt_s, 1e-3);
    const double velocity = plan_scaling(session()).scaling.velocity;
    EXPECT_LE(velocity * follower.force(), exact_impedance_bound(plant)) << rtt_s;
    EXPECT_GE(velocity * follower.force(), 0.45 * exact_impedance_bound(plant))
        << "and not much weaker than need be";
  }
}

TEST(ScalingFollower, NeverRisesInContactAndComesBackAtRest) {
  ScalingFollower follower = following(session());
  const double first = follower.force();
  run(follower, 0.1, 3, false);
  const double low = follower.force();
  EXPECT_EQ(run(follower, 0.0005, 60, false), 0);
  EXPECT_EQ(follower.force(), low);
  EXPECT_EQ(run(follower, 0.0005, 2.9, true), 1) << "waited for the tip to be free";
  ScalingPlanInput then = session();
  then.plant.delay_samples = loop_delay_samples(0.0005, 1e-3);
  EXPECT_GE(follower.force(), first);
  EXPECT_NEAR(follower.force(), plan_scaling(then).scaling.force, 1e-9 * first);
}

TEST(ScalingFollower, AStallOrALittleMoreChangesNothing) {
  ScalingFollower follower = following(session(Method::kKs, 20));
  EXPECT_EQ(run(follower, 0.3, 0.4, false), 0) << "for too short a time";
  EXPECT_EQ(run(follower, 0.02, 10, true), 0);
  EXPECT_EQ(run(follower, 0.028, 10, true), 0);
  EXPECT_EQ(run(follower, 0.014, 10, true), 0);
  EXPECT_EQ(run(follower, -1, 10, true), 0) << "not known";
  // Jitter counts: what was planned for 20 ms does not do for 20 ms and 8 of jitter.
  EXPECT_GT(run(follower, 0.02, 1, false, 0.008), 0);
}

TEST(ScalingFollower, ALinkThatSwingsDoesNotMakeTheScaleSwing) {
  ScalingFollower follower = following(session());
  run(follower, 0.1, 3, true);
  int changes = 0;
  for (int i = 0; i < 50; ++i) {
    changes += run(follower, 0.1, 1, true);
    changes += run(follower, 0.08, 5, true);
  }
  EXPECT_EQ(changes, 0);
}

TEST(ScalingFollower, MethodsThatPayForTheirDelayKeepTheirScale) {
  for (const Method method :
       {Method::kKsClamp, Method::kTdpa, Method::kWave, Method::kTank, Method::kModel}) {
    ScalingFollower follower = following(session(method));
    EXPECT_FALSE(follower.follows());
    EXPECT_EQ(run(follower, 0.5, 10, true), 0);
  }
}

}  // namespace
}  // namespace telenano::control
