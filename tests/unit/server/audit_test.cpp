// What an auditor hears of a server. Oracle: the sessions as they were led here, step by step.
#include <gtest/gtest.h>

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "virtual_session.h"

namespace telenano::server {
namespace {

using Kind = AuditEvent::Kind;

struct Audit : testing::Test {
  explicit Audit(std::size_t room = 64) : queue(room) {}

  Server& make(ServerConfig config = test_config()) {
    config.table.timeout_ns = 500'000'000;
    config.table.resume_ns = 2'000'000'000;
    config.audit = &queue;
    return server.emplace(config, spring_scene(&slave));
  }
  VirtualSession& station(std::uint16_t port, std::uint64_t identity, net::Rights rights) {
    link::ClientConfig config;
    config.nonce_seed = port;
    auto& s = stations.emplace_back(
        std::make_unique<VirtualSession>(&*server, config, net::SimPath{}, net::SimPath{}, port));
    net::Address address = s->link.address_a();
    address.port = port;
    s->link.set_address_a(address);
    s->standing = {true, rights, identity};
    s->client.start(0);
    return *s;
  }
  std::vector<AuditEvent> events() {
    std::vector<AuditEvent> all;
    for (AuditEvent event; queue.pop(event);) all.push_back(event);
    return all;
  }
  std::vector<Kind> kinds() {
    std::vector<Kind> all;
    for (const AuditEvent& event : events()) all.push_back(event.kind);
    return all;
  }

  AuditQueue queue;
  SpringSlave* slave = nullptr;  ///< of the first session
  std::optional<Server> server;
  std::vector<std::unique_ptr<VirtualSession>> stations;
};

TEST_F(Audit, ASessionsLifeWithWhoAndWhere) {
  make();
  VirtualSession& s = station(4711, 42, net::Rights::kOperate);
  s.ticks(20);
  ASSERT_EQ(s.client.state(), link::ClientState::kEstablished);
  const auto opened = events();
  ASSERT_EQ(opened.size(), 1u);
  EXPECT_EQ(opened[0].kind, Kind::kOpened);
  EXPECT_EQ(opened[0].session, 1u);
  EXPECT_EQ(opened[0].identity, 42u);
  EXPECT_EQ(opened[0].rights, net::Rights::kOperate);
  EXPECT_EQ(opened[0].address.port, 4711);
  EXPECT_GT(opened[0].at_ns, 0);

  // The path is gone for 0.7 s: silent after 0.5 s, then resumed under the same number.
  s.link.path_a_to_b().down = true;
  s.ticks(700);
  EXPECT_EQ(kinds(), std::vector<Kind>{Kind::kTimedOut});
  s.link.path_a_to_b().down = false;
  s.ticks(1500);
  const auto resumed = events();
  ASSERT_EQ(resumed.size(), 1u);
  EXPECT_EQ(resumed[0].kind, Kind::kResumed);
  EXPECT_EQ(resumed[0].session, 1u);

  std::array<std::uint8_t, link::kMaxDatagramBytes> bye{};
  const std::size_t n = s.client.make_bye(link::ByeReason::kStopped, bye);
  for (int i = 0; i < 3; ++i) s.link.a().send({bye.data(), n}, {});  // as stations do
  s.run_until(s.now_ns += 10 * VirtualSession::kTickNs);
  const auto ended = events();
  ASSERT_EQ(ended.size(), 1u) << "one event for three Byes";
  EXPECT_EQ(ended[0].kind, Kind::kEnded);
  EXPECT_EQ(ended[0].reason, static_cast<std::uint32_t>(link::ByeReason::kStopped));
  EXPECT_EQ(ended[0].session, 1u);
  for (int i = 0; i < 10'000; ++i) server->poll(s.now_ns += VirtualSession::kTickNs);
  EXPECT_TRUE(events().empty()) << "what has ended is not forgotten besides";
}

// By its channel a session goes with its station to another address; who is there now without the channel, or
// with another's key, does not get it.
TEST_F(Audit, ASessionMovesWithItsChannelAndThatIsSaid) {
  make();
  VirtualSession& s = station(4711, 42, net::Rights::kOperate);
  net::Address address = s.link.address_a();
  address.channel = 77;
  s.link.set_address_a(address);
  s.ticks(20);
  ASSERT_EQ(s.client.state(), link::ClientState::kEstablished);
  events();
  const std::uint64_t before = s.client.replies().newest();
  address.port = 4712;
  s.link.set_address_a(address);
  s.ticks(20);
  EXPECT_EQ(s.client.replies().newest(), before + 20) << "not one answer is missing";
  const auto moved = events();
  ASSERT_EQ(moved.size(), 1u);
  EXPECT_EQ(moved[0].kind, Kind::kMoved);
  EXPECT_EQ(moved[0].address.port, 4712);
  EXPECT_EQ(moved[0].session, 1u);

  const std::uint64_t dropped = server->drops().total();
  address.port = 4713;
  address.channel = 78;  // another's
  s.link.set_address_a(address);
  s.ticks(5);
  address.channel = 0;
  s.link.set_address_a(address);
  s.ticks(5);
  address.channel = 77;
  s.link.set_address_a(address);
  s.standing.identity = 43;
  s.ticks(5);
  EXPECT_EQ(server->drops().total(), dropped + 15);
  EXPECT_TRUE(events().empty());

  // A new channel at the same address is the same station's, as after an outage.
  s.standing.identity = 42;
  address.port = 4712;
  address.channel = 79;
  s.link.set_address_a(address);
  s.ticks(5);
  address.port = 4714;
  s.link.set_address_a(address);
  s.ticks(5);
  EXPECT_EQ(server->drops().total(), dropped + 15);
  EXPECT_EQ(kinds(), std::vector<Kind>{Kind::kMoved});
}

TEST_F(Audit, WhoNeverComesBackIsForgottenOnce) {
  make();
  VirtualSession& s = station(4711, 42, net::Rights::kObserve);
  s.ticks(20);
  for (int i = 0; i < 5000; ++i) server->poll(s.now_ns += VirtualSession::kTickNs);
  EXPECT_EQ(kinds(), (std::vector<Kind>{Kind::kOpened, Kind::kTimedOut, Kind::kForgotten}));
}

TEST_F(Audit, ARefusalSaysWhoAndWhy) {
  ServerConfig config = test_config();
  config.table.capacity = 1;
  make(config);
  station(1, 7, net::Rights::kOperate).ticks(20);
  events();
  VirtualSession& second = station(2, 8, net::Rights::kObserve);
  second.ticks(20);
  ASSERT_EQ(second.client.state(), link::ClientState::kRefused);
  const auto refused = events();
  ASSERT_EQ(refused.size(), 1u);
  EXPECT_EQ(refused[0].kind, Kind::kRefused);
  EXPECT_EQ(refused[0].reason, static_cast<std::uint32_t>(link::RefuseReason::kFull));
  EXPECT_EQ(refused[0].identity, 8u);
  EXPECT_EQ(refused[0].session, 0u);
}

TEST_F(Audit, WhoHasTheSharedTipAndWhoLeavesIt) {
  ServerConfig config = test_config();
  config.share = Share::kOneTip;
  make(config);
  VirtualSession& a = station(1, 7, net::Rights::kOperate);
  a.ticks(20);
  EXPECT_EQ(kinds(), (std::vector<Kind>{Kind::kOpened, Kind::kTipTaken}));
  VirtualSession& b = station(2, 8, net::Rights::kAdminister);
  b.now_ns = a.now_ns;
  b.command.flags |= link::kFlagTakeOver;
  for (int i = 0; i < 20; ++i) {
    a.tick();
    b.tick();
  }
  const auto taken = events();
  ASSERT_EQ(taken.size(), 3u);
  EXPECT_EQ(taken[0].kind, Kind::kOpened);
  EXPECT_EQ(taken[1].kind, Kind::kTipLeft);
  EXPECT_EQ(taken[1].identity, 7u);
  EXPECT_EQ(taken[2].kind, Kind::kTipTaken);
  EXPECT_EQ(taken[2].identity, 8u);
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  net::Address to;
  while (server->next_bye(a.now_ns, out, to) > 0) {
  }
  EXPECT_EQ(kinds(), (std::vector<Kind>{Kind::kEnded, Kind::kTipLeft, Kind::kEnded}));
}

TEST_F(Audit, AFaultThatComesAndGoesIsOneEventASecond) {
  make();
  VirtualSession& s = station(1, 7, net::Rights::kOperate);
  s.ticks(20);
  events();
  // A value that is not finite, each 50 ms, for 3 s.
  for (int i = 0; i < 3000; ++i) {
    slave->broken_nn = i / 25 % 2 == 1 ? std::numeric_limits<double>::quiet_NaN() : 0.0;
    s.tick();
  }
  const auto faults = events();
  EXPECT_GE(faults.size(), 3u);
  EXPECT_LE(faults.size(), 4u);
  for (const AuditEvent& event : faults) {
    EXPECT_EQ(event.kind, Kind::kFault);
    EXPECT_EQ(event.faults, link::kFaultNonFinite);
  }
}

struct SmallAudit : Audit {
  SmallAudit() : Audit(2) {}
};

TEST_F(SmallAudit, AFullQueueLosesEventsAndDelaysNobody) {
  make();
  VirtualSession& s = station(1, 7, net::Rights::kOperate);
  s.ticks(20);
  station(2, 8, net::Rights::kOperate).ticks(20);
  station(3, 9, net::Rights::kOperate).ticks(20);
  EXPECT_EQ(events().size(), 2u);
  EXPECT_EQ(queue.dropped(), 1u);
  EXPECT_TRUE(s.client.has_reply());
}

}  // namespace
}  // namespace telenano::server
