// Own program: it replaces operator new for all of it.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>

#include "tests/unit/link/golden_messages.h"
#include "virtual_session.h"

namespace {
std::atomic<std::uint64_t> g_allocations{0};
}

void* operator new(std::size_t size) {
  g_allocations.fetch_add(1, std::memory_order_relaxed);
  if (void* const p = std::malloc(size)) return p;
  throw std::bad_alloc();
}
void operator delete(void* p) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}

namespace telenano::server {
namespace {

TEST(Allocation, TheGuardSeesAllocations) {
  const auto before = g_allocations.load();
  // Through a volatile pointer, or the compiler may leave the pair out.
  int* volatile p = new int(1);
  delete p;
  EXPECT_EQ(g_allocations.load(), before + 1);
}

TEST(Allocation, NoneInCommandReplyAndTheOtherMessagesAfterConstruction) {
  link::Codec codec;
  link::Incoming in;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Hello hello;
  hello.nonce = 1;
  link::Challenge challenge{1, 2};
  link::Welcome welcome;
  welcome.nonce = welcome.session_id = 1;
  welcome.epoch = welcome.timeout_ms = 1;
  welcome.scene_name.text.fill('x');
  link::Refuse refuse{1, link::RefuseReason::kFull, 1, 1};
  link::Command command;
  command.sequence = 1;
  link::Reply reply;
  reply.sequence = reply.command_sequence = 1;
  link::Bye bye{1, link::ByeReason::kDone};
  const link::GoldenMessages golden;
  int decoded = 0;
  const auto there_and_back = [&](const auto& message) {
    const std::size_t n = codec.encode(message, out);
    if (codec.decode({out.data(), n}, in) == link::DropCause::kNone) ++decoded;
  };
  const auto before = g_allocations.load();
  for (int i = 0; i < 100; ++i) {
    there_and_back(hello);
    there_and_back(challenge);
    there_and_back(welcome);
    there_and_back(refuse);
    there_and_back(command);
    there_and_back(reply);
    there_and_back(bye);
    there_and_back(golden.command_with_features);
    there_and_back(golden.reply_with_features);
    const std::size_t n = codec.encode(golden.command_with_features, golden.recent, out);
    if (codec.decode({out.data(), n}, in) == link::DropCause::kNone) ++decoded;
  }
  EXPECT_EQ(g_allocations.load(), before);
  EXPECT_EQ(decoded, 1000);
}

TEST(Allocation, NoneInAnEstablishedSessionOverABadLink) {
  Server server(test_config(), spring_scene());
  net::SimPath bad;
  bad.delay_ns = 5'000'000;
  bad.jitter_ns = 3'000'000;
  bad.loss = 0.05;
  bad.duplicate = 0.05;
  bad.reorder = 0.05;
  link::ClientConfig client;
  client.redundancy = link::kMaxRecent;
  VirtualSession s(&server, client, bad, bad, 1);
  s.command.control = link::GoldenMessages{}.command_with_features.control;
  s.client.start(0);
  s.ticks(2000);
  ASSERT_EQ(s.client.state(), link::ClientState::kEstablished);
  const auto before = g_allocations.load();
  const auto exchanges = server.counters().exchanges;
  s.ticks(20000);
  EXPECT_EQ(g_allocations.load(), before);
  EXPECT_GT(server.counters().exchanges - exchanges, 15000u);
}

TEST(Allocation, NoneWhenTheSessionIsLostAndResumed) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, {}, {}, 1);
  s.client.start(0);
  s.ticks(500);
  const auto before = g_allocations.load();
  s.link.path_a_to_b().down = true;
  s.ticks(3000);
  s.link.path_a_to_b().down = false;
  s.ticks(2000);
  EXPECT_EQ(server.counters().resumed, 1u);
  EXPECT_EQ(g_allocations.load(), before);
}

TEST(Allocation, NoneWhenASharedTipIsMovedObservedAndTakenOver) {
  ServerConfig config = test_config();
  config.share = Share::kOneTip;
  Server server(config, spring_scene());
  link::ClientConfig other;
  other.nonce_seed = 2;
  VirtualSession a(&server, {}, {}, {}, 1), b(&server, other, {}, {}, 2);
  net::Address address = b.link.address_a();
  address.port = 4002;
  b.link.set_address_a(address);
  a.standing.rights = b.standing.rights = net::Rights::kAdminister;
  const auto ticks = [&](int n) {
    for (int i = 0; i < n; ++i) {
      for (VirtualSession* s : {&a, &b}) {
        s->command.tip_hold = s->client.has_reply() ? s->client.reply().tip.hold : 0;
        s->tick();
      }
    }
  };
  a.client.start(0);
  b.client.start(0);
  ticks(500);
  const auto before = g_allocations.load();
  for (int i = 0; i < 10; ++i) {
    a.command.flags ^= link::kFlagTakeOver;
    ticks(100);
    b.command.flags ^= link::kFlagTakeOver;
    ticks(100);
  }
  EXPECT_EQ(g_allocations.load(), before);
  EXPECT_GE(server.counters().holdings, 10u);
}

TEST(Allocation, NoneForRandomDatagrams) {
  Server server(test_config(), spring_scene());
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  const auto before = g_allocations.load();
  for (std::uint32_t i = 0; i < 100000; ++i) {
    in = {'T', 'L', 'N', 'O', 1, static_cast<std::uint8_t>(i % 9)};
    const std::size_t payload = (i * 7919u) % 500;
    in[6] = static_cast<std::uint8_t>(payload & 0xff);
    in[7] = static_cast<std::uint8_t>(payload >> 8);
    for (std::size_t k = 8; k < 8 + payload; ++k)
      in[k] = static_cast<std::uint8_t>((i * 2654435761u) >> (k % 24));
    in[8] = 0x22;  // a length-delimited field, the kind that costs Protobuf two allocations when unknown
    server.on_datagram({in.data(), 8 + payload}, {}, i, out);
  }
  EXPECT_EQ(g_allocations.load(), before);
  EXPECT_EQ(server.drops().total(), 100000u);
}

}  // namespace
}  // namespace telenano::server
