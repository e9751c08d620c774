#include "telenano/common/link/send_gate.h"

#include <gtest/gtest.h>

#include <cmath>

namespace telenano::link {
namespace {

constexpr std::int64_t kTickNs = 1'000'000;

Command at(double x_nm) {
  Command c;
  c.flags = kFlagClutch | kFlagDeadman;
  c.tip_pos_w_nm = {x_nm, 0, 0};
  return c;
}

TEST(SendGate, WithoutADeadbandEverythingIsSent) {
  SendGate gate({});
  for (int k = 0; k < 100; ++k) EXPECT_TRUE(gate.wants(at(1), Vec3::Zero(), k * kTickNs));
  EXPECT_EQ(gate.held(), 0u);
}

TEST(SendGate, SendsWhatSaysSomethingNew) {
  SendGate gate({0.5, 0.1, 10 * kTickNs});
  std::int64_t now_ns = 0;
  const auto wants = [&](const Command& c, double force_n = 0) {
    return gate.wants(c, Vec3(force_n, 0, 0), now_ns += kTickNs);
  };
  EXPECT_TRUE(wants(at(0))) << "the first";
  EXPECT_FALSE(wants(at(0)));
  EXPECT_FALSE(wants(at(0.5))) << "at the border";
  EXPECT_TRUE(wants(at(0.51)));
  EXPECT_FALSE(wants(at(0.6)));
  EXPECT_FALSE(wants(at(0.6), 0.1));
  EXPECT_TRUE(wants(at(0.6), 0.11)) << "a force that moves asks for the next";
  Command stop = at(0.6);
  stop.flags |= kFlagStop;
  EXPECT_TRUE(wants(stop, 0.11)) << "a stop never waits";
  EXPECT_FALSE(wants(stop, 0.11));
  stop.control.method = kMethodTank;
  EXPECT_TRUE(wants(stop, 0.11));
  gate.clear();
  EXPECT_TRUE(wants(stop, 0.11)) << "another session";
}

// With a twin the loop has a pace of its own: what goes by that is the last one sent too.
TEST(SendGate, WhatWasSentWithoutAskingCounts) {
  SendGate gate({0.5, 0, 10 * kTickNs});
  EXPECT_TRUE(gate.wants(at(0), Vec3::Zero(), kTickNs));
  gate.sent(at(3), Vec3::Zero(), 2 * kTickNs);
  EXPECT_FALSE(gate.wants(at(3.5), Vec3::Zero(), 3 * kTickNs));
  EXPECT_TRUE(gate.wants(at(0), Vec3::Zero(), 4 * kTickNs)) << "near the one before only";
}

TEST(SendGate, BeatsWhenNothingChangesAndBoundsTheError) {
  const SendGateConfig config{0.5, 0, 10 * kTickNs};
  SendGate gate(config);
  int sent = 0;
  for (int k = 0; k < 1000; ++k) sent += gate.wants(at(3), Vec3::Zero(), k * kTickNs) ? 1 : 0;
  EXPECT_EQ(sent, 100);
  // A slow sine: what the other side has is never further away than the deadband.
  double known_nm = 3, worst_nm = 0;
  for (int k = 1000; k < 11'000; ++k) {
    const double x_nm = 3 + 20 * std::sin(1e-3 * k);
    if (gate.wants(at(x_nm), Vec3::Zero(), k * kTickNs)) known_nm = x_nm;
    worst_nm = std::max(worst_nm, std::fabs(known_nm - x_nm));
  }
  EXPECT_LE(worst_nm, 0.5);
  EXPECT_GT(worst_nm, 0.05);
  EXPECT_GT(gate.held(), gate.asked() / 2);
}

}  // namespace
}  // namespace telenano::link
