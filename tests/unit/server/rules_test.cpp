// Each rule of PROTOCOL.md for accepting a datagram, one by one, with datagrams made by hand.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "telenano/common/base/error.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::DropCause;

struct Rules : testing::Test {
  Rules() : server(test_config(), spring_scene()), s(&server, {}, {}, {}, 1) {
    s.client.start(0);
    s.ticks(20);
    command = s.command;
    command.session_id = s.client.welcome().session_id;
    command.epoch = s.client.welcome().epoch;
    command.sequence = 1000;
    reply = s.client.reply();
    reply.sequence = 1000;
  }

  /// Sends to the server and says under which cause it was dropped.
  template <class Message>
  DropCause to_server(const Message& message, const net::Address& from, std::int64_t now_ns = -1) {
    const link::DropCounters before = server.drops();
    const std::size_t n = codec.encode(message, s.buffer);
    answer_bytes = server.on_datagram({s.buffer.data(), n}, from, now_ns < 0 ? s.now_ns : now_ns, s.answer);
    codec.decode({s.answer.data(), answer_bytes}, answer);
    return difference(before, server.drops());
  }
  template <class Message>
  DropCause to_client(const Message& message) {
    const link::DropCounters before = s.client.drops();
    const std::size_t n = codec.encode(message, s.buffer);
    event = s.client.on_datagram({s.buffer.data(), n}, s.now_ns);
    return difference(before, s.client.drops());
  }
  static DropCause difference(const link::DropCounters& before, const link::DropCounters& after) {
    EXPECT_LE(after.total() - before.total(), 1u);
    for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
      const auto cause = static_cast<DropCause>(i);
      if (after[cause] != before[cause]) return cause;
    }
    return DropCause::kNone;
  }

  Server server;
  VirtualSession s;
  net::Address here = s.link.address_a();
  link::Codec codec;
  link::Command command;
  link::Reply reply;
  link::Incoming answer;
  std::size_t answer_bytes = 0;
  link::ClientEvent event = link::ClientEvent::kNone;
};

TEST_F(Rules, ForACommand) {
  net::Address elsewhere = here;
  elsewhere.ip[15] = 9;
  EXPECT_EQ(to_server(command, elsewhere), DropCause::kUnauthenticated);
  EXPECT_EQ(answer_bytes, 0u);
  link::Command c = command;
  c.epoch ^= 1;
  EXPECT_EQ(to_server(c, here), DropCause::kWrongEpoch);
  c = command;
  c.newest_reply = 100'000;
  EXPECT_EQ(to_server(c, here), DropCause::kOutOfRange);
  c = command;
  c.sequence = command.sequence + (1ull << 33);
  EXPECT_EQ(to_server(c, here), DropCause::kOutOfRange);
  c = command;
  c.session_id ^= 0x100;
  EXPECT_EQ(to_server(c, here), DropCause::kUnknownSession);
  EXPECT_EQ(answer.type, link::MessageType::kBye);
  EXPECT_EQ(answer.bye.session_id, c.session_id);
  EXPECT_EQ(to_server(command, here), DropCause::kNone) << "none of them has locked it out";
  EXPECT_EQ(answer.type, link::MessageType::kReply);
  EXPECT_EQ(to_server(command, here), DropCause::kDuplicate);
  c = command;
  c.sequence = 999;
  EXPECT_EQ(to_server(c, here), DropCause::kStale);
  EXPECT_EQ(to_server(reply, here), DropCause::kUnknownType) << "a server hears no replies";
}

TEST_F(Rules, ForAReply) {
  // Nearly a thousand commands whose replies were lost: then number 1000 is one that may come.
  while (s.client.commands_sent() < 1000) {
    link::Command lost = s.command;
    s.client.make_command(lost, s.now_ns, s.buffer);
  }
  reply.command_sequence = 1000;
  link::Reply r = reply;
  r.command_sequence = 999;
  EXPECT_EQ(to_client(r), DropCause::kOutOfRange)
      << "the 1000th reply answers the 1000th command or a later one";
  r = reply;
  r.session_id ^= 0x100;
  EXPECT_EQ(to_client(r), DropCause::kUnknownSession);
  r = reply;
  r.epoch ^= 1;
  EXPECT_EQ(to_client(r), DropCause::kWrongEpoch);
  r = reply;
  r.command_sequence = s.client.commands_sent() + 1;
  EXPECT_EQ(to_client(r), DropCause::kOutOfRange);
  EXPECT_EQ(to_client(reply), DropCause::kNone);
  EXPECT_EQ(event, link::ClientEvent::kReply);
  EXPECT_EQ(to_client(reply), DropCause::kDuplicate);
  r = reply;
  r.sequence = 999;
  EXPECT_EQ(to_client(r), DropCause::kStale);
  EXPECT_EQ(to_client(command), DropCause::kUnknownType) << "a station hears no commands";
  link::Bye bye{reply.session_id ^ 0x100, link::ByeReason::kDone};
  EXPECT_EQ(to_client(bye), DropCause::kUnknownSession);
  EXPECT_EQ(to_client(link::Challenge{1, 2}), DropCause::kUnexpected);
  EXPECT_EQ(to_client(s.client.welcome()), DropCause::kDuplicate);
  link::Welcome w = s.client.welcome();
  w.session_id ^= 0x100;
  EXPECT_EQ(to_client(w), DropCause::kUnexpected) << "nothing was asked";
  EXPECT_EQ(s.client.state(), link::ClientState::kEstablished);
}

TEST_F(Rules, ForByesFromElsewhere) {
  net::Address elsewhere = here;
  elsewhere.port = 1;
  EXPECT_EQ(to_server(link::Bye{command.session_id, link::ByeReason::kDone}, elsewhere),
            DropCause::kUnauthenticated);
  EXPECT_EQ(to_server(link::Bye{command.session_id ^ 0x100, link::ByeReason::kDone}, here),
            DropCause::kUnknownSession);
  EXPECT_EQ(server.sessions().active(), 1u);
}

TEST_F(Rules, ForCookies) {
  net::Address other = here;
  other.port = 1234;
  link::Hello hello;
  hello.nonce = 42;
  const auto challenge_at = [&](std::int64_t now_ns) {
    hello.cookie = 0;
    EXPECT_EQ(to_server(hello, other, now_ns), DropCause::kNone);
    EXPECT_EQ(answer.type, link::MessageType::kChallenge);
    return answer.challenge.cookie;
  };
  constexpr std::int64_t kSecond = 1'000'000'000;
  const std::int64_t start_ns = 300 * kSecond;  // the beginning of a 30 s slot
  hello.cookie = challenge_at(start_ns);
  EXPECT_EQ(to_server(hello, here, start_ns), DropCause::kUnauthenticated) << "of another address";
  EXPECT_EQ(answer.type, link::MessageType::kChallenge);
  link::Hello other_nonce = hello;
  other_nonce.nonce = 43;
  EXPECT_EQ(to_server(other_nonce, other, start_ns), DropCause::kUnauthenticated);
  EXPECT_EQ(to_server(hello, other, start_ns + 60 * kSecond), DropCause::kUnauthenticated)
      << "two slots later";
  EXPECT_EQ(server.counters().opened, 1u);
  EXPECT_EQ(to_server(hello, other, start_ns + 59 * kSecond), DropCause::kNone) << "one slot later";
  EXPECT_EQ(answer.type, link::MessageType::kWelcome);
  EXPECT_EQ(server.counters().opened, 2u);
  const auto first = answer.welcome.session_id;
  EXPECT_EQ(to_server(hello, other, start_ns + 59 * kSecond), DropCause::kNone)
      << "repeated: the same session";
  EXPECT_EQ(answer.welcome.session_id, first);
  EXPECT_EQ(server.counters().opened, 2u);
}

TEST_F(Rules, ASupersededHelloDoesNotTakeTheSessionBack) {
  const auto say = [&](std::uint64_t nonce, std::uint64_t token) {
    link::Hello hello;
    hello.nonce = nonce;
    hello.resume_token = token;
    to_server(hello, here);
    hello.cookie = answer.challenge.cookie;
    return std::pair{to_server(hello, here), answer.welcome};
  };
  const auto token = s.client.welcome().resume_token;
  const auto [cause1, second] = say(1001, token);
  const auto [cause2, third] = say(1002, token);
  EXPECT_EQ(cause1, DropCause::kNone);
  EXPECT_EQ(second.epoch, third.epoch);
  EXPECT_EQ(second.resume_token, third.resume_token);
  EXPECT_NE(second.session_id, third.session_id);
  EXPECT_EQ(say(1001, token).first, DropCause::kDuplicate);
  EXPECT_EQ(server.sessions()[0].session_id, third.session_id);
  EXPECT_EQ(server.counters().resumed, 2u);
  EXPECT_EQ(server.counters().opened, 1u);
}

TEST(Table, HoldsAsManyAsItShouldAndGivesUpTheLongestSilent) {
  ServerConfig config = test_config();
  config.table.capacity = 3;
  Server server(config, spring_scene());
  std::vector<std::unique_ptr<VirtualSession>> stations;
  std::int64_t now_ns = 0;
  const auto add = [&] {
    link::ClientConfig client;
    client.nonce_seed = 100 + stations.size();
    stations.push_back(std::make_unique<VirtualSession>(&server, client, net::SimPath{}, net::SimPath{}, 1));
    net::Address a = stations.back()->link.address_a();
    a.port = static_cast<std::uint16_t>(stations.size());
    stations.back()->link.set_address_a(a);
    stations.back()->now_ns = now_ns;
    stations.back()->client.start(now_ns);
  };
  const auto run = [&](int ticks, std::set<std::size_t> quiet = {}) {
    for (int t = 0; t < ticks; ++t) {
      for (std::size_t i = 0; i < stations.size(); ++i) {
        if (quiet.count(i) > 0) {
          stations[i]->now_ns += VirtualSession::kTickNs;
        } else {
          stations[i]->tick();
        }
      }
    }
    now_ns = stations[0]->now_ns;
  };
  for (int i = 0; i < 3; ++i) add();
  run(50);
  EXPECT_EQ(server.sessions().active(), 3u);
  add();
  run(50);
  EXPECT_EQ(stations[3]->client.state(), link::ClientState::kRefused);
  EXPECT_EQ(stations[3]->client.refuse().reason, link::RefuseReason::kFull);
  run(500, {1});
  run(2500, {0, 1});  // 1 has been silent longest, then 0
  EXPECT_EQ(server.sessions().active(), 1u);
  const auto token_0 = stations[0]->client.welcome().resume_token;
  const auto token_1 = stations[1]->client.welcome().resume_token;
  add();
  run(50, {0, 1});
  EXPECT_EQ(stations[4]->client.state(), link::ClientState::kEstablished);
  EXPECT_NE(server.sessions().find_token(token_0), link::SessionTable::kNone);
  EXPECT_EQ(server.sessions().find_token(token_1), link::SessionTable::kNone);
  EXPECT_EQ(stations[2]->client.state(), link::ClientState::kEstablished)
      << "an active one is never given up";
}

TEST(Table, AServerWithoutASlaveNamesItsSceneEvenIfTheNameFillsItsPlace) {
  ServedScene scene = spring_scene();
  scene.name = scene_name(std::string(60, 's'));
  scene.hash = 0x4141414141414141;
  scene.make_slave = nullptr;
  try {
    Server server(test_config(), std::move(scene));
    FAIL() << "no slave, no server";
  } catch (const RunError& error) {
    EXPECT_EQ(std::string(error.what()), "the scene '" + std::string(48, 's') + "' made no slave");
  }
}

TEST(Table, ASlaveThatCannotBeMadeIsARefusalAndNothingElse) {
  int made = 0;
  ServedScene scene = spring_scene();
  scene.make_slave = [&]() -> std::unique_ptr<slave::Slave> {
    if (++made > 1) throw std::runtime_error("the scan has vanished");
    return std::make_unique<SpringSlave>();
  };
  Server server(test_config(), std::move(scene));
  VirtualSession a(&server, {}, {}, {}, 1);
  a.client.start(0);
  a.ticks(20);
  link::ClientConfig other;
  other.nonce_seed = 2;
  VirtualSession b(&server, other, {}, {}, 1);
  b.client.start(0);
  b.ticks(20);
  EXPECT_EQ(a.client.state(), link::ClientState::kEstablished);
  EXPECT_EQ(b.client.state(), link::ClientState::kRefused);
  EXPECT_EQ(server.sessions().occupied(), 1u);
}

}  // namespace
}  // namespace telenano::server
