// The real-time loop over real loopback UDP: what virtual time cannot show.
#include "telenano/nve_server/server/server_loop.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "telenano/common/net/udp.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

class ChronoClock final : public rt::Clock {
 public:
  std::int64_t now_ns() const noexcept override {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
  }
};

struct LoopFixture {
  explicit LoopFixture(bool busy_poll)
      : socket(net::Udp::listen(net::parse_address("127.0.0.1:0", "test"))), address(socket.local()) {
    options.busy_poll = busy_poll;
    thread = std::thread([this] {
      run_loop(
          server, socket, clock, [this](std::int64_t t) { socket.wait_readable(t); }, stop, options, status);
    });
  }
  ~LoopFixture() { shut_down(); }
  void shut_down() {
    stop = true;
    if (thread.joinable()) thread.join();
  }

  ChronoClock clock;
  net::Udp socket;
  net::Address address;
  Server server{test_config(), spring_scene()};
  LoopOptions options;
  LoopStatus status;
  std::atomic<bool> stop{false};
  std::thread thread;
};

class Loop : public testing::TestWithParam<bool> {};

TEST_P(Loop, ServesAndSaysByeWhenStopped) {
  LoopFixture loop(GetParam());
  net::Udp socket = net::Udp::open_for(loop.address);
  link::ClientSession client({});
  std::array<std::uint8_t, 512> buffer{};
  net::Received received;
  const auto give_up_ns = loop.clock.now_ns() + 20'000'000'000;  // far beyond what a loaded machine needs
  const auto pump = [&] {
    socket.wait_readable(1'000'000);
    while (socket.receive(buffer, received)) {
      EXPECT_EQ(received.from, loop.address);
      client.on_datagram({buffer.data(), received.size}, loop.clock.now_ns());
    }
    if (const std::size_t n = client.poll(loop.clock.now_ns(), buffer))
      socket.send({buffer.data(), n}, loop.address);
  };
  client.start(loop.clock.now_ns());
  while (client.replies().newest() < 200 && loop.clock.now_ns() < give_up_ns) {
    pump();
    link::Command c = VirtualSession::engaged();
    if (const std::size_t n = client.make_command(c, loop.clock.now_ns(), buffer)) {
      socket.send({buffer.data(), n}, loop.address);
    }
  }
  ASSERT_EQ(client.state(), link::ClientState::kEstablished);
  EXPECT_EQ(client.reply().force_w_nn.z(), 3);
  EXPECT_GT(client.stats().samples(), 100u);
  EXPECT_EQ(client.stats().rejected(), 0u);
  EXPECT_GT(client.reply().hold_time_ns, 0u);

  loop.shut_down();
  while (client.state() == link::ClientState::kEstablished && loop.clock.now_ns() < give_up_ns) pump();
  EXPECT_EQ(client.bye_reason(), link::ByeReason::kShuttingDown);
  EXPECT_GE(loop.status.exchanges.load(), 200u);
  // What was on its way when the server stopped is answered, but not used.
  EXPECT_EQ(loop.server.drops().total(), loop.server.drops()[link::DropCause::kUnexpected]);
}

TEST_P(Loop, SaysWhenItTurnedLast) {
  LoopFixture loop(GetParam());
  const std::int64_t asked_ns = loop.clock.now_ns();
  const std::int64_t give_up_ns = asked_ns + 20'000'000'000;
  while (loop.status.turned_ns <= asked_ns && loop.clock.now_ns() < give_up_ns) std::this_thread::yield();
  EXPECT_GT(loop.status.turned_ns, asked_ns);
  EXPECT_LE(loop.status.turned_ns, loop.clock.now_ns());
}

INSTANTIATE_TEST_SUITE_P(Waiting, Loop, testing::Values(false, true),
                         [](const auto& instance) { return instance.param ? "BusyPoll" : "Blocking"; });

TEST(LoopDrops, OversizeDatagramsAreSeenAsSuch) {
  LoopFixture loop(false);
  net::Udp socket = net::Udp::open_for(loop.address);
  const std::array<std::uint8_t, 2000> big{};
  socket.send(big, loop.address);
  socket.send({big.data(), 512}, loop.address);
  const auto give_up_ns = loop.clock.now_ns() + 20'000'000'000;
  while (loop.status.drops.load() < 2 && loop.clock.now_ns() < give_up_ns) socket.wait_readable(1'000'000);
  loop.shut_down();
  EXPECT_EQ(loop.server.drops()[link::DropCause::kOversize], 1u);
  EXPECT_EQ(loop.server.drops()[link::DropCause::kBadMagic], 1u);
}

}  // namespace
}  // namespace telenano::server
