// The server's loop, as a real program: whoever comes back from another port keeps its session.
#include <thread>
#include <tuple>
#include <utility>

#include "telenano/common/security/key_list.h"
#include "tests/support/wire_station.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

using support::WireStation;

constexpr std::int64_t kPatienceNs = 30'000'000'000;

link::Command hold() {
  link::Command command;
  command.flags = link::kFlagClutch | link::kFlagDeadman;
  return command;
}

class WorkersTest : public ProgramsTest {
 protected:
  /// A list with one station's key in keys.toml, and what the station needs.
  security::DtlsClientConfig make_key() const {
    const Finished made = run_program({kNve, "keys", "new", "omega-1", "--keys", path("keys.toml"),
                                       "--rights", "operate", "--out", path("omega-1.key")});
    EXPECT_EQ(made.exit_code, 0) << made.err;
    security::DtlsClientConfig secure;
    secure.key = security::load_station_key(path("omega-1.key"));
    return secure;
  }
  /// Sixteen stations, each of which comes back from another port.
  static void come_and_come_back(Server& server, const std::optional<security::DtlsClientConfig>& secure) {
    const net::Address at = net::parse_address(server.address(), "test");
    std::vector<std::unique_ptr<WireStation>> stations;
    for (std::uint64_t k = 0; k < 16; ++k) {
      link::ClientConfig config;
      config.nonce_seed = 1000 + k;
      auto first = std::make_unique<WireStation>(at, config, secure);
      ASSERT_TRUE(first->exchange(20, hold(), kPatienceNs)) << k;
      const link::Welcome before = first->client.welcome();
      first.reset();
      config.nonce_seed = 2000 + k;
      config.resume_token = before.resume_token;
      auto again = std::make_unique<WireStation>(at, config, secure);
      ASSERT_TRUE(again->exchange(20, hold(), kPatienceNs)) << k;
      EXPECT_EQ(again->client.welcome().epoch, before.epoch) << "the same slave and account";
      EXPECT_EQ(again->client.welcome().resume_token, before.resume_token);
      EXPECT_NE(again->client.welcome().session_id, before.session_id);
      stations.push_back(std::move(again));
    }
    for (auto& s : stations)
      s->wire().send({s->buffer.data(), s->client.make_bye(link::ByeReason::kDone, s->buffer)}, at);
    stations.clear();
    const std::string said = server.stop();
    EXPECT_NE(said.find("in 16 sessions (16 resumed)"), std::string::npos) << said;
  }
};

TEST_F(WorkersTest, SessionsThatComeBackFromAnotherPortAreResumed) {
  Server server(scene_path("flat_silicon_oxide"));
  come_and_come_back(server, {});
}

TEST_F(WorkersTest, TheSameWithSecureChannels) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without TELENANO_DTLS";
  const security::DtlsClientConfig secure = make_key();
  Server server(scene_path("flat_silicon_oxide"), 0, {"--keys", path("keys.toml")});
  come_and_come_back(server, secure);
}

// A station without a connection id that goes on from another port: its channel is resumed, which takes
// one round trip less than agreeing anew. Each from an address of its own, as only so many may begin a
// handshake from one.
TEST_F(WorkersTest, WhoGoesOnFromAnotherPortResumesItsChannel) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without TELENANO_DTLS";
  security::DtlsClientConfig secure = make_key();
  secure.connection_id = false;  // as stations of before
  Server server(scene_path("flat_silicon_oxide"), 0, {"--keys", path("keys.toml")});
  const net::Address at = net::parse_address(server.address(), "test");
  constexpr std::size_t kStations = 16;
  const auto own_address = [](std::size_t k) {
    return net::parse_address("127.0.1." + std::to_string(1 + k) + ":0", "test");
  };
  std::vector<std::unique_ptr<WireStation>> stations;
  std::vector<link::Welcome> before;
  for (std::size_t k = 0; k < kStations; ++k) {
    link::ClientConfig config;
    config.nonce_seed = 1000 + k;
    stations.push_back(std::make_unique<WireStation>(at, config, secure, own_address(k)));
    ASSERT_TRUE(stations[k]->exchange(20, hold(), kPatienceNs)) << k;
    before.push_back(stations[k]->client.welcome());
    stations[k]->socket = net::Udp::listen(own_address(k));
  }
  // All at once: each notices by the silence, a quarter of a second.
  const auto is_back = [&](std::size_t k) {
    return stations[k]->client.state() == link::ClientState::kEstablished &&
           stations[k]->client.welcome().session_id != before[k].session_id;
  };
  const std::int64_t end_ns = stations[0]->clock.now_ns() + kPatienceNs;
  for (std::size_t back = 0; back < kStations && stations[0]->clock.now_ns() < end_ns;) {
    for (auto& s : stations) s->pump(hold());
    stations[0]->socket.wait_readable(1'000'000);
    for (back = 0; back < kStations && is_back(back);) ++back;
  }
  for (std::size_t k = 0; k < kStations; ++k) {
    ASSERT_TRUE(is_back(k)) << k;
    EXPECT_EQ(stations[k]->client.welcome().epoch, before[k].epoch) << "the same slave and account";
    const auto& counters = stations[k]->channel->counters();
    EXPECT_GE(counters.resumed, 1u) << k;
    EXPECT_EQ(counters.resumed, counters.handshakes - 1) << k;
  }
}

// With one it goes on: no handshake, no Hello, not one answer lost. Sixteen stations, each three times.
TEST_F(WorkersTest, WhoGoesOnFromAnotherPortIsAnsweredAtOnce) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without TELENANO_DTLS";
  const security::DtlsClientConfig secure = make_key();
  Server server(scene_path("flat_silicon_oxide"), 0, {"--keys", path("keys.toml")});
  const net::Address at = net::parse_address(server.address(), "test");
  for (std::size_t k = 0; k < 16; ++k) {
    const net::Address own = net::parse_address("127.0.1." + std::to_string(1 + k) + ":0", "test");
    link::ClientConfig config;
    config.nonce_seed = 1000 + k;
    WireStation station(at, config, secure, own);
    ASSERT_TRUE(station.exchange(20, hold(), kPatienceNs)) << k;
    const link::Welcome before = station.client.welcome();
    for (std::uint64_t move = 0; move < 3; ++move) {
      station.socket = net::Udp::listen(own);
      ASSERT_TRUE(station.exchange(20 * (move + 2), hold(), kPatienceNs)) << k;
    }
    EXPECT_EQ(station.client.welcome().session_id, before.session_id) << k;
    EXPECT_EQ(station.channel->counters().handshakes, 1u) << k;
    EXPECT_EQ(station.channel->counters().proofs, 3u) << k;
    station.wire().send(
        {station.buffer.data(), station.client.make_bye(link::ByeReason::kDone, station.buffer)}, at);
  }
  const std::string said = server.stop();
  EXPECT_NE(said.find("in 16 sessions (0 resumed"), std::string::npos) << said;
  EXPECT_NE(said.find("moved 48"), std::string::npos) << said;
}

TEST_F(WorkersTest, BeyondTheCapIsFull) {
  Server server(scene_path("flat_silicon_oxide"), 0, {"--max-sessions", "4"});
  const net::Address at = net::parse_address(server.address(), "test");
  std::vector<std::unique_ptr<WireStation>> stations;
  for (std::uint64_t k = 0; k < 4; ++k) {
    link::ClientConfig config;
    config.nonce_seed = 1 + k;
    stations.push_back(std::make_unique<WireStation>(at, config));
    ASSERT_TRUE(stations.back()->exchange(2, hold(), kPatienceNs));
  }
  link::ClientConfig config;
  config.nonce_seed = 99;
  WireStation more(at, config);
  for (int i = 0; i < 3000 && more.client.state() != link::ClientState::kRefused; ++i) {
    more.pump(hold());
    for (auto& s : stations) s->pump(hold());
    more.socket.wait_readable(1'000'000);
  }
  EXPECT_EQ(more.client.state(), link::ClientState::kRefused);
  EXPECT_EQ(more.client.refuse().reason, link::RefuseReason::kFull);
}

TEST_F(WorkersTest, APortThatAnotherServerHasIsInUse) {
  Server server(scene_path("flat_silicon_oxide"));
  const Finished second =
      run_program({kNve, "serve", "--scene", scene_path("flat_silicon_oxide"), "--listen", server.address()});
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_NE(second.err.find("in use"), std::string::npos) << second.err;
  EXPECT_EQ(lines_of(second.err).size(), 1u) << second.err;
}

TEST_F(WorkersTest, OnlyTheThreadThatServesHasTheRealTimePriority) {
  Server server(scene_path("flat_silicon_oxide"), 0, {"--rt-priority", "37"});
  WireStation station(net::parse_address(server.address(), "test"), {});
  ASSERT_TRUE(station.exchange(20, hold(), kPatienceNs));
  ASSERT_TRUE(server.child().wait_for_err(" memory ", kLong)) << server.child().err();
  const std::string said = server.child().err();
  const bool granted = said.find("SCHED_FIFO 37, ") != std::string::npos;
  auto [with, others] = realtime_threads(server.child().pid(), 37);
  for (int i = 0; granted && with < 1 && i < 500; ++i) {
    std::this_thread::sleep_for(Milliseconds(10));
    std::tie(with, others) = realtime_threads(server.child().pid(), 37);
  }
  EXPECT_EQ(with, granted ? 1 : 0) << said;
  EXPECT_EQ(others, 0);
  EXPECT_NE(granted, said.find("rtprio") != std::string::npos) << said;
  server.stop();
}

/// What an exchange costs in system calls: while a session runs at one exchange at a time, the thread that
/// serves makes one receive, which waits, and one send for each, and nothing else. That thread alone is
/// traced: the others' calls go by time (the watchers' futex ten times a second), and who slows the machine
/// down would find more of them to an exchange; none of them can be asked to do anything without a call of
/// this one.
TEST_F(WorkersTest, AnExchangeIsOneReceiveAndOneSend) {
  if (run_program({"/usr/bin/env", "strace", "-V"}).exit_code != 0)
    GTEST_SKIP() << "no strace (apt install strace)";
  Server server(scene_path("flat_silicon_oxide"));
  const net::Address at = net::parse_address(server.address(), "test");
  WireStation station(at, {});
  ASSERT_TRUE(station.exchange(20, hold(), kPatienceNs));
  const std::string table = path("calls.txt");
  ChildProcess strace({"/usr/bin/env", "strace", "-c", "-U", "name,calls", "-o", table, "-p",
                       std::to_string(server.child().pid())});
  if (!strace.wait_for_err("attached", Seconds(10))) GTEST_SKIP() << "may not trace: " << strace.err();
  const std::uint64_t before = station.client.replies().newest();
  // One at a time: the next command goes when the answer is there.
  for (int i = 0; i < 2000; ++i) {
    station.pump(hold());
    station.socket.wait_readable(100'000'000);
  }
  const auto exchanges = static_cast<double>(station.client.replies().newest() - before);
  strace.signal(SIGINT);
  ASSERT_TRUE(strace.wait(kLong));
  double receives = 0, sends = 0, others = 0;
  std::istringstream lines(file_text(table));
  std::string said;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string name;
    double calls = 0;
    if (!(words >> name >> calls) || name == "total") continue;
    said += name + " " + std::to_string(calls) + "; ";
    const bool receive = name == "recvmmsg" || name == "recvmsg";
    (receive ? receives : name == "sendto" ? sends : others) += calls;
  }
  ASSERT_GT(exchanges, 1000);
  EXPECT_NEAR(sends, exchanges, 2) << said;
  EXPECT_GE(receives, exchanges - 2) << said;
  // A station that is kept waiting by its machine lets the server's wait end by its own time, some
  // milliseconds.
  EXPECT_LE(receives, 1.5 * exchanges) << said;
  // The wait that the tracing began in may be begun anew (restart_syscall), nothing else.
  EXPECT_LE(others, 1) << said;
}

}  // namespace
}  // namespace telenano::programs
