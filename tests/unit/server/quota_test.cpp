// Who may take how much of a server's room. Oracles: the numbers that were asked for, and who is still there.
#include <gtest/gtest.h>

#include <optional>

#include "spring_slave.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::MessageType;
using link::RefuseReason;
using net::Rights;

constexpr std::int64_t kSecond = 1'000'000'000;

struct Door {
  explicit Door(std::size_t capacity, std::size_t per_party, double openings_per_party_s = 1e9) {
    ServerConfig config = test_config();
    config.table.capacity = capacity;
    config.table.per_party = per_party;
    config.openings_per_party_s = openings_per_party_s;
    server.emplace(config, spring_scene());
  }
  explicit Door(const ServerConfig& config) { server.emplace(config, spring_scene()); }

  /// A Hello of somebody with this standing; each comes from a port of its own.
  link::MessageType hello(const net::Standing& standing, std::uint8_t host = 1) {
    from.ip[15] = host;
    ++from.port;
    link::Hello h;
    h.version_min = h.version_max = link::kProtocolVersion;
    h.nonce = ++nonce;
    h.rate_hz = rate_hz;
    ask(h, standing);
    if (answer.type == MessageType::kChallenge) {
      h.cookie = answer.challenge.cookie;
      ask(h, standing);
    }
    return answer.type;
  }
  /// Its first command, so that there is something to come back to.
  std::uint64_t use(const net::Standing& standing) {
    link::Command c = VirtualSession::engaged();
    const link::Welcome welcome = answer.welcome;
    c.session_id = welcome.session_id;
    c.epoch = welcome.epoch;
    c.sequence = 1;
    ask(c, standing);
    EXPECT_EQ(answer.type, MessageType::kReply);
    return welcome.resume_token;
  }
  template <class Message>
  void ask(const Message& message, const net::Standing& standing) {
    std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
    const std::size_t n = codec.encode(message, in);
    const std::size_t m = server->on_datagram({in.data(), n}, from, now_ns, out, nullptr, standing);
    answer = {};
    if (m > 0) codec.decode({out.data(), m}, answer);
  }
  void pass(std::int64_t ns) {
    now_ns += ns;
    server->poll(now_ns);
  }
  bool knows(std::uint64_t token, std::uint64_t owner) const {
    return server->sessions().find_token(token, owner) != link::SessionTable::kNone;
  }

  std::optional<Server> server;
  net::Address from;
  std::uint64_t nonce = 0;
  std::uint32_t rate_hz = 1000;
  std::int64_t now_ns = kSecond;
  link::Codec codec;
  link::Incoming answer;
};

constexpr net::Standing kObserver{true, Rights::kObserve, 11};
constexpr net::Standing kOperator{true, Rights::kOperate, 22};
constexpr net::Standing kAdministrator{true, Rights::kAdminister, 33};

TEST(Quota, AKeyHasItsShareAndOthersComeIn) {
  Door door(8, 3);
  for (int i = 0; i < 3; ++i) ASSERT_EQ(door.hello(kObserver), MessageType::kWelcome) << i;
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(door.hello(kObserver), MessageType::kRefuse);
    EXPECT_EQ(door.answer.refuse.reason, RefuseReason::kFull);
  }
  EXPECT_EQ(door.server->sessions().active(), 3u);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(door.hello(kOperator), MessageType::kWelcome);
  EXPECT_EQ(door.hello(kOperator), MessageType::kRefuse) << "whatever its right";
  // What ends is given back.
  link::Bye bye;
  ASSERT_EQ(door.hello(kAdministrator), MessageType::kWelcome);
  bye.session_id = door.answer.welcome.session_id;
  bye.reason = link::ByeReason::kDone;
  door.ask(bye, kAdministrator);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(door.hello(kAdministrator), MessageType::kWelcome);
}

TEST(Quota, InTheClearAnAddressHasItsShareWhateverItsPort) {
  Door door(8, 2);
  const net::Standing nobody{};
  for (int i = 0; i < 2; ++i) ASSERT_EQ(door.hello(nobody, 1), MessageType::kWelcome);
  EXPECT_EQ(door.hello(nobody, 1), MessageType::kRefuse);
  EXPECT_EQ(door.hello(nobody, 2), MessageType::kWelcome);
}

TEST(Quota, WhoHasAllOfItsShareGivesUpItsOwnOldestSilentOne) {
  Door door(8, 2);
  ASSERT_EQ(door.hello(kOperator), MessageType::kWelcome);
  const std::uint64_t others = door.use(kOperator);
  ASSERT_EQ(door.hello(kObserver), MessageType::kWelcome);
  const std::uint64_t first = door.use(kObserver);
  door.pass(kSecond / 2);
  ASSERT_EQ(door.hello(kObserver), MessageType::kWelcome);
  const std::uint64_t second = door.use(kObserver);
  door.pass(7 * kSecond / 4);
  door.pass(2 * kSecond);  // all are silent; the others' longest
  ASSERT_EQ(door.server->sessions().active(), 0u);
  for (int i = 0; i < 2; ++i) {
    ASSERT_EQ(door.hello(kObserver), MessageType::kWelcome) << "a restarted station comes in";
    EXPECT_FALSE(door.knows(i == 0 ? first : second, kObserver.identity));
    EXPECT_EQ(door.knows(second, kObserver.identity), i == 0);
  }
  EXPECT_EQ(door.hello(kObserver), MessageType::kRefuse) << "both are active";
  EXPECT_TRUE(door.knows(others, kOperator.identity));
  EXPECT_EQ(door.server->sessions().occupied(), 3u) << "no slot was left behind";
}

TEST(Quota, ALesserRightNeverTakesAGreatersPlace) {
  Door door(2, 2);
  ASSERT_EQ(door.hello(kOperator), MessageType::kWelcome);
  const std::uint64_t token = door.use(kOperator);
  ASSERT_EQ(door.hello(kAdministrator), MessageType::kWelcome);
  const std::uint64_t greater = door.use(kAdministrator);
  door.pass(3 * kSecond);
  ASSERT_EQ(door.server->sessions().active(), 0u);
  // Both silent: tip and account are still theirs.
  EXPECT_EQ(door.hello(kObserver), MessageType::kRefuse);
  EXPECT_EQ(door.answer.refuse.reason, RefuseReason::kFull);
  EXPECT_TRUE(door.knows(token, kOperator.identity));
  EXPECT_TRUE(door.knows(greater, kAdministrator.identity));
  // An equal right has the place of its equal, and nobody has that of the greater.
  const net::Standing another{true, Rights::kOperate, 23};
  EXPECT_EQ(door.hello(another), MessageType::kWelcome);
  EXPECT_FALSE(door.knows(token, kOperator.identity));
  EXPECT_TRUE(door.knows(greater, kAdministrator.identity));
  EXPECT_EQ(door.hello(another), MessageType::kRefuse);
}

TEST(Quota, TheLeastRightGivesWayFirst) {
  Door door(3, 3);
  ASSERT_EQ(door.hello(kOperator), MessageType::kWelcome);
  const std::uint64_t operators = door.use(kOperator);  // silent longest
  door.pass(kSecond / 2);
  ASSERT_EQ(door.hello(kObserver), MessageType::kWelcome);
  const std::uint64_t observers = door.use(kObserver);
  ASSERT_EQ(door.hello(kAdministrator), MessageType::kWelcome);
  const std::uint64_t administrators = door.use(kAdministrator);
  door.pass(7 * kSecond / 4);
  door.pass(2 * kSecond);
  ASSERT_EQ(door.hello(kAdministrator), MessageType::kWelcome);
  EXPECT_FALSE(door.knows(observers, kObserver.identity));
  EXPECT_TRUE(door.knows(operators, kOperator.identity));
  ASSERT_EQ(door.hello(kAdministrator), MessageType::kWelcome);
  EXPECT_FALSE(door.knows(operators, kOperator.identity));
  EXPECT_TRUE(door.knows(administrators, kAdministrator.identity));
}

TEST(Quota, AKeyThatOpensAndEndsDoesNotUseUpTheOthersRate) {
  Door door(8, 8, 16);
  int opened = 0, others = 0;
  for (int ms = 0; ms < 2000; ++ms) {
    door.pass(1'000'000);
    if (door.hello(kObserver) == MessageType::kWelcome) {
      ++opened;
      const link::Bye bye{door.answer.welcome.session_id, link::ByeReason::kDone};
      door.ask(bye, kObserver);
    }
    if (ms % 200 == 199) {
      ASSERT_EQ(door.hello(kOperator), MessageType::kWelcome) << ms;
      ++others;
      const link::Bye bye{door.answer.welcome.session_id, link::ByeReason::kDone};
      door.ask(bye, kOperator);
    }
  }
  EXPECT_LE(opened, 16 + 2 * 16) << "a burst, and 16 a second";
  EXPECT_EQ(others, 10);
}

/// Exchanges of 100 µs: eight sessions of 1 kHz are 80 % of the loop's time.
TEST(Admission, IsByRateTimesWhatAnExchangeTakes) {
  ServerConfig config = test_config();
  config.table.capacity = 64;
  config.load_most = 0.85;
  Door door(config);
  EXPECT_EQ(door.hello(kOperator), MessageType::kWelcome) << "nothing is known yet";
  door.server->note_load(100 * 100'000, 100);
  EXPECT_EQ(door.server->load().cost_s(), 0) << "a hundred say little";
  door.server->note_load(1000 * 100'000, 1000);
  EXPECT_NEAR(door.server->load().cost_s(), 1e-4, 1e-12);
  for (int i = 1; i < 8; ++i) EXPECT_EQ(door.hello(kOperator), MessageType::kWelcome) << i;
  EXPECT_EQ(door.hello(kOperator), MessageType::kRefuse);
  EXPECT_EQ(door.answer.refuse.reason, RefuseReason::kFull);
  door.rate_hz = 400;
  EXPECT_EQ(door.hello(kOperator), MessageType::kWelcome) << "0.84 with it";
  door.rate_hz = 200;
  EXPECT_EQ(door.hello(kOperator), MessageType::kRefuse);
  // Who is there comes back, and a cheaper exchange makes room.
  door.server->note_load(100'000 * 20'000, 100'000);
  EXPECT_NEAR(door.server->load().cost_s(), 2e-5, 1e-12);
  door.rate_hz = 8000;
  EXPECT_EQ(door.hello(kOperator), MessageType::kWelcome) << "0.33 with it";
}

TEST(Admission, OneAloneIsAlwaysLetIn) {
  ServerConfig config = test_config();
  config.load_most = 0.85;
  Door door(config);
  door.server->note_load(1000 * std::int64_t{10'000'000}, 1000);
  EXPECT_EQ(door.hello(kOperator), MessageType::kWelcome);
  EXPECT_EQ(door.hello(kOperator), MessageType::kRefuse);
}

struct Sender {
  explicit Sender(Server& server) : session(&server, client(), {}, {}, 3) {
    session.on_event = [this](link::ClientEvent event) {
      replies += event == link::ClientEvent::kReply ? 1 : 0;
    };
    session.client.start(0);
    session.ticks(50);
    replies = 0;
  }
  static link::ClientConfig client() {
    link::ClientConfig config;
    config.rate_hz = 1000;
    config.nonce_seed = 5;
    return config;
  }
  VirtualSession session;
  int replies = 0;
};

ServerConfig with_rate() {
  ServerConfig config = test_config();
  config.rate_slack = 1.25;
  return config;
}

TEST(Rate, WhoSendsFasterThanHeSaidIsAnsweredAtHisRate) {
  Server server(with_rate(), spring_scene());
  Sender sender(server);
  sender.session.before_end_of_tick = [&] {
    for (int i = 0; i < 3; ++i) {
      link::Command c = sender.session.command;
      if (const std::size_t n =
              sender.session.client.make_command(c, sender.session.now_ns + i, sender.session.buffer))
        sender.session.link.a().send({sender.session.buffer.data(), n}, {});
    }
  };
  constexpr int kSeconds = 4;
  sender.session.ticks(1000 * kSeconds);
  // The second that is saved up, then 1.25 times the rate; 16 000 were sent.
  EXPECT_LE(sender.replies, 1000 + 1250 * kSeconds + 1);
  EXPECT_GE(sender.replies, 1250 * kSeconds);
  EXPECT_GT(server.drops()[link::DropCause::kRateLimited], 9000u);
}

TEST(Rate, WhatAStallHasKeptBackIsAnswered) {
  Server server(with_rate(), spring_scene());
  Sender sender(server);
  sender.session.ticks(2000);
  sender.session.link.path_a_to_b().delay_ns = 900'000'000;  // and then all at once
  sender.session.ticks(900);
  sender.session.link.path_a_to_b().delay_ns = 0;
  sender.session.ticks(1500);
  EXPECT_EQ(server.drops()[link::DropCause::kRateLimited], 0u);
}

}  // namespace
}  // namespace telenano::server
