#include "tests/studies/stress/reply_watch.h"

#include <gtest/gtest.h>

#include <array>

namespace telenano::studies::stress {
namespace {

/// A slave of 100 nN, whose reply leaves; then a command that is not answered, and what the slave does by then.
struct Exchange {
  Exchange() {
    slave.force_w_nn = Vec3(0, 0, 100);
    slave.touches = true;
    slave.energy_in_aj = 7;
    slave.energy_out_aj = 3;
    reply.session_id = 5;
    reply.sequence = reply.command_sequence = 1;
    reply.epoch = 1;
    reply.force_w_nn = slave.force_w_nn;
    reply.contact_state = link::ContactState::kContact;
    reply.energy_in_aj = 7;
    reply.energy_out_aj = 3;
  }
  bool leaves() {
    link::Codec codec;
    std::array<std::uint8_t, link::kMaxDatagramBytes> bytes;
    const std::size_t size = codec.encode(reply, bytes);
    EXPECT_GT(size, 0u);
    watch.leaves(std::span(bytes).first(size), slave);
    return watch.is_true(slave, ++exchanges, kNPerNn);
  }
  bool is_left_out() { return watch.is_true(slave, ++exchanges, kNPerNn); }

  static constexpr double kNPerNn = 0.01;
  ReplyWatch watch{100, 0.02};  // 10 %, 2 nN
  SlaveWatch slave;
  link::Reply reply;
  std::uint64_t exchanges = 0;
};

TEST(Invariants, AReplyThatIsLeftOutThoughItSaysSomethingIsFlagged) {
  const auto flagged = [](auto&& change) {
    Exchange e;
    EXPECT_TRUE(e.leaves());
    change(e);
    return !e.is_left_out();
  };
  EXPECT_FALSE(flagged([](Exchange&) {}));
  EXPECT_FALSE(flagged([](Exchange& e) { e.slave.force_w_nn.z() = 109.9; }));
  EXPECT_TRUE(flagged([](Exchange& e) { e.slave.force_w_nn.z() = 110.1; }));
  EXPECT_TRUE(flagged([](Exchange& e) { e.slave.force_w_nn.x() = -10.1; }));
  EXPECT_TRUE(flagged([](Exchange& e) { e.slave.touches = false; }));
  EXPECT_FALSE(flagged([](Exchange& e) { e.slave.time_s = 0.0099; }));
  EXPECT_TRUE(flagged([](Exchange& e) { e.slave.time_s = 0.0101; }));
  EXPECT_FALSE(flagged([](Exchange& e) { e.slave.energy_in_aj = 8; })) << "it is in the next one";
}

// The deadband is that of the last reply, not of the force as it is; the floor is what is felt of it.
TEST(Invariants, TheFloorOfAReplysDeadbandIsFelt) {
  Exchange e;
  e.slave.force_w_nn.z() = e.reply.force_w_nn.z() = 1;
  EXPECT_TRUE(e.leaves());
  e.slave.force_w_nn.z() = 2.99;
  EXPECT_TRUE(e.is_left_out());
  e.slave.force_w_nn.z() = 3.01;
  EXPECT_FALSE(e.is_left_out());
  // Where nothing was asked, nothing is wrong: a tip that the server withdraws by itself.
  e.slave.force_w_nn.z() = 50;
  EXPECT_TRUE(e.watch.is_true(e.slave, e.exchanges, Exchange::kNPerNn));
}

TEST(Invariants, AReplyThatSaysOtherSumsOrForcesThanTheSlavesIsFlagged) {
  const auto flagged = [](auto&& change) {
    Exchange e;
    change(e.reply);
    return !e.leaves();
  };
  EXPECT_FALSE(flagged([](link::Reply&) {}));
  EXPECT_TRUE(flagged([](link::Reply& r) { r.energy_in_aj = 6.999; }));
  EXPECT_TRUE(flagged([](link::Reply& r) { r.energy_out_aj = 3.001; }));
  EXPECT_TRUE(flagged([](link::Reply& r) { r.force_w_nn.z() = 100.001; }));
  EXPECT_FALSE(ReplyWatch(0, 1).watches());
  EXPECT_TRUE(ReplyWatch(1, 0).watches());
}

}  // namespace
}  // namespace telenano::studies::stress
