// Replies that are left out: what server and station agree on, what is left out, and how both count it.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::DropCause;
using link::kFeatureReplyDeadband;
using link::kFeatureStepLog;

/// A session that is up, at a floor that the tip presses 3 nm deep.
struct Pressed {
  explicit Pressed(std::uint64_t asked = link::kKnownFeatures, std::uint64_t granted = link::kKnownFeatures,
                   const net::SimPath& up = {}, const net::SimPath& down = {}, std::uint64_t seed = 1)
      : server(config(granted), spring_scene(&slave)) {
    link::ClientConfig client;
    client.feature_bits = asked;
    s = std::make_unique<VirtualSession>(&server, client, up, down, seed);
    s->client.start(0);
    s->ticks(50);
    s->command.reply_deadband = {1000, 100};  // 1 nN, 10 %
  }
  static ServerConfig config(std::uint64_t granted) {
    ServerConfig c = test_config();
    c.feature_bits = granted;
    return c;
  }
  const link::Session& session() const { return server.sessions()[s->client.welcome().session_id & 0xff]; }

  SpringSlave* slave = nullptr;
  Server server;
  std::unique_ptr<VirtualSession> s;
};

TEST(RepliesLeftOut, LeavesOutFiveOfSixWhileNothingChanges) {
  Pressed p;
  p.s->ticks(1);  // another deadband than before is answered
  const link::Reply before = p.s->client.reply();
  const std::uint64_t steps = p.slave->steps;
  p.s->ticks(600);
  EXPECT_EQ(p.slave->steps - steps, 600u) << "every command is followed";
  EXPECT_EQ(p.s->client.reply().sequence - before.sequence, 100u);
  EXPECT_EQ(p.server.counters().left_out, 500u);
  EXPECT_EQ(p.server.counters().exchanges + 1, p.s->client.commands_sent()) << "one is on its way";
  const link::LinkQuality q = p.s->client.quality(p.s->now_ns);
  EXPECT_GE(q.replies_left_out, 495u);
  EXPECT_EQ(q.commands_lost + q.replies_lost, 0u);
  EXPECT_EQ(p.s->client.drops().total() + p.server.drops().total(), 0u);
  // 1.1 nN more or less: at once, wherever in the six it falls.
  for (int i = 1; i <= 12; ++i) {
    const double depth_nm = i % 2 == 0 ? 3 : 4.1;
    p.s->command.tip_pos_w_nm.z() = -depth_nm;
    p.s->ticks(2);
    EXPECT_EQ(p.s->client.reply().force_w_nn.z(), depth_nm);
    p.s->ticks(i);
  }
  // And all of them again where the station asks for none.
  p.s->command.reply_deadband = {};
  p.s->ticks(2);
  const std::uint64_t left_out = p.server.counters().left_out;
  p.s->ticks(100);
  EXPECT_EQ(p.server.counters().left_out, left_out);
}

TEST(RepliesLeftOut, IsAgreedWithoutALogOfStepsOnly) {
  constexpr std::uint64_t kPrivate =
      link::kKnownFeatures & ~std::uint64_t{link::kFeatureSharing | link::kFeatureSharedLog};
  constexpr std::uint64_t kBoth = kFeatureReplyDeadband | kFeatureStepLog;
  const auto granted = [](std::uint64_t wanted) {
    return link::ServerHandshake::granted(wanted, kPrivate) & kBoth;
  };
  EXPECT_EQ(granted(kPrivate), std::uint64_t{kFeatureStepLog});
  EXPECT_EQ(granted(kPrivate & ~std::uint64_t{kFeatureStepLog}), std::uint64_t{kFeatureReplyDeadband});
  EXPECT_EQ(granted(kFeatureReplyDeadband), std::uint64_t{kFeatureReplyDeadband});
}

TEST(RepliesLeftOut, AnOldPeerOnEitherSideHasEveryCommandAnswered) {
  constexpr std::uint64_t kOld = link::kKnownFeatures & ~std::uint64_t{kFeatureReplyDeadband};
  for (const auto& [asked, granted] :
       {std::pair{kOld, link::kKnownFeatures}, std::pair{link::kKnownFeatures, kOld}}) {
    Pressed p(asked, granted);
    EXPECT_EQ(p.s->client.features() & kFeatureReplyDeadband, 0u);
    p.s->ticks(200);
    EXPECT_EQ(p.server.counters().left_out, 0u);
    EXPECT_EQ(p.s->client.reply().replies_left_out, 0u);
    EXPECT_EQ(p.session().reply_sequence + 1, p.s->client.commands_sent()) << "one is on its way";
    EXPECT_EQ(p.server.drops().total() + p.s->client.drops().total(), 0u);
    // Who sends the field nevertheless.
    link::Command c = p.s->command;
    c.session_id = p.s->client.welcome().session_id;
    c.epoch = p.s->client.welcome().epoch;
    c.sequence = 1000;
    link::Codec codec;
    const std::size_t n = codec.encode(c, p.s->buffer);
    p.server.on_datagram({p.s->buffer.data(), n}, p.s->link.address_a(), p.s->now_ns, p.s->answer);
    EXPECT_EQ(p.server.drops()[DropCause::kUnexpected], 1u);
  }
}

TEST(RepliesLeftOut, AReplyThatCountsMoreThanThereWereIsDropped) {
  Pressed p;
  p.s->ticks(100);
  link::Codec codec;
  const auto hear = [&](std::uint64_t left_out) {
    link::Reply r = p.s->client.reply();
    link::Command c = p.s->command;
    p.s->client.make_command(c, p.s->now_ns, p.s->buffer);
    r.sequence += 1;
    r.command_sequence = c.sequence;
    r.replies_left_out = left_out;
    const std::size_t n = codec.encode(r, p.s->buffer);
    const std::uint64_t dropped = p.s->client.drops()[DropCause::kOutOfRange];
    p.s->client.on_datagram({p.s->buffer.data(), n}, p.s->now_ns);
    return p.s->client.drops()[DropCause::kOutOfRange] == dropped;
  };
  const auto commands_before = [&] {
    return p.s->client.commands_sent() + 1 - (p.s->client.reply().sequence + 1);
  };
  EXPECT_FALSE(hear(commands_before() + 1));
  EXPECT_FALSE(hear(UINT64_MAX));
  EXPECT_TRUE(hear(commands_before())) << "none was lost";
  EXPECT_EQ(p.s->client.quality(p.s->now_ns).commands_lost, 0u);
}

// What the link has lost is what both sides count, and nothing else; whether replies are left out or not.
TEST(RepliesLeftOut, CountsAreThoseOfTheLink) {
  net::SimPath up, down;
  up.delay_ns = 2'000'000;
  down.delay_ns = 3'000'000;
  Pressed p(link::kKnownFeatures, link::kKnownFeatures, up, down, 5);
  p.s->ticks(200);
  ASSERT_EQ(p.s->client.state(), link::ClientState::kEstablished);
  p.s->link.path_a_to_b().loss = 0.05;
  p.s->link.path_b_to_a().loss = 0.10;
  p.s->link.path_b_to_a().duplicate = 0.02;
  double phase = 0;
  p.s->before_end_of_tick = [&] { p.s->command.tip_pos_w_nm.z() = -5 + 3 * std::sin(phase += 0.01); };
  p.s->ticks(30'000);
  p.s->link.path_a_to_b() = up;
  p.s->link.path_b_to_a() = down;
  p.s->ticks(100);
  const link::LinkQuality q = p.s->client.quality(p.s->now_ns);
  EXPECT_EQ(q.commands_lost, p.s->link.counts_a_to_b().lost);
  EXPECT_GT(q.commands_lost, 1'300u);
  EXPECT_EQ(q.replies_lost, p.s->link.counts_b_to_a().lost);
  EXPECT_GT(q.replies_lost, 300u);
  EXPECT_EQ(q.duplicates, p.s->link.counts_b_to_a().duplicated);
  EXPECT_GT(q.replies_left_out, 15'000u);
  EXPECT_EQ(p.server.counters().exchanges, p.session().reply_sequence + p.server.counters().left_out);
  EXPECT_NEAR(q.rtt_us, 5000, 100);
  EXPECT_LT(q.force_age_ms, 3 + 7) << "the way back and the longest gap";
  // Another session of the same station begins to count anew.
  p.s->link.path_a_to_b().down = true;
  p.s->ticks(3000);
  p.s->link.path_a_to_b().down = false;
  p.s->ticks(1500);
  ASSERT_EQ(p.s->client.sessions(), 2u);
  EXPECT_GT(p.s->client.reply().replies_left_out, 100u);
  EXPECT_LT(p.s->client.reply().replies_left_out, 1500u);
  const std::uint64_t before =
      p.s->client.quality(p.s->now_ns).replies_left_out - p.s->client.reply().replies_left_out;
  EXPECT_TRUE(before >= q.replies_left_out && before <= q.replies_left_out + 10) << before;
}

}  // namespace
}  // namespace telenano::server
