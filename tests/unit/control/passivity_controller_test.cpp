#include "telenano/common/control/passivity_controller.h"

#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/base/error.h"
#include "tests/support/watched_controller.h"

namespace telenano::control {
namespace {

using support::WatchedController;

constexpr double kT = 1e-3;

PassivityConfig config_of(Method method) {
  PassivityConfig config;
  config.method = method;
  return config;
}

TEST(Method, NamesAreReadBack) {
  for (Method method : kAllMethods) EXPECT_EQ(parse_method(method_name(method)), method);
}

TEST(Method, UnknownNamesAreRefusedByName) {
  for (const char* name : {"KS", "", "passive"}) {
    try {
      parse_method(name);
      FAIL() << name;
    } catch (const UserError& error) {
      EXPECT_NE(std::string(error.what()).find("'" + std::string(name) + "'"), std::string::npos);
      EXPECT_NE(std::string(error.what()).find("ks-clamp, tdpa"), std::string::npos);
    }
  }
}

TEST(Ks, FollowsThePublishedEquationsStepByStep) {
  WatchedController controller(config_of(Method::kKs));
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(2, 0, 0), Vec3(1e-3, 0, 0), kT);  // the port pushes 2 N over 1 mm: E(1) = −2 mJ
  EXPECT_NEAR(controller.account_j(), -2e-3, 1e-18);
  EXPECT_EQ(controller.damper_n_s_m(), 0);                    // acts on E(k−1), which was 0
  controller.observe(Vec3(1, 0, 0), Vec3(1.5e-3, 0, 0), kT);  // E(2) = −2 − 0.5 + 2 (credited at once)
  EXPECT_NEAR(controller.damper_n_s_m(), 2e-3 * kT / (0.5e-3 * 0.5e-3), 1e-9);  // −E T/Δx² = 8 N·s/m, no cap
  EXPECT_NEAR(controller.damper_force_h_n().x(), -2e-3 / 0.5e-3, 1e-9);         // against the motion
  EXPECT_NEAR(controller.account_j(), -0.5e-3, 1e-15);
  // The damper's work in the next interval is in the applied force and is counted a second time.
  controller.observe(Vec3(-4, 0, 0), Vec3(2.0e-3, 0, 0), kT);
  EXPECT_NEAR(controller.account_j(), -0.5e-3 + 2e-3 + 0.5e-3, 1e-15);
  EXPECT_GT(controller.account_j(), controller.observer().energy_j());
}

TEST(Ks, CannotActWithoutMotion) {
  WatchedController controller(config_of(Method::kKs));
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(2, 0, 0), Vec3(1e-3, 0, 0), kT);
  controller.observe(Vec3(2, 0, 0), Vec3(1e-3, 0, 0), kT);
  EXPECT_EQ(controller.damper_n_s_m(), 0);
  EXPECT_NEAR(controller.account_j(), -2e-3, 1e-18);
}

TEST(KsClamp, DamperIsCappedAndTheRestIsCarried) {
  PassivityConfig config = config_of(Method::kKsClamp);
  config.damping_certain_n_s_m = 2;
  config.shown_stiffness_n_m = 1000;
  config.shown_damping_n_s_m = 0.3;
  WatchedController controller(config);
  EXPECT_NEAR(controller.damper_cap_n_s_m(), 2 - 0.5 - 0.3, 1e-15);
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(8, 0, 0), Vec3(0.5e-3, 0, 0), kT);
  EXPECT_NEAR(controller.damper_n_s_m(), 1.2, 1e-15);
  EXPECT_NEAR(controller.damper_force_h_n().x(), -1.2 * 0.5, 1e-12);
  // Deficit 4 mJ less the certain loss b Δx²/T = 0.5 mJ; nothing is credited for the damper itself.
  EXPECT_NEAR(controller.account_j(), -4e-3 + 0.5e-3, 1e-15);
}

TEST(KsClamp, DamperDoesNothingWhereTheWallIsTooStiff) {
  PassivityConfig config = config_of(Method::kKsClamp);
  config.damping_certain_n_s_m = 2;
  config.shown_stiffness_n_m = 4001;  // > 2b/T
  WatchedController controller(config);
  EXPECT_EQ(controller.damper_cap_n_s_m(), 0);
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(8, 0, 0), Vec3(0.5e-3, 0, 0), kT);
  EXPECT_EQ(controller.damper_force_h_n().norm(), 0);
  EXPECT_LT(controller.force_bound_n(), 0.010 / (0.5 * kT));  // but the clamp does
}

TEST(KsClamp, BoundFollowsTheAccount) {
  WatchedController controller(config_of(Method::kKsClamp));
  EXPECT_NEAR(controller.force_bound_n(), 0.010 / (0.5 * kT), 1e-12);  // 20 N from the allowance alone
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(-4, 0, 0), Vec3(1e-3, 0, 0), kT);  // the hand puts in 4 mJ
  EXPECT_NEAR(controller.force_bound_n(), 0.014 / (0.5 * kT), 1e-12);
  controller.observe(Vec3(20, 0, 0), Vec3(3e-3, 0, 0), kT);  // and takes 40 mJ, faster than v_max
  EXPECT_EQ(controller.force_bound_n(), 0);
}

TEST(KsClamp, CertainLossRepaysADeficitAndNoMore) {
  PassivityConfig config = config_of(Method::kKsClamp);
  config.damping_certain_n_s_m = 2;
  WatchedController controller(config);
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  double pos_m = 0;
  for (int k = 0; k < 100; ++k) controller.observe(Vec3::Zero(), Vec3(pos_m += 4e-4, 0, 0), kT);
  EXPECT_EQ(controller.account_j(), 0);  // free motion earns nothing
  controller.observe(Vec3(1, 0, 0), Vec3(pos_m += 4e-4, 0, 0), kT);
  const double deficit_j = 4e-4 - 2 * 4e-4 * 4e-4 / kT;
  EXPECT_NEAR(controller.account_j(), -deficit_j, 1e-15);
  controller.observe(Vec3::Zero(), Vec3(pos_m += 4e-4, 0, 0), kT);
  EXPECT_EQ(controller.account_j(), 0);
}

TEST(KsClamp, AFlickeringDigitEarnsNoCredit) {
  PassivityConfig config = config_of(Method::kKsClamp);
  config.damping_certain_n_s_m = 2;
  config.position_quantum_m = 1e-5;
  WatchedController controller(config);
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(5, 0, 0), Vec3(2e-4, 0, 0), kT);
  const double deficit_j = controller.account_j();
  ASSERT_LT(deficit_j, 0);
  for (int k = 0; k < 10'000; ++k) controller.observe(Vec3::Zero(), Vec3(2e-4 + 1e-5 * (k % 2), 0, 0), kT);
  EXPECT_EQ(controller.account_j(), deficit_j);
}

TEST(KsClamp, CreditNeverExceedsTheTrueLossOfAQuantisedDevice) {
  PassivityConfig config = config_of(Method::kKsClamp);
  config.damping_certain_n_s_m = 2;
  config.position_quantum_m = 1e-5;
  WatchedController controller(config);
  double truth_j = 0;
  for (int k = 0; k <= 20'000; ++k) {
    const double pos_m = 2e-3 * std::sin(2 * M_PI * 25 * k * kT) + 1e-2 * std::sin(2 * M_PI * 0.3 * k * kT);
    const double speed = 2e-3 * 2 * M_PI * 25 * std::cos(2 * M_PI * 25 * k * kT) +
                         1e-2 * 2 * M_PI * 0.3 * std::cos(2 * M_PI * 0.3 * k * kT);
    controller.observe(Vec3(50 * (k % 2 ? 1 : -1) * (speed > 0 ? 1 : -1), 0, 0),
                       Vec3(std::floor(pos_m / 1e-5 + 0.5) * 1e-5, 0, 0), kT);
    truth_j += 2 * speed * speed * kT;
  }
  EXPECT_LE(controller.credit_j(), truth_j);
  EXPECT_GT(controller.credit_j(), 0.1 * truth_j);  // and it is worth having
}

TEST(KsClamp, ATinyMotionMakesNoNaN) {
  for (Method method : {Method::kKs, Method::kKsClamp}) {
    WatchedController controller(config_of(method));
    controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
    controller.observe(Vec3(12, 0, 0), Vec3(1e-3, 0, 0), kT);
    controller.observe(Vec3(12, 0, 0), Vec3(1e-3, 1e-170, 0), kT);
    EXPECT_TRUE(is_finite(controller.damper_force_h_n()));
  }
}

TEST(None, OnlyWatches) {
  WatchedController controller(config_of(Method::kNone));
  controller.observe(Vec3::Zero(), Vec3::Zero(), kT);
  controller.observe(Vec3(12, 0, 0), Vec3(1e-2, 0, 0), kT);
  EXPECT_NEAR(controller.account_j(), -0.12, 1e-15);
  EXPECT_EQ(controller.damper_force_h_n().norm(), 0);
  EXPECT_TRUE(std::isinf(controller.force_bound_n()));
}

}  // namespace
}  // namespace telenano::control
