// A whole session inside a secure channel: what each right allows, and how fast it comes back.
#include <gtest/gtest.h>

#include "telenano/common/link/client_session.h"
#include "telenano/common/security/dtls_record.h"
#include "tests/unit/security/dtls_rig.h"
#include "tests/unit/server/spring_slave.h"

namespace telenano::security {
namespace {

/// Station and server with their channels, one tick a millisecond.
struct SessionRig : DtlsRig {
  server::SpringSlave* slave = nullptr;
  server::Server nve;
  link::ClientSession session{link::ClientConfig{}};
  link::Command command;
  std::int64_t heard_ns = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};

  SessionRig() : nve(config(), server::spring_scene(&slave)) {
    command.flags = link::kFlagClutch | link::kFlagDeadman;
    command.tip_pos_w_nm = {1, 2, -3};
  }
  static server::ServerConfig config() {
    server::ServerConfig c;
    c.secret = {7, 8};
    return c;
  }
  void serve() {
    while (server->receive(buffer, received)) {
      const std::size_t n = nve.on_datagram({buffer.data(), received.size}, received.from, clock.now_ns(),
                                            out, nullptr, received.standing);
      if (n > 0) server->send({out.data(), n}, received.from);
    }
    nve.poll(clock.now_ns());
  }
  void tick() {
    pass_ms(1);
    serve();
    station_turn();
  }
  void hear() {
    while (station->receive(station_buffer, station_received)) {
      session.on_datagram({station_buffer.data(), station_received.size}, clock.now_ns());
      heard_ns = clock.now_ns();
    }
  }
  void station_turn() {
    hear();
    if (const std::size_t n = session.poll(clock.now_ns(), out))
      station->send({out.data(), n}, server_end.address());
    link::Command c = command;
    if (const std::size_t n = session.make_command(c, clock.now_ns(), out))
      station->send({out.data(), n}, server_end.address());
  }
  void ticks(int n) {
    for (int i = 0; i < n; ++i) tick();
  }
  void begin(const std::string& identity, std::uint8_t fill, bool connection_id = true) {
    if (connection_id) connect(identity, fill);
    if (!connection_id) connect_without_id(identity, fill);
    turns(4);
    ASSERT_TRUE(station->established());
    session.start(clock.now_ns());
    ticks(20);
    ASSERT_EQ(session.state(), link::ClientState::kEstablished);
  }
};

TEST(Rights, OperateMovesTheTip) {
  SessionRig rig;
  rig.begin("omega-1", 1);
  EXPECT_EQ(rig.slave->commanded_w_nm(), Vec3(1, 2, -3));
  EXPECT_EQ(rig.session.reply().force_w_nn.z(), 3);
}

TEST(Rights, ObserveIsAnsweredButMovesNothingAndCannotRetractEither) {
  SessionRig rig;
  rig.begin("guest", 2);
  const Vec3 start = rig.slave->commanded_w_nm();
  EXPECT_NE(start, Vec3(1, 2, -3));
  EXPECT_TRUE(rig.session.has_reply());
  EXPECT_EQ(rig.session.reply().force_w_nn.z(), 0);
  rig.command.flags |= link::kFlagStop;
  rig.ticks(50);
  EXPECT_EQ(rig.slave->commanded_w_nm(), start);
  EXPECT_EQ(rig.slave->retracts, 0u);
  EXPECT_GT(rig.session.commands_sent(), 50u);
  EXPECT_EQ(rig.nve.drops().total(), 0u);
}

// The session stays, its address too: only the channel is a new one, with less right.
TEST(Rights, ARightThatIsTakenAwayIsGoneWithinTheRunningSession) {
  SessionRig rig;
  rig.begin("omega-1", 1);
  KeyList less = two_keys();
  less.keys[0].rights = net::Rights::kObserve;
  rig.server->offer_keys(less);
  rig.ticks(1200);
  ASSERT_TRUE(rig.station->established());
  EXPECT_EQ(rig.session.state(), link::ClientState::kEstablished);
  const Vec3 before = rig.slave->commanded_w_nm();
  rig.command.tip_pos_w_nm = {50, 50, 5};
  rig.ticks(50);
  EXPECT_EQ(rig.slave->commanded_w_nm(), before);
}

// The channel has proven the address: no Challenge, and the Welcome after one round trip.
TEST(Rights, TheFirstHelloIsAnsweredByAWelcome) {
  SessionRig rig;
  rig.connect();
  rig.turns(4);
  rig.session.start(rig.clock.now_ns());
  rig.tick();
  EXPECT_EQ(rig.session.state(), link::ClientState::kHelloSent);
  rig.tick();
  EXPECT_EQ(rig.session.state(), link::ClientState::kEstablished);
}

/// From now on every datagram takes 10 ms, also what is under way.
class SlowPath {
 public:
  explicit SlowPath(SessionRig& rig) : rig_(rig) {}
  void turn() {
    delay(rig_.server_end.address());
    rig_.pass_ms(1);
    arrive(rig_.server_end.address());
    rig_.serve();
    delay(rig_.station_end.address());
    arrive(rig_.station_end.address());
    rig_.station_turn();
  }

 private:
  void delay(const net::Address& to) {
    for (auto& packet : rig_.network.waiting(to))
      under_way_.emplace_back(rig_.clock.now_ns() + 10'000'000, packet);
    rig_.network.drop_waiting(to);
  }
  void arrive(const net::Address& to) {
    std::erase_if(under_way_, [&](const auto& entry) {
      if (entry.first > rig_.clock.now_ns() || !(entry.second.to == to)) return false;
      rig_.network.deliver(entry.second);
      return true;
    });
  }
  SessionRig& rig_;
  std::deque<std::pair<std::int64_t, DatagramNet::Packet>> under_way_;
};

// The first command from the new address is answered there: one round trip of 20 ms without an answer, and a
// tick at each of its turns. What was on the way to the old address is lost.
TEST(Rights, AStationThatRoamsIsAnsweredAfterOneRoundTrip) {
  SessionRig rig;
  rig.begin("omega-1", 1);
  SlowPath path(rig);
  for (int ms = 0; ms < 100; ++ms) path.turn();
  for (std::uint16_t move = 1; move <= 5; ++move) {
    const auto before = rig.session.replies().newest();
    rig.station_end.set_address(DatagramNet::address(3, static_cast<std::uint16_t>(41000 + move)));
    const std::int64_t moved_ns = rig.clock.now_ns();
    std::int64_t longest_ns = 0, last_ns = rig.heard_ns;
    for (int ms = 0; ms < 100; ++ms) {
      path.turn();
      longest_ns = std::max(longest_ns, rig.clock.now_ns() - last_ns);
      last_ns = rig.heard_ns;
    }
    EXPECT_LE(longest_ns, 23'000'000) << move;
    EXPECT_GT(longest_ns, 10'000'000) << "else nothing moved";
    EXPECT_GE(rig.session.replies().newest(), before + 98);
    EXPECT_GT(rig.heard_ns, moved_ns);
  }
  EXPECT_EQ(rig.session.sessions(), 1u);
  EXPECT_EQ(rig.station->counters().handshakes, 1u);
}

// A NAT that gives the station another port while nothing is on the way: no command stays without its answer.
TEST(Rights, ANatThatRebindsBetweenTwoTicksCostsNoAnswer) {
  SessionRig rig;
  rig.begin("omega-1", 1);
  rig.serve();
  rig.hear();
  for (std::uint16_t move = 0; move <= 20; ++move) {
    if (move > 0)
      rig.station_end.set_address(DatagramNet::address(3, static_cast<std::uint16_t>(41000 + move)));
    for (int ms = 0; ms < 50; ++ms) {
      const std::uint64_t before = rig.session.replies().newest();
      rig.pass_ms(1);
      rig.station_turn();
      rig.serve();
      rig.hear();
      ASSERT_EQ(rig.session.replies().newest(), before + 1) << move << ", " << ms << " ms";
    }
  }
  EXPECT_EQ(rig.events(SecurityEvent::kMoved), 20u);
  EXPECT_EQ(rig.session.sessions(), 1u);
  EXPECT_EQ(rig.station->counters().handshakes, 1u);
}

// Without a connection id: cookie, resumed handshake, Hello → Welcome: three round trips from noticing to the
// same session in the same epoch. Here each way takes 10 ms.
TEST(Rights, AStationThatRoamsWithoutAnIdIsBackInThreeRoundTrips) {
  SessionRig rig;
  rig.begin("omega-1", 1, false);
  const auto epoch = rig.session.welcome().epoch;
  const auto sessions = rig.session.sessions();
  rig.station_end.set_address(DatagramNet::address(3, 41000));
  // Until the station notices: nothing answers from the new address.
  bool noticed = false;
  for (int ms = 0; ms < 1000 && !noticed; ++ms) {
    rig.network.sent().clear();
    rig.tick();
    for (const auto& packet : rig.network.sent())
      noticed |= kind_of(packet.bytes) == RecordKind::kClientHello;
  }
  ASSERT_TRUE(noticed);
  const std::int64_t noticed_ns = rig.clock.now_ns();
  SlowPath path(rig);
  for (int ms = 0; ms < 400 && rig.session.sessions() == sessions; ++ms) path.turn();
  ASSERT_EQ(rig.session.sessions(), sessions + 1);
  EXPECT_EQ(rig.session.welcome().epoch, epoch);
  // Three round trips of 20 ms, and up to a tick of 1 ms at each of the six turns.
  EXPECT_GE(rig.clock.now_ns() - noticed_ns, 60'000'000);
  EXPECT_LE(rig.clock.now_ns() - noticed_ns, 66'000'000);
}

}  // namespace
}  // namespace telenano::security
