#include "telenano/common/control/method_choice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace telenano::control {
namespace {

constexpr double kT = 1e-3;

MethodCircumstances link(double rtt_ms, double jitter_ms = 0, bool at_rest = true) {
  return {1e-3 * rtt_ms, 1e-3 * jitter_ms, at_rest};
}

Method after(MethodChoice& choice, const MethodCircumstances& c, double seconds) {
  for (int k = 0; k < std::lround(seconds / kT); ++k) choice.update(c, kT);
  return choice.now();
}

TEST(MethodChoice, ASessionBeginsWithTheSampleWhereItIsNearAndWithThePlaneWhereItIsNot) {
  EXPECT_EQ(MethodChoice::at_start(link(0.05)), Method::kTank);
  EXPECT_EQ(MethodChoice::at_start(link(4)), Method::kTank);
  EXPECT_EQ(MethodChoice::at_start(link(4.1)), Method::kModel) << "between the limits: as before";
  EXPECT_EQ(MethodChoice::at_start(link(100)), Method::kModel);
  EXPECT_EQ(MethodChoice::at_start({}), Method::kModel) << "nothing is known of the link";
}

TEST(MethodChoice, JitterCountsFourTimes) {
  EXPECT_EQ(MethodChoice::at_start(link(1, 0.7)), Method::kTank);
  EXPECT_EQ(MethodChoice::at_start(link(1, 0.8)), Method::kModel);
}

TEST(MethodChoice, AChangeWaitsForASecondOfTheSameAndForAFreeTip) {
  MethodChoice choice(Method::kTank);
  EXPECT_EQ(after(choice, link(50), 0.9), Method::kTank);
  EXPECT_EQ(after(choice, link(1), 0.01), Method::kTank);
  EXPECT_EQ(after(choice, link(50), 0.9), Method::kTank) << "a second in one piece";
  EXPECT_EQ(after(choice, link(50, 0, false), 10), Method::kTank) << "not while something is felt";
  EXPECT_EQ(after(choice, link(50), 0.002), Method::kModel) << "but as soon as nothing is";
}

TEST(MethodChoice, BetweenTheLimitsNothingChangesEitherWay) {
  MethodChoice near(Method::kTank), far(Method::kModel);
  EXPECT_EQ(after(near, link(6), 10), Method::kTank);
  EXPECT_EQ(after(far, link(6), 10), Method::kModel);
  EXPECT_EQ(after(near, link(8.1), 1.1), Method::kModel);
  EXPECT_EQ(after(far, link(3.9), 1.1), Method::kTank);
}

TEST(MethodChoice, WhatIsNoNumberChangesNothing) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  for (const Method before : {Method::kTank, Method::kModel}) {
    MethodChoice choice(before);
    EXPECT_EQ(after(choice, {kNan, 0, true}, 3), before);
    EXPECT_EQ(after(choice, {1, kNan, true}, 3), before);
    EXPECT_EQ(after(choice, {kInfinite, 0, true}, 3), before);
    EXPECT_EQ(after(choice, {-1, 0, true}, 3), before);
  }
}

MethodCircumstances with_twin(double rtt_ms, bool at_rest = true, double jitter_ms = 0) {
  return {1e-3 * rtt_ms, 1e-3 * jitter_ms, at_rest, true};
}

TEST(MethodChoice, ATwinIsTheFirstChoiceAtAnyRoundTrip) {
  for (const double rtt_ms : {0.0, 4.0, 100.0, 500.0, 501.0, 600.0, 2500.0, 60'000.0})
    EXPECT_EQ(MethodChoice::at_start(with_twin(rtt_ms)), Method::kTwin) << rtt_ms;
  EXPECT_EQ(MethodChoice::at_start({-1, 0, true, true}), Method::kTwin) << "nothing is known of the link";
}

// A twin that is given up is gone in that tick, whatever is felt; the rule goes on from the model.
TEST(MethodChoice, AfterATwinThatIsGivenUpTheRoundTripDecides) {
  MethodChoice near(Method::kTwin), far(Method::kTwin);
  EXPECT_EQ(after(near, link(1, 0, false), kT), Method::kModel) << "at once";
  EXPECT_EQ(after(near, link(1, 0, false), 10), Method::kModel) << "a choice waits for a free tip";
  EXPECT_EQ(after(near, link(1), 1.1), Method::kTank);
  EXPECT_EQ(after(far, link(50), 10), Method::kModel);
}

TEST(MethodChoice, ATwinThatIsBackIsTakenUpAgainWhenNothingIsFelt) {
  MethodChoice choice(Method::kTank);
  EXPECT_EQ(after(choice, with_twin(1), 0.9), Method::kTank);
  EXPECT_EQ(after(choice, with_twin(1, false), 10), Method::kTank) << "not while something is felt";
  EXPECT_EQ(after(choice, with_twin(1), 0.002), Method::kTwin) << "but as soon as nothing is";
}

TEST(MethodChoice, ARoundTripThatGrowsEndsNoTwin) {
  MethodChoice choice(Method::kTwin);
  for (const double rtt_ms : {499.0, 600.0, 2500.0})
    EXPECT_EQ(after(choice, with_twin(rtt_ms), 10), Method::kTwin);
  EXPECT_EQ(after(choice, {-1, 0, true, true}, 10), Method::kTwin) << "not known: as before";
  MethodChoice back(Method::kModel);
  EXPECT_EQ(after(back, with_twin(600), 1.1), Method::kTwin) << "nor keeps it from coming back";
}

// An instrument's answer is late however near the instrument is: the newest reply is never its best.
TEST(MethodChoice, ASlaveThatMeasuresGetsThePlaneAtAnyRoundTrip) {
  for (const double rtt_ms : {0.05, 4.0, 6.0, 100.0, 600.0})
    EXPECT_EQ(MethodChoice::at_start({1e-3 * rtt_ms, 0, true, false, true}), Method::kModel) << rtt_ms;
  EXPECT_EQ(MethodChoice::at_start({-1, 0, true, false, true}), Method::kModel);
  MethodChoice choice(Method::kTank);  // a server that came back with an instrument behind it
  EXPECT_EQ(after(choice, {1e-3, 0, false, false, true}, 10), Method::kTank) << "not while something is felt";
  EXPECT_EQ(after(choice, {1e-3, 0, true, false, true}, 0.002), Method::kModel);
}

// What it chooses must keep the promise of energy: it acts without being asked.
TEST(MethodChoice, OnlyMethodsThatPromiseEnergy) {
  for (const double rtt_ms : {0.0, 1.0, 5.0, 20.0, 500.0})
    EXPECT_TRUE(claims_energy_bound(MethodChoice::at_start(link(rtt_ms))));
}

}  // namespace
}  // namespace telenano::control
