// Of a command that a later one has overtaken nothing counts but the steps of its log.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "telenano/common/link/codec.h"
#include "tests/support/wall_slave.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

TEST(OvertakenSteps, CountInWhateverOrderTheirCommandsCome) {
  ServedScene scene;
  scene.hash = 7;
  scene.name = scene_name("wall");
  scene.make_slave = [] { return std::make_unique<support::WallSlave>(support::WallSlaveConfig{}); };
  Server server(test_config(), std::move(scene));
  link::ClientConfig config;
  config.step_ring = 4000;
  VirtualSession s(&server, config, net::SimPath{}, net::SimPath{}, 1);
  s.client.start(0);
  s.ticks(20);
  ASSERT_NE(s.client.features() & link::kFeatureStepLog, 0u);

  // Each repeats the steps of the one before, and none of those before that.
  std::vector<std::vector<std::uint8_t>> sent;
  const auto send = [&](int steps) {
    for (int i = 0; i < steps; ++i)
      s.client.add_step(link::logged_step({0, 0, 1.0 + i}, link::kFlagClutch | link::kFlagDeadman, 1e-3));
    s.now_ns += 1'000'000;
    const std::size_t n = s.client.make_command(s.command, s.now_ns, s.buffer);
    sent.emplace_back(s.buffer.begin(), s.buffer.begin() + static_cast<std::ptrdiff_t>(n));
  };
  for (int k = 0; k < 4; ++k) send(20);
  std::size_t at = 0;
  const auto comes = [&](std::size_t number) {
    return server.on_datagram(sent[number], s.link.address_a(),
                              s.now_ns + static_cast<std::int64_t>(at++) * 100'000, s.answer);
  };
  link::Codec codec;
  link::Incoming in;
  const auto executed = [&](std::size_t bytes) {
    EXPECT_EQ(codec.decode({s.answer.data(), bytes}, in), link::DropCause::kNone);
    return in.reply.steps.executed;
  };
  EXPECT_EQ(executed(comes(3)), 0u) << "41 to 80 are there, and wait";
  EXPECT_EQ(comes(1), 0u) << "1 to 40: no reply to what was overtaken";
  EXPECT_EQ(server.drops()[link::DropCause::kStale], 1u);
  EXPECT_EQ(comes(1), 0u) << "and no step twice";
  EXPECT_EQ(server.drops()[link::DropCause::kDuplicate], 1u);
  send(1);
  EXPECT_EQ(executed(comes(4)), 81u);
  EXPECT_EQ(in.reply.steps.breaks, 0u);
}

}  // namespace
}  // namespace telenano::server
