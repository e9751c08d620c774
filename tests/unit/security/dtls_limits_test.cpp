// What one peer, one address or a crowd can take of the server, and what a bad network can.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>
#include <vector>

#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

TEST(Dtls, AnIdleAssociationIsForgotten) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  rig.pass_ms(119'000);
  ASSERT_TRUE(rig.hears("still here"));
  rig.pass_ms(119'000);
  rig.server->receive(rig.buffer, rig.received);
  EXPECT_EQ(rig.server->established(), 1u);
  rig.pass_ms(2'000);
  rig.server->receive(rig.buffer, rig.received);
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_EQ(rig.events(Event::kIdle), 1u);
}

TEST(Dtls, HandshakesThatNeverFinishKeepOnlyAQuarterOfTheRoom) {
  DtlsServerConfig config;
  config.capacity = 16;
  config.handshakes_per_address_s = 1e6;
  config.handshakes_per_address_burst = 1e6;
  DtlsRig rig(two_keys(), config);
  rig.connect();
  rig.turns(4);
  ASSERT_TRUE(rig.station->established());
  DatagramNet::End end(rig.network, DatagramNet::address(8, 1));
  std::vector<std::unique_ptr<DtlsClient>> crowd;
  for (std::uint16_t i = 0; i < 40; ++i) {  // each shows its cookie, then falls silent
    end.set_address(DatagramNet::address(8, i));
    DtlsClientConfig station;
    station.key = StationKey{"omega-1", psk_of(1)};
    crowd.push_back(std::make_unique<DtlsClient>(station, end, rig.server_end.address(), rig.clock));
    rig.server->receive(rig.buffer, rig.received);
    crowd.back()->receive(rig.station_buffer, rig.station_received);
    rig.server->receive(rig.buffer, rig.received);
    EXPECT_LE(rig.server->under_way(), 4u);
  }
  EXPECT_EQ(rig.server->under_way(), 4u);
  EXPECT_TRUE(rig.hears("not disturbed"));
}

TEST(Dtls, OneAddressBeginsOnlySoManyHandshakes) {
  DtlsRig rig;
  int made = 0;
  for (std::uint16_t i = 0; i < 60; ++i) {
    rig.station_end.set_address(DatagramNet::address(2, i));
    rig.connect();
    rig.turns(4);
    made += rig.station->established() ? 1 : 0;
  }
  EXPECT_EQ(made, 16);  // the burst; time stands still
  EXPECT_GT(rig.events(Event::kRateLimited), 0u);
  rig.pass_ms(1000);
  for (std::uint16_t i = 100; i < 110; ++i) {
    rig.station_end.set_address(DatagramNet::address(2, i));
    rig.connect();
    rig.turns(4);
    made += rig.station->established() ? 1 : 0;
  }
  EXPECT_EQ(made, 20);  // four a second
}

TEST(Dtls, OnePeerSendsOnlySoMuch) {
  DtlsServerConfig config;
  config.datagrams_per_peer_s = 1000;
  config.datagrams_per_peer_burst = 50;
  DtlsRig rig(two_keys(), config);
  rig.connect();
  rig.turns(4);
  int taken = 0;
  for (int i = 0; i < 200; ++i) taken += rig.hears("flood") ? 1 : 0;
  EXPECT_EQ(taken, 50);
  EXPECT_EQ(rig.events(Event::kRateLimited), 150u);
}

TEST(Dtls, NoMoreAssociationsThanThereIsRoom) {
  DtlsServerConfig config;
  config.capacity = 4;
  config.handshakes_per_address_burst = 1000;
  DtlsRig rig(two_keys(), config);
  std::vector<std::unique_ptr<DtlsClient>> all;
  int made = 0;
  for (std::uint16_t i = 0; i < 8; ++i) {
    rig.station_end.set_address(DatagramNet::address(2, i));
    rig.connect();
    rig.turns(4);
    made += rig.station->established() ? 1 : 0;
    all.push_back(std::move(rig.station));
  }
  EXPECT_EQ(made, 4);
  EXPECT_EQ(rig.server->established(), 4u);
  EXPECT_EQ(rig.events(Event::kFull), 4u);
}

/// Every look at it takes so long: so do the steps of handshakes, by this clock.
class SlowClock final : public rt::Clock {
 public:
  explicit SlowClock(std::int64_t step_ns) : step_ns_(step_ns) {}
  std::int64_t now_ns() const noexcept override { return now_ns_ += step_ns_; }

 private:
  std::int64_t step_ns_;
  mutable std::int64_t now_ns_ = 1'000'000'000;
};

// A crowd that shows up all the time gets a tenth of the time, and a session its datagrams.
TEST(Dtls, HandshakesTakeATenthOfTheTimeAndNoMore) {
  DatagramNet network;
  DatagramNet::End server_end(network, DatagramNet::address(1, 5100)),
      station_end(network, DatagramNet::address(2, 1));
  SlowClock clock(250'000);
  rt::VirtualClock station_clock;
  station_clock.advance_to(1'000'000'000);
  DtlsServer server({}, two_keys(), server_end, clock, &clock);
  DtlsClientConfig config;
  config.key = StationKey{"omega-1", psk_of(1)};
  DtlsClient station(config, station_end, server_end.address(), station_clock);
  std::array<std::uint8_t, 513> buffer{};
  net::Received received;
  for (int i = 0; i < 6; ++i) {
    server.receive(buffer, received);
    station.receive(buffer, received);
  }
  ASSERT_TRUE(station.established());
  const auto hello = network.sent().at(0).bytes;
  const std::uint64_t cookies_before = server.counters()[Event::kCookies];
  const std::int64_t begin_ns = clock.now_ns();
  int heard = 0;
  for (int i = 0; i < 4000; ++i) {
    for (std::uint8_t k = 0; k < 20; ++k)
      network.deliver(
          {DatagramNet::address(100, static_cast<std::uint16_t>(20 * i + k)), server_end.address(), hello});
    station.send(bytes_of("tick"), server_end.address());
    while (server.receive(buffer, received)) ++heard;
    network.sent().clear();
  }
  const double elapsed_ns = static_cast<double>(clock.now_ns() - begin_ns);
  const double spent_ns =
      250'000.0 * static_cast<double>(server.counters()[Event::kCookies] - cookies_before);
  EXPECT_EQ(heard, 4000);
  EXPECT_LE(spent_ns, 0.1 * elapsed_ns + 2'000'000 + 250'000);
  EXPECT_GE(spent_ns, 0.09 * elapsed_ns);
  EXPECT_GT(server.counters()[Event::kRateLimited], 70'000u);
}

// A machine on which a step of a handshake takes 30 ms (emulated, or very busy) owes 0.3 s after each. A
// station that comes back after an outage resumes: it is done with its last flight, and begins anew when it
// hears nothing for half a second. Were that flight dropped for the debt, it would never come back. OpenSSL
// repeats by the wall clock.
TEST(Dtls, AStationComesBackToAServerWhoseHandshakesAreSlow) {
  const SlowClock work(30'000'000);
  DtlsRig rig(two_keys(), {}, &work);
  const auto heard_within_s = [&rig](double limit_s) {
    const auto begin = std::chrono::steady_clock::now();
    for (;;) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      rig.pass_ms(5);
      if (rig.station->established()) rig.station->send(bytes_of("tick"), rig.server_end.address());
      if (rig.turn()) return true;
      const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin;
      if (passed.count() > limit_s) return false;
    }
  };
  rig.connect_without_id();
  ASSERT_TRUE(heard_within_s(20));
  rig.station_end.set_address(DatagramNet::address(3, 41000));  // what it was known by is of no use any more
  EXPECT_TRUE(heard_within_s(20));
  EXPECT_EQ(rig.station->counters().resumed, 1u) << "at the first attempt";
  EXPECT_EQ(rig.server->under_way(), 0u);
}

// Loss, repetition and reordering: a quarter of everything is lost. OpenSSL repeats by the wall clock.
TEST(Dtls, HandshakesEndOverABadNetwork) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    DtlsServerConfig config;
    DtlsRig rig(two_keys(), config);
    rig.network = DatagramNet(seed);
    rig.network.loss = 0.25;
    rig.network.duplicate = 0.2;
    rig.network.hold_back = 0.2;
    rig.connect();
    const auto begin = std::chrono::steady_clock::now();
    bool heard = false;
    while (!heard && std::chrono::steady_clock::now() - begin < std::chrono::seconds(20)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      rig.pass_ms(5);
      if (rig.station->established()) rig.station->send(bytes_of("here"), rig.server_end.address());
      heard = rig.turn();
    }
    EXPECT_TRUE(heard) << seed;
  }
}

}  // namespace
}  // namespace telenano::security
