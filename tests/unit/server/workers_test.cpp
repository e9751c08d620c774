// Several servers behind one address, each with its own table, as the kernel would feed them: a peer's
// datagrams go to one of them, by its address. Which one is decided by the test.
#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "spring_slave.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::ClientState;

constexpr std::int64_t kMs = 1'000'000;

net::Address address_of(std::uint16_t port) {
  net::Address address;
  address.ip[15] = 1;
  address.port = port;
  return address;
}

struct Rig {
  explicit Rig(std::size_t n, std::size_t max_sessions = 64, std::size_t capacity = 64)
      : mail(n), cap(max_sessions), last(n) {
    for (std::size_t i = 0; i < n; ++i) {
      ServerConfig config = test_config();
      config.table.capacity = capacity;
      config.mail = &mail;
      config.worker = i;
      config.cap = &cap;
      config.openings_per_s = 1e6;
      servers.push_back(std::make_unique<Server>(config, spring_scene(&last[i])));
    }
  }

  /// One look of every loop.
  void look() {
    for (std::size_t i = 0; i < servers.size(); ++i) look(i);
  }
  void look(std::size_t i) {
    servers[i]->exchange_mail();
    net::Address to;
    while (const std::size_t n = servers[i]->next_answer(now_ns, out, to)) {
      if (to == station_at) client->on_datagram({out.data(), n}, now_ns);
      ++late_answers;
    }
  }
  void pass(std::int64_t ns) {
    now_ns += ns;
    for (auto& s : servers) s->poll(now_ns);
  }
  /// What the station at `from` says now goes to `worker`, and the answer back.
  void station(link::ClientSession& c, const net::Address& from, std::size_t worker) {
    client = &c;
    station_at = from;
    const auto say = [&](std::size_t n) {
      const std::size_t m = servers[worker]->on_datagram({in.data(), n}, from, now_ns, out);
      if (m > 0) c.on_datagram({out.data(), m}, now_ns);
    };
    if (const std::size_t n = c.poll(now_ns, in)) say(n);
    link::Command command = VirtualSession::engaged();
    if (const std::size_t n = c.make_command(command, now_ns, in)) say(n);
  }
  bool establish(link::ClientSession& c, const net::Address& from, std::size_t worker, int ticks = 20) {
    for (int i = 0; i < ticks && c.state() != ClientState::kEstablished; ++i) {
      pass(10 * kMs);
      station(c, from, worker);
      look();
    }
    return c.state() == ClientState::kEstablished;
  }
  std::size_t active() const {
    std::size_t sum = 0;
    for (const auto& s : servers) sum += s->sessions().active();
    return sum;
  }

  WorkerMail mail;
  SessionCap cap;
  std::vector<SpringSlave*> last;
  std::vector<std::unique_ptr<Server>> servers;
  std::int64_t now_ns = 1'000'000'000;
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::ClientSession* client = nullptr;
  net::Address station_at;
  int late_answers = 0;
};

link::ClientConfig client_config(std::uint64_t seed, std::uint64_t token = 0) {
  link::ClientConfig config;
  config.nonce_seed = seed;
  config.resume_token = token;
  return config;
}

TEST(Workers, ASessionThatComesBackElsewhereMovesWithItsSlaveAndItsAccount) {
  Rig rig(3);
  link::ClientSession station(client_config(1));
  station.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(station, address_of(1000), 0));
  SpringSlave* const slave = rig.last[0];
  for (int i = 0; i < 50; ++i) {
    rig.pass(kMs);
    rig.station(station, address_of(1000), 0);
  }
  ASSERT_EQ(station.reply().force_w_nn.z(), 3);
  const auto token = station.welcome().resume_token;
  const auto epoch = station.welcome().epoch;
  const auto steps = slave->steps;

  // The station is started again: another port, another worker.
  link::ClientSession again(client_config(2, token));
  again.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(again, address_of(2000), 2));
  EXPECT_EQ(rig.late_answers, 1);
  EXPECT_EQ(again.welcome().resume_token, token);
  EXPECT_EQ(again.welcome().epoch, epoch) << "the same slave and account";
  EXPECT_EQ(again.welcome().start_pos_w_nm, Vec3(1, 2, -3)) << "where it is held";
  EXPECT_EQ(rig.servers[0]->counters().moved_out, 1u);
  EXPECT_EQ(rig.servers[2]->counters().moved_in, 1u);
  EXPECT_EQ(rig.servers[2]->counters().resumed, 1u);
  EXPECT_EQ(rig.servers[2]->counters().opened, 0u);
  EXPECT_EQ(rig.servers[0]->sessions().occupied(), 0u);
  EXPECT_EQ(rig.active(), 1u);
  EXPECT_EQ(rig.cap.active(), 1);
  for (int i = 0; i < 20; ++i) {
    rig.pass(kMs);
    rig.station(again, address_of(2000), 2);
  }
  EXPECT_EQ(again.reply().force_w_nn.z(), 3);
  EXPECT_EQ(slave->steps, steps + 20) << "stepped by its new worker";
  EXPECT_EQ(again.slave_energy_aj().in(), 4.5) << "½·3²: pressed once, in the first session";

  // And once more, though the token was made by a worker that has it no longer.
  link::ClientSession third(client_config(3, token));
  third.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(third, address_of(3000), 1));
  EXPECT_EQ(third.welcome().epoch, epoch);
  EXPECT_EQ(rig.active(), 1u);
}

TEST(Workers, ASessionThatIsSilentMovesToo) {
  Rig rig(2);
  link::ClientSession station(client_config(1));
  station.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(station, address_of(1000), 0));
  rig.station(station, address_of(1000), 0);
  rig.pass(10 * kMs);
  rig.station(station, address_of(1000), 0);
  rig.pass(2'500 * kMs);
  ASSERT_EQ(rig.active(), 0u) << "silent";
  EXPECT_EQ(rig.cap.active(), 0);
  const auto epoch = station.welcome().epoch;
  link::ClientSession again(client_config(2, station.welcome().resume_token));
  again.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(again, address_of(2000), 1));
  EXPECT_EQ(again.welcome().epoch, epoch);
  EXPECT_EQ(rig.cap.active(), 1);
}

TEST(Workers, AnUnknownTokenOpensANewSessionOnceAllHaveSaidNo) {
  Rig rig(3);
  link::ClientSession station(client_config(1, 0x1234567));
  station.start(rig.now_ns);
  rig.station(station, address_of(1000), 1);  // Challenge
  rig.pass(kMs);
  rig.station(station, address_of(1000), 1);
  EXPECT_TRUE(rig.servers[1]->awaits_mail());
  rig.look(1);
  EXPECT_EQ(station.state(), ClientState::kChallenged) << "nobody has answered";
  rig.look(0);
  rig.look(1);
  EXPECT_EQ(station.state(), ClientState::kChallenged) << "one has not";
  rig.look(2);
  rig.look(1);
  EXPECT_EQ(station.state(), ClientState::kEstablished);
  EXPECT_FALSE(rig.servers[1]->awaits_mail());
  EXPECT_EQ(rig.servers[1]->counters().opened, 1u);
}

TEST(Workers, AHelloThatWaitsIsAskedAboutOnceAndForgottenInTime) {
  Rig rig(2);
  link::ClientSession station(client_config(1, 0x1234567));
  station.start(rig.now_ns);
  rig.station(station, address_of(1000), 1);
  rig.station(station, address_of(1000), 1);
  ASSERT_TRUE(rig.servers[1]->awaits_mail());
  const auto hello = rig.in;  // the Hello with its cookie was said last
  rig.servers[1]->on_datagram(hello, address_of(1000), rig.now_ns, rig.out);
  EXPECT_EQ(rig.servers[1]->drops()[link::DropCause::kDuplicate], 1u);
  rig.pass(TokenSearch::kPatienceNs + kMs);  // the other worker stands still
  EXPECT_FALSE(rig.servers[1]->awaits_mail());
  rig.look();
  rig.look();
  EXPECT_EQ(station.state(), ClientState::kChallenged) << "an answer that comes too late opens nothing";
  EXPECT_EQ(rig.active(), 0u);
  ASSERT_TRUE(rig.establish(station, address_of(1000), 1)) << "the station's next Hello does";
}

TEST(Workers, AParcelThatComesTooLateIsNotLost) {
  Rig rig(2);
  link::ClientSession station(client_config(1));
  station.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(station, address_of(1000), 0));
  rig.station(station, address_of(1000), 0);
  const auto epoch = station.welcome().epoch;
  link::ClientSession again(client_config(2, station.welcome().resume_token));
  again.start(rig.now_ns);
  rig.station(again, address_of(2000), 1);
  rig.station(again, address_of(2000), 1);
  rig.look(0);  // handed over, but its asker does not look in time
  rig.pass(TokenSearch::kPatienceNs + kMs);
  rig.look(1);
  EXPECT_EQ(rig.servers[1]->sessions().occupied(), 1u) << "taken in all the same";
  EXPECT_EQ(rig.cap.active(), 1);
  ASSERT_TRUE(rig.establish(again, address_of(2000), 1));
  EXPECT_EQ(again.welcome().epoch, epoch);
}

TEST(Workers, CookiesHoldAtEveryWorker) {
  Rig rig(2);
  link::ClientSession station(client_config(1));
  station.start(rig.now_ns);
  rig.station(station, address_of(1000), 0);  // Challenge by one, the Hello with its cookie to the other
  EXPECT_EQ(station.state(), ClientState::kChallenged);
  rig.station(station, address_of(1000), 1);
  EXPECT_EQ(station.state(), ClientState::kEstablished);
}

TEST(Workers, NumbersAndEpochsDifferBetweenWorkers) {
  Rig rig(4);
  std::set<std::uint64_t> ids, tokens;
  std::set<std::uint32_t> epochs;
  for (std::uint16_t k = 0; k < 32; ++k) {
    link::ClientSession station(client_config(k + 1));
    station.start(rig.now_ns);
    ASSERT_TRUE(rig.establish(station, address_of(static_cast<std::uint16_t>(1000 + k)), k % 4));
    ids.insert(station.welcome().session_id);
    tokens.insert(station.welcome().resume_token);
    epochs.insert(station.welcome().epoch);
  }
  EXPECT_EQ(ids.size(), 32u);
  EXPECT_EQ(tokens.size(), 32u);
  EXPECT_EQ(epochs.size(), 32u);
}

TEST(Workers, TheCapIsThatOfAllTogether) {
  Rig rig(2, 3, 3);
  std::vector<std::unique_ptr<link::ClientSession>> stations;
  for (std::uint16_t k = 0; k < 3; ++k) {
    stations.push_back(std::make_unique<link::ClientSession>(client_config(k + 1)));
    stations.back()->start(rig.now_ns);
    ASSERT_TRUE(rig.establish(*stations.back(), address_of(static_cast<std::uint16_t>(1000 + k)), k % 2));
  }
  EXPECT_EQ(rig.cap.active(), 3);
  link::ClientSession more(client_config(9));
  more.start(rig.now_ns);
  EXPECT_FALSE(rig.establish(more, address_of(2000), 1));
  EXPECT_EQ(more.state(), ClientState::kRefused);
  EXPECT_EQ(more.refuse().reason, link::RefuseReason::kFull);
  EXPECT_EQ(rig.cap.active(), 3) << "a refusal takes no place";

  // Strangers take none either.
  for (std::uint64_t k = 0; k < 100; ++k) {
    link::ClientSession stranger(client_config(100 + k));
    stranger.start(rig.now_ns);
    rig.station(stranger, address_of(3000), 0);
  }
  EXPECT_EQ(rig.cap.active(), 3);

  // One leaves: there is a place again, at either worker.
  const std::size_t n = stations[0]->make_bye(link::ByeReason::kDone, rig.in);
  rig.servers[0]->on_datagram({rig.in.data(), n}, address_of(1000), rig.now_ns, rig.out);
  EXPECT_EQ(rig.cap.active(), 2);
  link::ClientSession next(client_config(10));
  next.start(rig.now_ns);
  EXPECT_TRUE(rig.establish(next, address_of(2001), 1));
  EXPECT_EQ(rig.cap.active(), 3);
}

TEST(Workers, ASilentSessionResumesOnlyWhereThereIsAPlace) {
  Rig rig(2, 1, 1);
  link::ClientSession first(client_config(1));
  first.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(first, address_of(1000), 0));
  rig.station(first, address_of(1000), 0);
  rig.pass(2'500 * kMs);
  link::ClientSession second(client_config(2));
  second.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(second, address_of(2000), 1)) << "the silent one has given its place up";
  link::ClientSession again(client_config(3, first.welcome().resume_token));
  again.start(rig.now_ns);
  EXPECT_FALSE(rig.establish(again, address_of(1001), 0));
  EXPECT_EQ(again.refuse().reason, link::RefuseReason::kFull);
  EXPECT_EQ(rig.cap.active(), 1);
}

TEST(Workers, ManyQuestionsAtOnceAreBounded) {
  Rig rig(2, 256, 256);
  std::vector<std::unique_ptr<link::ClientSession>> stations;
  for (std::uint16_t k = 0; k < 200; ++k) {
    stations.push_back(std::make_unique<link::ClientSession>(client_config(k + 1, 0xabc000u + k)));
    stations.back()->start(rig.now_ns);
    const auto at = address_of(static_cast<std::uint16_t>(1000 + k));
    rig.station(*stations.back(), at, 0);
    rig.station(*stations.back(), at, 0);
  }
  // All of one address, which may have three quarters of the questions.
  EXPECT_EQ(rig.servers[0]->drops()[link::DropCause::kRateLimited],
            200 - TokenSearch::most_of_one_party(256));
  rig.look();
  rig.look();
  EXPECT_EQ(rig.active(), TokenSearch::most_of_one_party(256));
}

TEST(Workers, WhatIsInTheMailWhenAllEndsIsFreed) {
  Rig rig(2);
  link::ClientSession station(client_config(1));
  station.start(rig.now_ns);
  ASSERT_TRUE(rig.establish(station, address_of(1000), 0));
  link::ClientSession again(client_config(2, station.welcome().resume_token));
  again.start(rig.now_ns);
  rig.station(again, address_of(2000), 1);
  rig.station(again, address_of(2000), 1);
  rig.look(0);  // on its way: a sanitizer would tell of the leak
  EXPECT_EQ(rig.active(), 0u);
}

TEST(LargeTable, FindsEverySessionAmongThousands) {
  ServerConfig config = test_config();
  config.table.capacity = 2000;
  config.openings_per_s = 1e6;
  Server server(config, spring_scene());
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
  std::int64_t now_ns = 1'000'000'000;
  std::vector<std::unique_ptr<link::ClientSession>> stations;
  net::Standing proven;
  proven.address_proven = true;
  const auto at = [](std::size_t k) { return address_of(static_cast<std::uint16_t>(1000 + k)); };
  for (std::size_t k = 0; k < 2000; ++k) {
    stations.push_back(std::make_unique<link::ClientSession>(client_config(k + 1)));
    stations.back()->start(now_ns);
    const std::size_t n = stations.back()->poll(now_ns, in);
    const std::size_t m = server.on_datagram({in.data(), n}, at(k), now_ns, out, nullptr, proven);
    stations.back()->on_datagram({out.data(), m}, now_ns);
    ASSERT_EQ(stations.back()->state(), ClientState::kEstablished) << k;
  }
  EXPECT_EQ(server.sessions().active(), 2000u);
  for (std::size_t k = 0; k < 2000; ++k) {
    link::Command command = VirtualSession::engaged();
    command.tip_pos_w_nm.z() = -1 - 0.001 * static_cast<double>(k);
    const std::size_t n = stations[k]->make_command(command, now_ns, in);
    const std::size_t m = server.on_datagram({in.data(), n}, at(k), now_ns, out);
    stations[k]->on_datagram({out.data(), m}, now_ns);
    EXPECT_EQ(stations[k]->reply().force_w_nn.z(), 1 + 0.001 * static_cast<double>(k));
  }
  now_ns += 60'000'000'000;
  server.poll(now_ns);
  now_ns += 60'000'000'000;
  server.poll(now_ns);
  EXPECT_EQ(server.sessions().occupied(), 0u);
  EXPECT_EQ(server.sessions().active(), 0u);
}

}  // namespace
}  // namespace telenano::server
