#include "telenano/master/view_model/pointer_hand.h"

#include <gtest/gtest.h>

#include <limits>

#include "telenano/master/device/haptic_device.h"

namespace telenano::view_model {
namespace {

constexpr double kHalf_m = 0.055;
constexpr double kBack_s = 0.35;

PointerHand made() {
  PointerHand hand(kHalf_m, kBack_s);
  hand.set_velocity_scale(1e-6);  // 1 mm of the hand is 1 nm of the tip
  return hand;
}

TEST(PointerHand, TheTipKeepsUpWithTheCursor) {
  PointerHand hand = made();
  // 40 px to the right and 10 px up where a pixel is 0.25 nm: 10 nm and 2.5 nm of the tip.
  hand.drag(40, -10, {Vec3::UnitX(), Vec3::UnitZ(), 0.25});
  EXPECT_NEAR(hand.hand_pos_h_m().x(), 10e-3, 1e-15);
  EXPECT_NEAR(hand.hand_pos_h_m().z(), 2.5e-3, 1e-15);
  hand.set_velocity_scale(2e-6);
  hand.drag(40, 0, {Vec3::UnitX(), Vec3::UnitZ(), 0.25});
  EXPECT_NEAR(hand.hand_pos_h_m().x(), 15e-3, 1e-15);
}

// A push of 30 nN at a half of 10 nN: against it the pointer goes four times as far as the tip; along it and
// across as far.
TEST(PointerHand, TheForceIsAWayThatThePointerMustGo) {
  const PointerHand::Axes axes{Vec3::UnitX(), Vec3::UnitZ(), 0.25};
  PointerHand hand = made();
  hand.resist({0, 0, 30}, 10);
  EXPECT_NEAR(hand.resistance(), 4, 1e-12);
  hand.drag(0, 40, axes);  // down, 10 nm of picture
  EXPECT_NEAR(hand.hand_pos_h_m().z(), -2.5e-3, 1e-15);
  hand.drag(40, -40, axes);
  EXPECT_NEAR(hand.hand_pos_h_m().z(), 7.5e-3, 1e-15);
  EXPECT_NEAR(hand.hand_pos_h_m().x(), 10e-3, 1e-15);
  // A pull holds on, the way up.
  hand = made();
  hand.resist({0, 0, -10}, 10);
  hand.drag(0, -40, axes);
  EXPECT_NEAR(hand.hand_pos_h_m().z(), 5e-3, 1e-15);
  // Never more than the pointer's own way, whatever the force is, and nothing moves by a force alone.
  for (const double force_nn : {0.0, 1e-300, 1e300, std::numeric_limits<double>::quiet_NaN(),
                                std::numeric_limits<double>::infinity()}) {
    hand = made();
    hand.resist({0, force_nn, force_nn}, 10);
    EXPECT_EQ(hand.hand_pos_h_m().norm(), 0) << force_nn;
    hand.drag(3, 4, axes);
    EXPECT_LE(hand.hand_pos_h_m().norm(), 5 * 0.25e-3 * (1 + 1e-12)) << force_nn;
  }
  hand.resist({0, 0, 30}, 0);
  EXPECT_EQ(hand.resistance(), 1);
}

TEST(PointerHand, TheWallsOfItsBoxAreToldFromTheTip) {
  PointerHand hand = made();
  hand.drag(40, -20, {Vec3::UnitX(), Vec3::UnitZ(), 0.25});  // 10 nm to the right, 5 up; 55 nm to each side
  EXPECT_LT((hand.wall_below_nm() - Vec3(-65, -55, -60)).norm(), 1e-9);
  EXPECT_LT((hand.wall_above_nm() - Vec3(45, 55, 50)).norm(), 1e-9);
}

TEST(PointerHand, GripsWhileHeldAndHalfASecondAfterTheWheel) {
  PointerHand hand = made();
  EXPECT_EQ(hand.buttons(0), 0u);
  hand.hold(true);
  hand.update(0);
  EXPECT_EQ(hand.buttons(0), static_cast<std::uint32_t>(device::kButtonDeadman));
  hand.hold(false);
  hand.update(1);
  EXPECT_EQ(hand.buttons(1), 0u);
  hand.update(2);
  hand.turn_wheel(-2, 0.5, 2);
  EXPECT_NEAR(hand.hand_pos_h_m().z(), -1e-3, 1e-15);
  EXPECT_EQ(hand.buttons(2 + 0.99 * kWheelGripS), static_cast<std::uint32_t>(device::kButtonDeadman));
  EXPECT_EQ(hand.buttons(2 + 1.01 * kWheelGripS), 0u);
  hand.clutch(true);
  EXPECT_EQ(hand.buttons(9), static_cast<std::uint32_t>(device::kButtonClutch));
}

// A grip while the hand is still on its way back would take the tip along.
TEST(PointerHand, ComesBackToTheMiddleBeforeANewGripCounts) {
  PointerHand hand = made();
  const PointerHand::Axes axes{Vec3::UnitX(), Vec3::UnitY(), 1};
  hand.hold(true);
  hand.update(0);
  hand.drag(30, 0, axes);
  hand.hold(false);
  hand.update(1);
  EXPECT_EQ(hand.hand_pos_h_m().norm(), 0);
  hand.hold(true);
  hand.update(1.1);
  hand.drag(30, 0, axes);
  EXPECT_EQ(hand.buttons(1.1), 0u);
  EXPECT_EQ(hand.hand_pos_h_m().norm(), 0) << "a drag that the tip does not follow";
  hand.update(1 + kBack_s + 0.01);
  hand.drag(30, 0, axes);
  EXPECT_NE(hand.buttons(1 + kBack_s + 0.01), 0u);
  EXPECT_NEAR(hand.hand_pos_h_m().x(), 0.03, 1e-15);
}

// The cursor goes on and the tip does not: a person has to be told, and how far it goes. α_v 1e-6 over 55 mm
// is 55 nm.
TEST(PointerHand, KnowsWhenItIsAtTheBorderOfItsBox) {
  PointerHand hand = made();
  const PointerHand::Axes axes{Vec3::UnitX(), Vec3::UnitZ(), 1};
  EXPECT_NEAR(hand.reach_nm(), 55, 1e-9);
  hand.hold(true);
  hand.update(0);
  hand.drag(54, 0, axes);
  EXPECT_FALSE(hand.at_border());
  hand.drag(2, 0, axes);
  EXPECT_TRUE(hand.at_border());
  hand.drag(-10, 0, axes);
  EXPECT_FALSE(hand.at_border());
  hand.drag(0, 100, axes);
  EXPECT_TRUE(hand.at_border()) << "downwards";
  hand.hold(false);
  hand.update(1);
  EXPECT_FALSE(hand.at_border());
}

TEST(PointerHand, StaysInItsBoxAndLetsGoWhenTold) {
  PointerHand hand = made();
  hand.hold(true);
  hand.update(0);
  hand.drag(1e9, 1e9, {Vec3::UnitX(), Vec3::UnitY(), 1});
  EXPECT_EQ(hand.hand_pos_h_m().x(), kHalf_m);
  EXPECT_EQ(hand.hand_pos_h_m().y(), -kHalf_m);
  hand.drag(1e308 * 10, 0, {Vec3::UnitX(), Vec3::UnitY(), 1});
  EXPECT_TRUE(is_finite(hand.hand_pos_h_m()));
  hand.set_velocity_scale(0);
  hand.drag(1, 1, {Vec3::UnitX(), Vec3::UnitY(), 1});
  EXPECT_TRUE(is_finite(hand.hand_pos_h_m()));
  hand.let_go();
  EXPECT_EQ(hand.buttons(0.1), 0u);
}

}  // namespace
}  // namespace telenano::view_model
