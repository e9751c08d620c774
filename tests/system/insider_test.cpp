// One session that asks for as much of the server as the protocol lets it, beside an ordinary one: what its
// commands cost must not be the other's wait.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/common/link/codec.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

constexpr std::int64_t kTickNs = 1'000'000;

/// A socket and a session, from an address of its own: in the clear each address is a party.
struct Peer {
  Peer(const net::Address& at, const std::string& from, const link::ClientConfig& config)
      : server(at), socket(net::Udp::listen(net::parse_address(from, "test"))), client(config) {
    client.start(clock.now_ns());
  }
  bool opened() {
    const std::int64_t end_ns = clock.now_ns() + 30'000'000'000;
    while (client.state() != link::ClientState::kEstablished && clock.now_ns() < end_ns) {
      if (const std::size_t n = client.poll(clock.now_ns(), buffer)) socket.send({buffer.data(), n}, server);
      socket.wait_readable(1'000'000);
      receive([](const link::Reply&) {});
    }
    return client.state() == link::ClientState::kEstablished;
  }
  template <class OnReply>
  void receive(OnReply&& on_reply) {
    net::Received received;
    while (socket.receive(buffer, received)) {
      if (client.on_datagram({buffer.data(), received.size}, clock.now_ns()) == link::ClientEvent::kReply)
        on_reply(client.reply());
    }
  }

  rt::SteadyClock clock;
  net::Address server;
  net::Udp socket;
  link::ClientSession client;
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer{};
};

struct Figures {
  std::uint64_t sent = 0;
  std::uint64_t answered = 0;
  std::vector<double> rtt_ms;  // sorted
  double answered_percent() const {
    return sent > 0 ? 100.0 * static_cast<double>(answered) / static_cast<double>(sent) : 0;
  }
  double quantile_ms(double q) const {
    if (rtt_ms.empty()) return 1e9;
    return rtt_ms[std::min(rtt_ms.size() - 1,
                           static_cast<std::size_t>(q * static_cast<double>(rtt_ms.size())))];
  }
};

/// An ordinary station: 1 kHz, engaged, over the sample.
Figures neighbour(const net::Address& at, double seconds) {
  link::ClientConfig config;
  config.nonce_seed = 11;
  Peer peer(at, "127.0.0.1:0", config);
  Figures figures;
  EXPECT_TRUE(peer.opened());
  link::Command command;
  command.flags = link::kFlagClutch | link::kFlagDeadman;
  const auto on_reply = [&](const link::Reply& reply) {
    ++figures.answered;
    figures.rtt_ms.push_back(
        1e-6 *
        static_cast<double>(peer.clock.now_ns() - static_cast<std::int64_t>(reply.command_send_time_ns)));
  };
  const std::int64_t begin_ns = peer.clock.now_ns();
  const std::int64_t end_ns = begin_ns + static_cast<std::int64_t>(1e9 * seconds);
  for (std::int64_t next_ns = begin_ns; next_ns < end_ns; next_ns += kTickNs) {
    for (std::int64_t now; (now = peer.clock.now_ns()) < next_ns;) {
      peer.socket.wait_readable(next_ns - now);
      peer.receive(on_reply);
    }
    command.tip_pos_w_nm = peer.client.welcome().start_pos_w_nm;
    if (const std::size_t n = peer.client.make_command(command, peer.clock.now_ns(), peer.buffer)) {
      peer.socket.send({peer.buffer.data(), n}, at);
      ++figures.sent;
    }
  }
  // What is answered half a second late is of no use to a hand.
  const std::int64_t late_ns = peer.clock.now_ns() + 500'000'000;
  while (figures.answered < figures.sent && peer.clock.now_ns() < late_ns) {
    peer.socket.wait_readable(10'000'000);
    peer.receive(on_reply);
  }
  std::sort(figures.rtt_ms.begin(), figures.rtt_ms.end());
  return figures;
}

/// Ploughs from side to side as fast as its own clock says that time goes: each datagram brings five commands
/// that were not heard of before, a tenth of a second apart. The flags of its replies are gathered.
struct Insider {
  Insider(const net::Address& at, double per_s, double depth_nm)
      : peer(at, "127.0.0.2:0", config()), per_s_(per_s), depth_nm_(depth_nm) {
    EXPECT_TRUE(peer.opened());
    thread_ = std::thread([this] { run(); });
  }
  ~Insider() { stop(); }
  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }

  static link::ClientConfig config() {
    link::ClientConfig c;
    c.nonce_seed = 99;
    c.redundancy = link::kMaxRecent;
    return c;
  }

  Peer peer;
  std::uint64_t sent = 0;
  std::uint64_t answered = 0;
  std::uint32_t faults = 0;
  std::uint64_t marked = 0;

 private:
  void run() {
    link::Codec codec;
    link::Incoming incoming;
    const link::Welcome welcome = peer.client.welcome();
    link::Command command;
    command.session_id = welcome.session_id;
    command.epoch = welcome.epoch;
    command.flags = link::kFlagClutch | link::kFlagDeadman;
    command.send_time_ns = 1;
    double side_nm = 100;
    const auto place = [&](double x_nm) {
      return Vec3(welcome.start_pos_w_nm.x() + x_nm, welcome.start_pos_w_nm.y() + 0.3 * x_nm,
                  welcome.surface_z_w_nm - depth_nm_);
    };
    const std::int64_t begin_ns = peer.clock.now_ns();
    for (std::uint64_t k = 0; !stop_; ++k) {
      const std::int64_t next_ns =
          begin_ns + static_cast<std::int64_t>(1e9 * static_cast<double>(k) / per_s_);
      for (std::int64_t now; (now = peer.clock.now_ns()) < next_ns;) {
        peer.socket.wait_readable(next_ns - now);
        net::Received received;
        while (peer.socket.receive(peer.buffer, received)) {
          if (codec.decode({peer.buffer.data(), received.size}, incoming) != link::DropCause::kNone) continue;
          if (incoming.type != link::MessageType::kReply) continue;
          ++answered;
          faults |= incoming.reply.fault_bits;
        }
      }
      command.sequence += 1 + link::kMaxRecent;
      command.send_time_ns += (1 + link::kMaxRecent) * 100'000'000ull;
      link::RecentCommands recent;
      recent.count = link::kMaxRecent;
      for (std::size_t i = recent.count; i-- > 0;) {
        recent.record[i].age_ns = static_cast<std::uint32_t>((1 + i) * 100'000'000);
        recent.record[i].flags = command.flags;
        recent.record[i].tip_pos_w_nm = place(side_nm = -side_nm);
      }
      command.tip_pos_w_nm = place(side_nm = -side_nm);
      const std::size_t n = codec.encode(command, recent, peer.buffer);
      peer.socket.send({peer.buffer.data(), n}, peer.server);
      ++sent;
    }
  }

  double per_s_;
  double depth_nm_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

struct Attack {
  const char* scene;
  double per_s;
};

class InsiderTest : public ProgramsTest, public testing::WithParamInterface<Attack> {};

TEST_P(InsiderTest, TheNeighbourIsAnsweredInTime) {
  Server server(scene_path(GetParam().scene));
  const net::Address at = net::parse_address(server.address(), "test");
  const double seconds = 3;
  const Figures alone = neighbour(at, 0.5);
  Insider insider(at, GetParam().per_s, 10);
  const Figures beside = neighbour(at, seconds);
  insider.stop();
  std::printf(
      "%s %.0f/s: alone %.2f %% p50 %.3f ms; beside %.2f %% p50 %.3f p99 %.3f max %.3f ms; insider "
      "%llu of %llu answered, faults %x\n",
      GetParam().scene, GetParam().per_s, alone.answered_percent(), alone.quantile_ms(0.5),
      beside.answered_percent(), beside.quantile_ms(0.5), beside.quantile_ms(0.99), beside.quantile_ms(1),
      static_cast<unsigned long long>(insider.answered), static_cast<unsigned long long>(insider.sent),
      insider.faults);
  // On a quiet machine 99.9 % and a p99 below 2 ms; a busy one makes everybody wait.
  EXPECT_GE(beside.answered_percent(), 99.0);
  EXPECT_LT(beside.quantile_ms(0.5), 20.0);
  EXPECT_GT(insider.answered, 0u);
  if (std::getenv("TELENANO_QUIET_MACHINE") == nullptr) return;
  EXPECT_GE(beside.answered_percent(), 99.9);
  EXPECT_LT(beside.quantile_ms(0.99), 2.0);
}

INSTANTIATE_TEST_SUITE_P(Datagrams, InsiderTest,
                         testing::Values(Attack{"lithography", 300}, Attack{"lithography", 1000},
                                         Attack{"particle", 300}, Attack{"particle", 1000}),
                         [](const auto& instance) {
                           return std::string(instance.param.scene) + "_" +
                                  std::to_string(static_cast<int>(instance.param.per_s));
                         });

}  // namespace
}  // namespace telenano::programs
