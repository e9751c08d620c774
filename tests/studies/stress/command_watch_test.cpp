#include "tests/studies/stress/command_watch.h"

#include <gtest/gtest.h>

namespace telenano::studies::stress {
namespace {

/// A target that goes down by 0.1 nm a tick.
struct Sending {
  explicit Sending(const CommandWatch::Limits& limits = {}) : watch(limits) { now.has_session = true; }
  void tick(bool sent) {
    now.time_s += 1e-3;
    now.target_w_nm.z() -= 0.1;
    now.sent = sent;
    watch.look(now);
  }
  CommandWatch watch;
  CommandWatch::Tick now;
};

TEST(CommandWatch, WithoutADeadbandEachTickIsSent) {
  Sending every;
  for (int k = 0; k < 50; ++k) every.tick(true);
  EXPECT_TRUE(every.watch.tells());
  every.tick(false);
  EXPECT_FALSE(every.watch.tells());
  Sending none;
  none.now.has_session = false;
  for (int k = 0; k < 50; ++k) none.tick(false);
  EXPECT_TRUE(none.watch.tells()) << "without a session nothing can be sent";
}

TEST(CommandWatch, ADeadbandHoldsBackWhatIsWithinItAndForNoLongerThanTheHeartbeat) {
  CommandWatch::Limits limits;
  limits.deadband_nm = 0.35;
  Sending right(limits);
  for (int k = 0; k < 40; ++k) right.tick(k % 4 == 0);
  EXPECT_TRUE(right.watch.tells());
  Sending coarse(limits);
  for (int k = 0; k < 40; ++k) coarse.tick(k % 5 == 0);
  EXPECT_FALSE(coarse.watch.tells());
  limits.deadband_nm = 100;
  Sending late(limits);
  for (int k = 0; k < 40; ++k) late.tick(k % 10 == 0);
  EXPECT_TRUE(late.watch.tells());
  for (int k = 0; k < 12; ++k) late.tick(k == 0);
  EXPECT_FALSE(late.watch.tells());
  limits.deadband_n = 0.1;
  Sending force(limits);
  force.tick(true);
  force.now.force_h_n.x() = 0.09;
  force.tick(false);
  EXPECT_TRUE(force.watch.tells());
  force.now.force_h_n.x() = 0.11;
  force.tick(false);
  EXPECT_FALSE(force.watch.tells());
}

TEST(CommandWatch, ATwinHasItsPace) {
  Sending twin;
  twin.now.twin = true;
  for (int k = 0; k < 40; ++k) twin.tick(k % 10 == 0);
  EXPECT_TRUE(twin.watch.tells());
  for (int k = 0; k < 11; ++k) twin.tick(false);
  EXPECT_FALSE(twin.watch.tells());
}

TEST(CommandWatch, TheSlaveGoesWhereItWasSentInOrder) {
  Sending lost;
  for (int k = 0; k < 100; ++k) lost.tick(true);
  for (const double z_nm : {0.1, 0.1, 0.2, 5.0, 5.1}) {
    // As the sums come out, which are not whole tenths.
    double sent_nm = 0;
    while (sent_nm > -z_nm + 0.05) sent_nm -= 0.1;
    lost.watch.follows({0, 0, sent_nm});
  }
  EXPECT_TRUE(lost.watch.keeps_to_the_path());
  lost.watch.follows({0, 0, -0.1});
  EXPECT_FALSE(lost.watch.keeps_to_the_path()) << "back";
  Sending elsewhere;
  elsewhere.tick(true);
  elsewhere.watch.follows({0, 0, -0.05});
  EXPECT_FALSE(elsewhere.watch.keeps_to_the_path());
}

}  // namespace
}  // namespace telenano::studies::stress
