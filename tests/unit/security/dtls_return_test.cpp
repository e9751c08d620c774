// Stations that come back: from the same address or another, to the same worker of a server or another, after
// an outage, a restart, or with a key that has changed meanwhile.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "telenano/common/security/dtls_record.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

TEST(Dtls, TheSameAddressComesAgainWithoutEndingTheOldOneFirst) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  auto old = std::move(rig.station);
  rig.connect();                                  // a second station program on the same port
  rig.server->receive(rig.buffer, rig.received);  // its first Hello: a cookie
  EXPECT_EQ(rig.server->established(), 1u);
  old->send(bytes_of("old"), rig.server_end.address());
  EXPECT_TRUE(rig.server->receive(rig.buffer, rig.received));  // still served
  rig.turns(4);
  EXPECT_TRUE(rig.station->established());
  EXPECT_EQ(rig.server->established(), 1u);
  EXPECT_TRUE(rig.hears("new"));
  old->send(bytes_of("old"), rig.server_end.address());
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
}

TEST(Dtls, AnEndedAssociationIsForgottenAndMadeAnew) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  rig.station.reset();
  rig.turn();
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_EQ(rig.events(Event::kClosed), 1u);

  rig.connect();
  rig.turns(4);
  ASSERT_TRUE(rig.station->established());
  rig.server = std::make_unique<DtlsServer>(DtlsServerConfig{}, two_keys(), rig.server_end, rig.clock);
  rig.turn();  // the old one's farewell
  EXPECT_FALSE(rig.station->established());
  rig.pass_ms(501);
  rig.turns(6);
  EXPECT_TRUE(rig.station->established());
}

// kill -9 of the server: no farewell. The station notices the silence and makes a new association.
TEST(Dtls, AServerThatWasKilledAndComesBackIsFound) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  rig.network.cut = true;
  rig.server = std::make_unique<DtlsServer>(DtlsServerConfig{}, two_keys(), rig.server_end, rig.clock);
  rig.network.cut = false;
  EXPECT_FALSE(rig.hears("anybody?"));
  EXPECT_EQ(rig.events(Event::kNoHandshake), 1u);
  rig.pass_ms(501);
  rig.turns(6);
  EXPECT_TRUE(rig.hears("there you are"));
  EXPECT_EQ(rig.station->counters().handshakes, 2u);
  EXPECT_EQ(rig.station->counters().resumed, 0u);  // the new server does not know the old keys
}

/// The station is at another address from now on, and `server` is whom the kernel gives that to. Counted in
/// flights of one half round trip each, from noticing until the Hello of the session is there.
int round_trips_from_another_address(DtlsRig& rig, DtlsServer& server) {
  rig.station_end.set_address(DatagramNet::address(3, 41000));
  rig.station->receive(rig.station_buffer, rig.station_received);
  rig.station->send(bytes_of("lost: this address is not known"), rig.server_end.address());
  server.receive(rig.buffer, rig.received);
  rig.station->receive(rig.station_buffer, rig.station_received);
  rig.pass_ms(501);
  rig.station->receive(rig.station_buffer, rig.station_received);  // silence noticed: begins
  std::vector<std::uint8_t> hello(512, 0);
  std::copy_n("TLNO\x01\x01", 6, hello.begin());
  rig.station->send(hello, rig.server_end.address());
  int round_trips = 0;
  while (!server.receive(rig.buffer, rig.received) && round_trips < 10) {
    rig.station->receive(rig.station_buffer, rig.station_received);
    ++round_trips;
  }
  return round_trips;
}

// Cookie 1 round trip, resumed handshake 1, and the Hello of the session goes out with its end.
TEST(Dtls, ANewAddressTakesTwoRoundTripsAndTheHelloGoesWithTheLast) {
  DtlsRig rig;
  rig.connect_without_id();
  rig.turns(4);
  EXPECT_EQ(round_trips_from_another_address(rig, *rig.server), 2);
  EXPECT_EQ(rig.received.size, 512u);
  EXPECT_TRUE(rig.received.from == rig.station_end.address());
  EXPECT_EQ(rig.station->counters().resumed, 1u);
}

// Of two workers on one port, the kernel gives a new address to either.
TEST(Dtls, ANewAddressThatAnotherWorkerServesTakesNoRoundTripMore) {
  for (const bool shared : {true, false}) {
    DtlsServerConfig config;
    if (shared) config.resumption = std::make_shared<ResumptionCache>(16);
    DtlsRig rig(two_keys(), config);
    DtlsServer other(config, two_keys(), rig.server_end, rig.clock);
    rig.connect("guest", 2);
    rig.turns(4);
    EXPECT_EQ(round_trips_from_another_address(rig, other), shared ? 2 : 3);
    EXPECT_EQ(rig.received.size, 512u);
    EXPECT_EQ(rig.received.standing.rights, net::Rights::kObserve);
    EXPECT_STREQ(other.identity(rig.station_end.address()), "guest");
    EXPECT_EQ(rig.station->counters().resumed, shared ? 1u : 0u);
  }
}

// The worker that a station comes back to may have the new list a moment before the one that it comes from.
TEST(Dtls, AnAssociationUnderAnOldListIsResumedUnderTheNewOneByNobody) {
  for (const bool change_key : {true, false}) {
    DtlsServerConfig config;
    config.resumption = std::make_shared<ResumptionCache>(16);
    DtlsRig rig(two_keys(), config);
    DtlsServer ahead(config, two_keys(), rig.server_end, rig.clock);
    KeyList list = two_keys();
    if (change_key) list.keys[0].psk = psk_of(9);
    ahead.offer_keys(list);
    ahead.receive(rig.buffer, rig.received);
    rig.connect();
    rig.turns(4);
    ASSERT_TRUE(rig.station->established()) << "by the worker that has the old list";
    const int round_trips = round_trips_from_another_address(rig, ahead);
    EXPECT_EQ(rig.station->counters().resumed, change_key ? 0u : 1u);
    EXPECT_EQ(ahead.established(), change_key ? 0u : 1u);
    EXPECT_TRUE(change_key || round_trips == 2) << round_trips;
  }
}

// The list is handed to every worker once more when the server has begun to serve, to one after the other.
// What was agreed on before the last one has it must serve for coming back.
TEST(Dtls, TheSameListAgainLeavesAllThatWasAgreedOn) {
  DtlsServerConfig config;
  config.resumption = std::make_shared<ResumptionCache>(16);
  DtlsRig rig(two_keys(), config);
  DtlsServer behind(config, two_keys(), rig.server_end, rig.clock);
  rig.connect();
  rig.turns(4);
  ASSERT_TRUE(rig.station->established());
  behind.offer_keys(two_keys());
  behind.receive(rig.buffer, rig.received);
  EXPECT_EQ(round_trips_from_another_address(rig, behind), 2);
  EXPECT_EQ(rig.station->counters().resumed, 1u);
}

TEST(Dtls, TheSameListAgainLeavesAHandshakeUnderWay) {
  DtlsRig rig;
  rig.connect();
  rig.turns(2);
  ASSERT_EQ(rig.server->under_way(), 1u);
  rig.server->offer_keys(two_keys());
  rig.turns(2);
  EXPECT_TRUE(rig.station->established()) << "without a repetition: the clock stands still";
}

// With a list that did change: what one worker has agreed on under the new one does not go when the next
// worker gets it, what was agreed on under the old one does.
TEST(Dtls, AnAssociationUnderTheNewListIsResumedByTheWorkerThatGetsItLater) {
  for (const bool under_new : {true, false}) {
    DtlsServerConfig config;
    config.resumption = std::make_shared<ResumptionCache>(16);
    DtlsRig rig(two_keys(), config);
    DtlsServer behind(config, two_keys(), rig.server_end, rig.clock);
    KeyList longer = two_keys();
    longer.keys.push_back({"omega-2", psk_of(3), net::Rights::kOperate});
    const auto adopt = [&](DtlsServer& server) {
      server.offer_keys(longer);
      server.receive(rig.buffer, rig.received);
    };
    if (under_new) adopt(*rig.server);
    rig.connect();
    rig.turns(4);
    ASSERT_TRUE(rig.station->established());
    adopt(behind);
    EXPECT_EQ(round_trips_from_another_address(rig, behind), under_new ? 2 : 3);
    EXPECT_EQ(rig.station->counters().resumed, under_new ? 1u : 0u);
  }
}

// An outage that ends while the station is at a new handshake: the old association goes on giving.
TEST(Dtls, TheOldAssociationGivesUntilTheNewOneIsComplete) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  rig.station->send(bytes_of("lost"), rig.server_end.address());
  rig.pass_ms(501);
  rig.network.cut = true;
  rig.station->receive(rig.station_buffer, rig.station_received);
  ASSERT_EQ(kind_of(rig.network.sent().back().bytes), RecordKind::kClientHello);
  rig.network.cut = false;
  rig.server->send(bytes_of("force"), rig.station_end.address());
  ASSERT_TRUE(rig.station->receive(rig.station_buffer, rig.station_received));
  EXPECT_EQ(std::memcmp(rig.station_buffer.data(), "force", 5), 0);
  EXPECT_TRUE(rig.station->established());
}

// Also when the address stays: the association that is replaced must leave its keys to the next.
TEST(Dtls, KeysAreResumedAgainAndAgain) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  for (std::uint64_t times = 1; times <= 3; ++times) {
    rig.station->send(bytes_of("lost"), rig.server_end.address());
    rig.network.drop_waiting(rig.server_end.address());
    rig.pass_ms(501);
    rig.turns(6);
    EXPECT_EQ(rig.station->counters().handshakes, times + 1);
    EXPECT_EQ(rig.station->counters().resumed, times);
    EXPECT_EQ(rig.server->established(), 1u);
  }
}

TEST(Dtls, AHelloThatIsRepeatedWhenAllIsDoneBeginsNothing) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  const auto sent = rig.network.sent();
  for (const auto& packet : sent) {
    if (!(packet.to == rig.server_end.address())) continue;
    rig.network.deliver(packet);
    rig.server->receive(rig.buffer, rig.received);
    EXPECT_EQ(rig.server->under_way(), 0u);
  }
  EXPECT_TRUE(rig.hears("still here"));
}

TEST(Dtls, ARevokedKeyEndsWithItsAssociationAndCannotResume) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  KeyList shorter = two_keys();
  shorter.keys.erase(shorter.keys.begin());
  rig.server->offer_keys(shorter);
  rig.turn();
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_EQ(rig.events(Event::kRevoked), 1u);
  EXPECT_FALSE(rig.station->established());
  rig.pass_ms(501);
  rig.turns(6);
  EXPECT_FALSE(rig.station->established());
  EXPECT_TRUE(rig.station->refused());
}

TEST(Dtls, ANewKeyOrRightOfTheSameNameEndsTheOldAssociation) {
  for (const bool change_key : {true, false}) {
    DtlsRig rig;
    rig.connect();
    rig.turns(4);
    rig.server->offer_keys(two_keys());  // the same again: nobody notices
    rig.turn();
    EXPECT_EQ(rig.server->established(), 1u);
    KeyList other = two_keys();
    if (change_key) other.keys[0].psk = psk_of(9);
    if (!change_key) other.keys[0].rights = net::Rights::kObserve;
    rig.server->offer_keys(other);
    rig.turn();
    EXPECT_EQ(rig.server->established(), 0u);
    rig.pass_ms(501);
    rig.turns(6);
    EXPECT_EQ(rig.station->established(), !change_key);
    EXPECT_EQ(rig.station->counters().resumed, 0u);
    if (!change_key) {
      ASSERT_TRUE(rig.hears("hello"));
      EXPECT_EQ(rig.received.standing.rights, net::Rights::kObserve);
    }
  }
}

// The list comes from another thread than the loop's, many times while a session runs.
TEST(Dtls, ListsComeFromAnotherThread) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  std::atomic<bool> done{false};
  std::thread other([&] {
    for (int i = 0; i < 300; ++i) {
      rig.server->offer_keys(two_keys());
      if (i % 10 == 0) std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    done = true;
  });
  int heard = 0, said = 0;
  while (!done) {
    rig.pass_ms(1);  // within what one peer may send
    heard += rig.hears("tick") ? 1 : 0;
    ++said;
    rig.network.sent().clear();
  }
  other.join();
  EXPECT_EQ(heard, said);
  EXPECT_EQ(rig.server->established(), 1u);
  EXPECT_EQ(rig.events(Event::kRevoked), 0u);
}

}  // namespace
}  // namespace telenano::security
