// Of a command that a later one has overtaken nothing counts but the steps of its log.
#include <gtest/gtest.h>

#include <vector>

#include "telenano/common/link/codec.h"
#include "wall_session.h"

namespace telenano::server {
namespace {

/// A station's commands, kept back, and brought to the server in any order.
struct Overtaken : LoggingSession {
  /// With so many new steps. Each command repeats those of the one before, and none of before that.
  void send(int steps) {
    for (int i = 0; i < steps; ++i)
      s.client.add_step(link::logged_step({0, 0, 1.0 + i}, link::kFlagClutch | link::kFlagDeadman, 1e-3));
    s.now_ns += 1'000'000;
    const std::size_t n = s.client.make_command(s.command, s.now_ns, s.buffer);
    sent.emplace_back(s.buffer.begin(), s.buffer.begin() + static_cast<std::ptrdiff_t>(n));
  }
  /// Bytes of the reply; 0: none.
  std::size_t comes(std::size_t number, const net::Standing& standing = {}) {
    const std::int64_t now_ns = s.now_ns + 100'000 * ++times;
    return server.on_datagram(sent[number], s.link.address_a(), now_ns, s.answer, nullptr, standing);
  }
  const link::StepReport& report(std::size_t bytes) {
    EXPECT_EQ(codec.decode({s.answer.data(), bytes}, in), link::DropCause::kNone);
    return in.reply.steps;
  }

  std::vector<std::vector<std::uint8_t>> sent;
  std::int64_t times = 0;
  link::Codec codec;
  link::Incoming in;
};

TEST(OvertakenSteps, CountInWhateverOrderTheirCommandsCome) {
  Overtaken t;
  ASSERT_TRUE(t.logs());
  for (int k = 0; k < 4; ++k) t.send(20);
  EXPECT_EQ(t.report(t.comes(3)).executed, 0u) << "41 to 80 are there, and wait";
  EXPECT_EQ(t.comes(1), 0u) << "1 to 40: no reply to what was overtaken";
  EXPECT_EQ(t.server.drops()[link::DropCause::kStale], 1u);
  EXPECT_EQ(t.comes(1), 0u) << "and no step twice";
  EXPECT_EQ(t.server.drops()[link::DropCause::kDuplicate], 1u);
  t.send(1);
  EXPECT_EQ(t.report(t.comes(4)).executed, 81u);
  EXPECT_EQ(t.in.reply.steps.breaks, 0u);
}

// A key whose right is taken away while its commands are on the way: none of them moves the tip any more, in
// whatever order they come.
TEST(OvertakenSteps, MoveNothingWithoutTheRight) {
  Overtaken t;
  ASSERT_TRUE(t.logs());
  for (int k = 0; k < 4; ++k) t.send(20);
  EXPECT_EQ(t.report(t.comes(3)).executed, 0u);
  net::Standing observes;
  observes.rights = net::Rights::kObserve;
  t.comes(1, observes);
  t.send(1);
  const double z_nm = t.in.reply.tip_pos_w_nm.z();
  EXPECT_EQ(t.report(t.comes(4, observes)).break_reason, std::uint32_t{link::kBreakRight});
  EXPECT_EQ(t.in.reply.tip_pos_w_nm.z(), z_nm);
}

}  // namespace
}  // namespace telenano::server
