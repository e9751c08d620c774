// What a reply says of the commands before its own, against what the server was seen to accept.
#include <gtest/gtest.h>

#include <array>
#include <set>

#include "telenano/common/link/codec.h"
#include "telenano/common/net/sim_link.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

struct Told {
  std::uint64_t replies = 0;
  std::uint64_t gaps = 0;  ///< commands before a reply's own that had not come
};

/// A station's commands through a link that loses, doubles and reorders; every reply is held against the set
/// of commands that the server has accepted.
Told compare(std::uint64_t features, double loss) {
  Server server(test_config(), spring_scene());
  link::ClientConfig config;
  config.feature_bits = features;
  link::ClientSession client(config);
  net::SimPath path;
  path.delay_ns = 3'000'000;
  path.jitter_ns = 4'000'000;  // over a tick of 1 ms: reorders
  path.loss = loss;
  path.duplicate = 0.05;
  net::SimLink link(path, {}, 11);
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> in{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Codec codec;
  link::Incoming incoming;
  std::set<std::uint64_t> accepted;
  Told told;
  client.start(0);
  for (std::int64_t now_ns = 0; now_ns < 5'000'000'000; now_ns += 1'000'000) {
    net::Received received;
    while (link.next_arrival_ns() <= now_ns) {
      link.advance_to(link.next_arrival_ns());
      while (link.b().receive(in, received)) {
        const std::uint64_t before = server.counters().exchanges;
        const std::size_t n =
            server.on_datagram({in.data(), received.size}, received.from, link.now_ns(), out);
        if (server.counters().exchanges > before) {
          codec.decode({out.data(), n}, incoming);
          const link::Reply& reply = incoming.reply;
          std::uint64_t expected = 0;
          for (std::uint64_t i = 0; i < 64; ++i)
            if (accepted.contains(reply.command_sequence - 1 - i)) expected |= 1ull << i;
          EXPECT_EQ(reply.steps_before, (features & link::kFeatureStepHistory) != 0 ? expected : 0u);
          accepted.insert(reply.command_sequence);
          ++told.replies;
          for (std::uint64_t i = 0; i < 64 && i + 1 < reply.command_sequence; ++i)
            told.gaps += (expected >> i & 1) == 0 ? 1 : 0;
        }
        if (n > 0) link.b().send({out.data(), n}, received.from);
      }
      while (link.a().receive(in, received)) client.on_datagram({in.data(), received.size}, link.now_ns());
    }
    link.advance_to(now_ns);
    if (const std::size_t n = client.poll(now_ns, in)) link.a().send({in.data(), n}, {});
    link::Command command = VirtualSession::engaged();
    if (const std::size_t n = client.make_command(command, now_ns, in)) link.a().send({in.data(), n}, {});
  }
  EXPECT_EQ(client.drops()[link::DropCause::kUnexpected], 0u);
  return told;
}

TEST(StepHistory, NamesTheCommandsThatWereAccepted) {
  const Told told = compare(link::kKnownFeatures, 0.3);
  EXPECT_GT(told.replies, 1000u);
  EXPECT_GT(told.gaps, 10000u);  // each lost one is seen by up to 64 replies
}

TEST(StepHistory, SaysNothingUnasked) {
  EXPECT_GT(compare(link::kKnownFeatures & ~std::uint64_t{link::kFeatureStepHistory}, 0.3).replies, 1000u);
}

TEST(StepHistory, ALongGapLeavesNothingOfBefore) {
  link::SessionTable table({}, link::SipKey{1, 2});
  const std::size_t slot = table.open({}, 5, 1000, 0);
  table[slot].feature_bits = link::kKnownFeatures;
  link::Command c;
  c.session_id = table[slot].session_id;
  c.epoch = table[slot].epoch;
  const auto accept = [&](std::uint64_t sequence) {
    c.sequence = sequence;
    std::size_t found = 0;
    EXPECT_EQ(table.accept(c, {}, static_cast<std::int64_t>(sequence) * 1'000'000, found),
              link::DropCause::kNone);
    return table[slot].steps_before;
  };
  EXPECT_EQ(accept(1), 0u);
  EXPECT_EQ(accept(2), 1u);
  EXPECT_EQ(accept(4), 0b110u);
  EXPECT_EQ(accept(5), 0b1101u);
  EXPECT_EQ(accept(68), (1ull << 62) | (1ull << 63)) << "63 on: 5 and 4";
  EXPECT_EQ(accept(132), 1ull << 63) << "64 on: 68 only";
  EXPECT_EQ(accept(197), 0u) << "65 on";
}

}  // namespace
}  // namespace telenano::server
