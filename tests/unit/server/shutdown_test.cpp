// The server's end, and what is reaped meanwhile.
#include <gtest/gtest.h>

#include <deque>

#include "telenano/nve_server/server/server_shutdown.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

/// Time goes on by what is waited for.
class WaitClock final : public rt::Clock {
 public:
  std::int64_t now_ns() const noexcept override { return ns; }
  std::int64_t ns = 0;
};

class Wire final : public net::Datagram {
 public:
  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override {
    link::Incoming in;
    codec.decode(bytes, in);
    sent.push_back({in.type, in.bye, in.refuse, to});
    return net::SendStatus::kSent;
  }
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override {
    if (waiting.empty()) return false;
    received = {};
    received.size = waiting.front().size();
    std::copy(waiting.front().begin(), waiting.front().end(), buffer.begin());
    received.from = from;
    waiting.pop_front();
    return true;
  }
  struct Sent {
    link::MessageType type;
    link::Bye bye;
    link::Refuse refuse;
    net::Address to;
  };
  link::Codec codec;
  std::vector<Sent> sent;
  std::deque<std::vector<std::uint8_t>> waiting;
  net::Address from;
};

struct Shutdown : testing::Test {
  Shutdown() : server(test_config(), spring_scene(&slave)), s(&server, {}, {}, {}, 1) {}
  void establish() {
    s.client.start(0);
    s.ticks(50);
    clock.ns = s.now_ns;
    wire.from = s.link.address_a();
  }
  void shut(const ShutdownOptions& options = {}) {
    shut_down(
        server, wire, clock, [this](std::int64_t ns) { wait(ns); }, options);
  }
  void wait(std::int64_t ns) {
    clock.ns += ns;
    if (on_wait) on_wait();
  }
  template <class Message>
  void comes(const Message& message) {
    std::array<std::uint8_t, 512> bytes{};
    const std::size_t n = wire.codec.encode(message, bytes);
    wire.waiting.emplace_back(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
  }
  SpringSlave* slave = nullptr;
  Server server;
  VirtualSession s;
  WaitClock clock;
  Wire wire;
  std::function<void()> on_wait;
};

TEST_F(Shutdown, WithoutSessionsIsAtOnce) {
  shut();
  EXPECT_EQ(clock.ns, 0);
  EXPECT_TRUE(wire.sent.empty());
}

TEST_F(Shutdown, SaysByeThreeTimesWithdrawsAndAnswersMeanwhile) {
  establish();
  ASSERT_EQ(slave->commanded_w_nm().z(), -3);
  const std::int64_t start_ns = clock.ns;
  int waits = 0;
  on_wait = [&] {
    if (++waits != 50) return;
    link::Hello hello;
    hello.nonce = 77;
    comes(hello);
    link::Command c = s.command;
    c.session_id = s.client.welcome().session_id;
    c.epoch = s.client.welcome().epoch;
    c.sequence = 100;
    comes(c);
  };
  shut();
  // From −3 to 100 nm at 1000 nm/s, and 50 ms at rest.
  EXPECT_EQ(slave->commanded_w_nm().z(), 100);
  EXPECT_NEAR(1e-6 * static_cast<double>(clock.ns - start_ns), 153, 4);
  int byes = 0, refusals = 0;
  for (const auto& sent : wire.sent) {
    if (sent.type == link::MessageType::kRefuse) {
      ++refusals;
      EXPECT_EQ(sent.refuse.reason, link::RefuseReason::kShuttingDown);
      EXPECT_EQ(sent.refuse.nonce, 77u);
      continue;
    }
    ASSERT_EQ(sent.type, link::MessageType::kBye);
    ++byes;
    EXPECT_EQ(sent.bye.reason, link::ByeReason::kShuttingDown);
    EXPECT_EQ(sent.bye.session_id, s.client.welcome().session_id);
    EXPECT_EQ(sent.to, s.link.address_a());
  }
  EXPECT_EQ(byes, 4) << "three, and one for the command that still came";
  EXPECT_EQ(refusals, 1);
  EXPECT_EQ(slave->last_input.follow, false);
}

TEST_F(Shutdown, IsBoundAndASecondSignalEndsItAtOnce) {
  establish();
  slave->broken_nn = std::numeric_limits<double>::quiet_NaN();  // never arrives: its outputs are not used
  std::atomic<bool> at_once{false};
  ShutdownOptions options;
  options.at_once = &at_once;
  const std::int64_t start_ns = clock.ns;
  on_wait = [&] { at_once = clock.ns - start_ns >= 30'000'000; };
  shut(options);
  EXPECT_EQ(clock.ns - start_ns, 30'000'000);
}

TEST_F(Shutdown, OfASlaveThatIsSlowTakesNoLongerThanAllowed) {
  establish();
  ShutdownOptions options;
  options.at_most_ns = 80'000'000;
  const std::int64_t start_ns = clock.ns;
  shut(options);
  EXPECT_LE(clock.ns - start_ns, 82'000'000);
  EXPECT_NEAR(slave->commanded_w_nm().z(), 77, 3) << "on its way up all the time";
}

TEST_F(Shutdown, OfASharedTipWithdrawsItToo) {
  ServerConfig config = test_config();
  config.share = Share::kOneTip;
  Server shared(config, spring_scene(&slave));
  VirtualSession v(&shared, {}, {}, {}, 1);
  v.client.start(0);
  v.ticks(5);
  v.command.tip_hold = 1;
  v.ticks(20);
  ASSERT_EQ(slave->commanded_w_nm().z(), -3);
  clock.ns = v.now_ns;
  shut_down(shared, wire, clock, [this](std::int64_t ns) { wait(ns); }, {});
  EXPECT_EQ(slave->commanded_w_nm().z(), 100);
}

// A session costs a slot and a slave from its Welcome on, whatever its station does then.
TEST(Reaping, ASessionThatSendsNothingOrFallsSilentIsForgotten) {
  int made = 0;
  ServerConfig config = test_config();
  config.table.timeout_ns = 300'000'000;
  config.table.resume_ns = 1'000'000'000;
  Server server(config, spring_scene(nullptr, &made));
  VirtualSession s(&server, {}, {}, {}, 1);
  s.client.start(0);
  s.run_until(1'000'000);
  while (server.sessions().active() == 0) {  // only the handshake: not one command
    s.run_until(s.now_ns += VirtualSession::kTickNs);
    if (const std::size_t n = s.client.poll(s.now_ns, s.buffer)) s.link.a().send({s.buffer.data(), n}, {});
  }
  const std::int64_t opened_ns = s.now_ns;
  // Its first command may take a round trip of up to two seconds, whatever the scene's time-out.
  server.poll(opened_ns + 1'999'000'000);
  EXPECT_EQ(server.sessions().occupied(), 1u);
  server.poll(opened_ns + 2'002'000'000);
  EXPECT_EQ(server.sessions().occupied(), 0u) << "nothing to resume";

  s.now_ns = opened_ns + 2'002'000'000;
  s.ticks(600);  // its station is told, and opens another one
  ASSERT_TRUE(s.client.has_reply());
  EXPECT_EQ(server.sessions().active(), 1u);
  const std::int64_t last_ns = s.now_ns;
  server.poll(last_ns + 302'000'000);
  EXPECT_EQ(server.sessions().active(), 0u);
  EXPECT_EQ(server.sessions().occupied(), 1u) << "silent, resumable";
  server.poll(last_ns + 1'290'000'000);
  EXPECT_EQ(server.sessions().occupied(), 1u);
  server.poll(last_ns + 1'310'000'000);
  EXPECT_EQ(server.sessions().occupied(), 0u);
  EXPECT_EQ(server.counters().timed_out, 1u);
}

}  // namespace
}  // namespace telenano::server
