#include "telenano/common/control/scaling_plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::control {
namespace {

// Rounding of a few operations; the bounds themselves are refined to 1e-9 (scaling.h).
constexpr double kRelative = 1e-8;

ScalingPlanInput omega() {
  ScalingPlanInput in;
  in.plant.device_damping_n_s_m = 2;
  in.plant.coupling_stiffness_n_m = 20;
  in.plant.period_s = 1e-3;
  in.tip_force_max_nn = 500;
  in.haptic_workspace_m = 0.1;
  in.visual_workspace_m = 0.3;
  in.nano_workspace_nm = 50;
  return in;
}

void expect_near(double value, double expected) {
  EXPECT_NEAR(value, expected, kRelative * expected);
}

TEST(ScalingPlan, VelocityScaleIsTheRatioOfWorkspaces) {
  const ScalingPlan plan = plan_scaling(omega());
  expect_near(plan.haptic_to_visual, 1.0 / 3);
  expect_near(plan.visual_to_nano, 6e6);
  expect_near(plan.scaling.velocity, 5e-7);  // 50 nm / 0.1 m; the picture cancels
  expect_near(plan.case_one_force_scale, 2e6);
  expect_near(plan.case_two_force_scale, 4e12);
}

// Pure spring of the coupling: published 8b/(k T) = 800, exact 2b/(k T) = 200, d samples 2b/((d+1)² k T).
TEST(ScalingPlan, BoundsAreTheClosedForms) {
  for (const int d : {0, 1, 5, 20}) {
    ScalingPlanInput in = omega();
    in.plant.delay_samples = d;
    const ScalingPlan plan = plan_scaling(in);
    expect_near(plan.published_force_scale, 800 / 5e-7);
    expect_near(plan.sampled_force_scale, 200 / 5e-7);
    expect_near(plan.delayed_force_scale, 200.0 / ((d + 1) * (d + 1)) / 5e-7);
    expect_near(plan.device_force_scale, 0.8 * 12 / 500e-9);
    expect_near(plan.passive_wall_n_m, 4000);
    expect_near(plan.delayed_wall_n_m, 4000.0 / (1 + 2 * d));  // CB's wall, b > (1 + 2d)KT/2
  }
}

TEST(ScalingPlan, RecommendsTheLargestOfTheRegionAndSaysWhatBinds) {
  // Device: 1.92e7. Passive: 4e8/(d+1)²: binds from (d+1)² > 20.8 on, d = 4.
  for (const int d : {0, 1, 3, 4, 50}) {
    ScalingPlanInput in = omega();
    in.plant.delay_samples = d;
    const ScalingPlan plan = plan_scaling(in);
    const double passive = 4e8 / ((d + 1) * (d + 1));
    const double largest = d < 4 ? 1.92e7 : passive;
    EXPECT_EQ(plan.binding, d < 4 ? BindingLimit::kDevice : BindingLimit::kPassivity) << d;
    expect_near(plan.scaling.force, 0.99 * largest);
    expect_near(plan.shown_stiffness_n_m, 0.99 * largest * 5e-7 * 20);
    expect_near(plan.felt_force_max_n, 0.99 * largest * 500e-9);
    EXPECT_EQ(plan.case_one_safe, largest >= 2e6) << d;
    EXPECT_FALSE(plan.case_two_safe);
    const std::string reason = plan_reason(in, plan);
    EXPECT_NE(reason.find(d < 4 ? "the device's force binds" : "passivity binds"), std::string::npos);
    EXPECT_LE(plan.scaling.impedance(), exact_impedance_bound(in.plant));
  }
}

// A method that bounds its own energy is planned at one tick whatever the way: 4e8/4 passive, so that the
// device binds; at no delay as it is.
TEST(ScalingPlan, TheDelayOfTheWayBindsOnlyMethodsThatRestOnTheLoop) {
  for (const Method method : {Method::kNone, Method::kKs, Method::kKsClamp, Method::kTdpa, Method::kWave,
                              Method::kTank, Method::kModel}) {
    const bool rests = method == Method::kNone || method == Method::kKs;
    for (const int d : {0, 1, 2, 50}) EXPECT_EQ(binding_delay_samples(method, d), rests ? d : std::min(d, 1));
    ScalingPlanInput in = omega();
    in.method = method;
    in.plant.delay_samples = 50;
    const ScalingPlan plan = plan_scaling(in);
    EXPECT_EQ(plan.binding_delay_samples, rests ? 50 : 1);
    expect_near(plan.delayed_force_scale, 4e8 / (51 * 51));
    expect_near(plan.passive_force_scale, rests ? 4e8 / (51 * 51) : 1e8);
    EXPECT_EQ(plan.binding, rests ? BindingLimit::kPassivity : BindingLimit::kDevice);
    expect_near(plan.scaling.force, 0.99 * (rests ? 4e8 / (51 * 51) : 1.92e7));
  }
}

// Four times as stiff without delay, 4e8 instead of 1e8, less by the device's latency, and only for the twin; what
// nobody measured is taken for a sample, and a latency beyond a sample counts for all.
TEST(ScalingPlan, TheTwinsForceWaitsForTheDeviceAloneWhereThatWasMeasured) {
  ScalingPlanInput in = omega();
  in.device_force_max_n = 1000;  // lest it bind
  in.plant.delay_samples = 50;
  const auto force = [&in](Method method, double latency_s) {
    in.method = method;
    in.device_latency_s = latency_s;
    return plan_scaling(in).passive_force_scale;
  };
  expect_near(force(Method::kTwin, -1), 1e8);
  expect_near(force(Method::kTwin, 0), 4e8);
  expect_near(force(Method::kTwin, 1e-3), 1e8);
  expect_near(force(Method::kTwin, 0.25e-3), 1 / (0.75 / 4e8 + 0.25 / 1e8));
  expect_near(force(Method::kTwin, 2e-3), 4e8 / 9);
  for (const Method method : {Method::kModel, Method::kTank, Method::kKsClamp}) {
    for (const double latency_s : {-1.0, 0.0, 0.5e-3, 1e-3}) expect_near(force(method, latency_s), 1e8);
    expect_near(force(method, 2e-3), 4e8 / 9);
  }
  for (const double latency_s : {-1.0, 0.0, 2e-3})
    expect_near(force(Method::kKs, latency_s), 4e8 / (51 * 51));
  in.method = Method::kTwin;
  in.device_latency_s = 0.25e-3;
  const std::string reason = plan_reason(in, plan_scaling(in));
  EXPECT_NE(reason.find("0.25 samples of delay"), std::string::npos) << reason;
  EXPECT_NE(reason.find("planned for the twin alone"), std::string::npos) << reason;
}

TEST(ScalingPlan, AGivenVelocityScaleIsKept) {
  ScalingPlanInput in = omega();
  in.velocity_scale = 1e-4;
  const ScalingPlan plan = plan_scaling(in);
  EXPECT_EQ(plan.scaling.velocity, 1e-4);
  expect_near(plan.delayed_force_scale, 200 / 1e-4);
  expect_near(plan.case_one_force_scale, 1e4);
  expect_near(plan.scaling.force, 0.99 * 200 / 1e-4);
}

// d = 200: α_F = 4e8/201² = 9.9e3, and 500 nN of it are 5 mN.
TEST(ScalingPlan, SaysWhereALongDelayLeavesNothingToFeel) {
  ScalingPlanInput in = omega();
  in.plant.delay_samples = 200;
  const ScalingPlan plan = plan_scaling(in);
  EXPECT_TRUE(plan.too_weak_to_feel);
  expect_near(plan.felt_force_max_n, 0.99 * 4e8 / (201 * 201) * 500e-9);
  const std::string reason = plan_reason(in, plan);
  EXPECT_NE(reason.find("nothing that could be felt is safe"), std::string::npos) << reason;
  EXPECT_NE(reason.find("200 samples"), std::string::npos) << reason;
  in.plant.delay_samples = 20;  // 0.45 N
  EXPECT_FALSE(plan_scaling(in).too_weak_to_feel);
}

// α_v = 1/2: 1/α_v² = 4 lies below 2b/(kT)/α_v = 400 and below the device's limit.
TEST(ScalingPlan, CaseTwoIsAChoiceWhereTheScaleIsNear) {
  ScalingPlanInput in = omega();
  in.nano_workspace_nm = 0.05e9;
  const ScalingPlan plan = plan_scaling(in);
  EXPECT_TRUE(plan.case_one_safe);
  EXPECT_TRUE(plan.case_two_safe);
}

// The adaptive damper is sampled too: from γ = b on nothing is safe.
TEST(ScalingPlan, NothingIsSafeWithoutDampingOfTheDevice) {
  ScalingPlanInput in = omega();
  in.plant.adaptive_damping_n_s_m = 2.5;
  const ScalingPlan plan = plan_scaling(in);
  EXPECT_EQ(plan.binding, BindingLimit::kNothing);
  EXPECT_EQ(plan.scaling.force, 0);
  EXPECT_EQ(plan.delayed_force_scale, 0);
  EXPECT_NE(plan_reason(in, plan).find("no force scale is safe"), std::string::npos);
  in = omega();
  in.plant.device_damping_n_s_m = 0;
  const ScalingPlan bare = plan_scaling(in);
  EXPECT_EQ(bare.binding, BindingLimit::kNothing);
  EXPECT_EQ(bare.scaling.force, 0);
  EXPECT_EQ(bare.passive_wall_n_m, 0);
  EXPECT_EQ(bare.delayed_wall_n_m, 0);
  EXPECT_NE(plan_reason(in, bare).find("only damping of the device itself"), std::string::npos);
}

TEST(ScalingPlan, DelayOfALinkInSamples) {
  EXPECT_EQ(loop_delay_samples(0, 1e-3), 1);
  EXPECT_EQ(loop_delay_samples(1e-4, 1e-3), 1);
  EXPECT_EQ(loop_delay_samples(1e-3, 1e-3), 1);
  EXPECT_EQ(loop_delay_samples(1.1e-3, 1e-3), 2);
  EXPECT_EQ(loop_delay_samples(0.02, 1e-3), 20);
  EXPECT_EQ(loop_delay_samples(0.003, 0.00025), 12);
  EXPECT_EQ(loop_delay_samples(NAN, 1e-3), 1);
  EXPECT_EQ(loop_delay_samples(1e9, 1e-3), 10'000);
}

TEST(ScalingPlan, RefusesNonsense) {
  const auto message = [](auto change) {
    ScalingPlanInput in = omega();
    change(in);
    try {
      plan_scaling(in);
    } catch (const UserError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  const auto names = [&](const char* name, auto change) {
    EXPECT_NE(message(change).find(name), std::string::npos) << name << ": " << message(change);
  };
  names("tip force = 0", [](auto& in) { in.tip_force_max_nn = 0; });
  names("coupling stiffness", [](auto& in) { in.plant.coupling_stiffness_n_m = 0; });
  names("coupling damping", [](auto& in) { in.plant.coupling_damping_n_s_m = -1; });
  names("device damping = nan", [](auto& in) { in.plant.device_damping_n_s_m = std::nan(""); });
  names("adaptive damping", [](auto& in) { in.plant.adaptive_damping_n_s_m = -1; });
  names("period", [](auto& in) { in.plant.period_s = 0; });
  names("delay", [](auto& in) { in.plant.delay_samples = -1; });
  names("device force", [](auto& in) { in.device_force_max_n = INFINITY; });
  names("force safety", [](auto& in) { in.force_safety = 1.5; });
  names("haptic workspace", [](auto& in) { in.haptic_workspace_m = 0; });
  names("visual workspace", [](auto& in) { in.visual_workspace_m = -1; });
  names("nano workspace", [](auto& in) { in.nano_workspace_nm = 0; });
  names("velocity scale", [](auto& in) { in.velocity_scale = std::nan(""); });
  names("velocity scale = 2", [](auto& in) { in.velocity_scale = 2; });
  names("velocity scale = 10,", [](auto& in) { in.nano_workspace_nm = 1e9; });
}

}  // namespace
}  // namespace telenano::control
