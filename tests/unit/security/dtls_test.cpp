// Associations with pre-shared keys, in memory: who gets in, who does not, and what strangers can make the
// server do. Every datagram is a real one, made or changed by the test.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "common/security/dtls_record.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

TEST(Dtls, AKeyInTheListOpensBothWays) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  ASSERT_TRUE(rig.station->established());
  EXPECT_EQ(rig.server->established(), 1u);
  EXPECT_EQ(rig.server->under_way(), 0u);
  EXPECT_STREQ(rig.server->identity(rig.station_end.address()), "omega-1");
  ASSERT_TRUE(rig.hears("approach"));
  EXPECT_TRUE(rig.received.from == rig.station_end.address());
  EXPECT_TRUE(rig.received.standing.address_proven);
  EXPECT_EQ(rig.received.standing.rights, net::Rights::kOperate);

  EXPECT_EQ(rig.server->send(bytes_of("contact"), rig.station_end.address()), net::SendStatus::kSent);
  ASSERT_TRUE(rig.station->receive(rig.station_buffer, rig.station_received));
  EXPECT_EQ(std::memcmp(rig.station_buffer.data(), "contact", 7), 0);
  EXPECT_EQ(rig.server->send(bytes_of("x"), DatagramNet::address(9, 9)), net::SendStatus::kFailed);
}

TEST(Dtls, RightsAreThoseOfTheKey) {
  DtlsRig rig;
  rig.connect("guest", 2);
  rig.turns(4);
  ASSERT_TRUE(rig.hears("look"));
  EXPECT_EQ(rig.received.standing.rights, net::Rights::kObserve);
}

// What travels must not contain what is said, and must be longer by the seal's bytes exactly.
TEST(Dtls, NothingTravelsInTheClear) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  const std::string secret = "force 1.25 nN at the tip, quite recognisable";
  ASSERT_TRUE(rig.hears(secret));
  const auto& last = rig.network.sent().back().bytes;
  EXPECT_EQ(last.size(), secret.size() + kSealBytes);
  for (const auto& packet : rig.network.sent()) {
    EXPECT_EQ(std::search(packet.bytes.begin(), packet.bytes.end(), secret.begin() + 5, secret.begin() + 13),
              packet.bytes.end());
  }
  // Neither does the key: 4 of its equal bytes in a row would be a chance of 1e-7 for these few datagrams.
  const std::array<std::uint8_t, 8> key{1, 1, 1, 1, 1, 1, 1, 1};
  for (const auto& packet : rig.network.sent())
    EXPECT_EQ(std::search(packet.bytes.begin(), packet.bytes.end(), key.begin(), key.end()),
              packet.bytes.end());
}

TEST(Dtls, AnUnknownIdentityIsToldAtOnce) {
  DtlsRig rig;
  rig.connect("omega-9", 1);
  rig.turns(4);
  EXPECT_FALSE(rig.station->established());
  EXPECT_TRUE(rig.station->refused());
  EXPECT_NE(rig.station->failure().find("does not know the key 'omega-9'"), std::string::npos);
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_EQ(rig.events(Event::kUnknownKey), 1u);
  EXPECT_EQ(rig.events(Event::kHandshakesFailed), 1u);
}

TEST(Dtls, AWrongKeyNeverGetsInAndIsExplained) {
  DtlsRig rig;
  rig.connect("omega-1", 7);
  rig.turns(6);
  EXPECT_FALSE(rig.station->established());
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_EQ(rig.server->under_way(), 1u);
  EXPECT_NE(rig.station->failure().find("not the one that the server has"), std::string::npos);
  rig.pass_ms(5001);
  rig.turn();
  EXPECT_EQ(rig.server->under_way(), 0u);
  EXPECT_EQ(rig.events(Event::kHandshakesFailed), 1u);
}

// RFC 6347 4.2.1: nothing is kept for, and no more is sent to, an address than has shown that it is there.
TEST(Dtls, AStrangerGetsLessThanItSendsAndIsNotKept) {
  DtlsRig rig;
  rig.connect();
  const auto hello = rig.network.sent().at(0).bytes;
  rig.network.drop_waiting(rig.server_end.address());
  rig.network.sent().clear();
  constexpr int kHellos = 200;
  for (int i = 0; i < kHellos; ++i) {
    rig.network.carry(
        {DatagramNet::address(77, static_cast<std::uint16_t>(i)), rig.server_end.address(), hello});
    rig.server->receive(rig.buffer, rig.received);
  }
  std::size_t in = 0, out = 0;
  for (const auto& packet : rig.network.sent())
    (packet.to == rig.server_end.address() ? in : out) += packet.bytes.size();
  EXPECT_EQ(rig.events(Event::kCookies), static_cast<std::uint64_t>(kHellos));
  EXPECT_GT(out, 0u);
  EXPECT_LE(out, in);  // amplification <= 1
  EXPECT_EQ(rig.server->under_way() + rig.server->established(), 0u);
}

// The smallest ClientHello that OpenSSL takes is still larger than the answer with its cookie of 32 bytes.
TEST(Dtls, NoCutOrShrunkClientHelloIsAmplified) {
  DtlsRig rig;
  rig.connect();
  const auto hello = rig.network.sent().at(0).bytes;
  rig.network.drop_waiting(rig.server_end.address());
  for (std::size_t size = 0; size <= hello.size(); ++size) {
    auto cut = std::vector<std::uint8_t>(hello.begin(), hello.begin() + static_cast<std::ptrdiff_t>(size));
    if (size > 13) {  // lengths made to fit: record, message, fragment
      cut[11] = static_cast<std::uint8_t>((size - 13) >> 8);
      cut[12] = static_cast<std::uint8_t>(size - 13);
    }
    if (size > 25) {
      cut[15] = cut[23] = static_cast<std::uint8_t>((size - 25) >> 8);
      cut[16] = cut[24] = static_cast<std::uint8_t>(size - 25);
    }
    rig.network.sent().clear();
    rig.network.deliver({DatagramNet::address(77, 7), rig.server_end.address(), cut});
    rig.server->receive(rig.buffer, rig.received);
    std::size_t out = 0;
    for (const auto& packet : rig.network.sent()) out += packet.bytes.size();
    EXPECT_LE(out, size) << size;
  }
  EXPECT_EQ(rig.server->under_way(), 0u);
}

TEST(Dtls, ACookieOfAnotherAddressOrTimeOpensNothing) {
  for (const bool other_address : {true, false}) {
    DtlsRig rig;
    rig.connect();
    rig.server->receive(rig.buffer, rig.received);  // cookie goes out
    rig.network.sent().clear();
    rig.station->receive(rig.station_buffer, rig.station_received);  // Hello with cookie
    auto packet = rig.network.sent().at(0);
    rig.network.drop_waiting(rig.server_end.address());
    if (other_address)
      packet.from = DatagramNet::address(3, 40000);
    else
      rig.pass_ms(60'001);
    rig.network.deliver(packet);
    rig.server->receive(rig.buffer, rig.received);
    EXPECT_EQ(rig.server->under_way(), 0u) << other_address;
  }
}

TEST(Dtls, ARepeatedOrForgedRecordIsCountedAndNotGiven) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  ASSERT_TRUE(rig.hears("one"));
  const auto packet = rig.network.sent().back();
  rig.network.deliver(packet);
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
  EXPECT_EQ(rig.events(Event::kForged), 1u);
  // Every single bit of it, under a sequence number that was not used yet (else the window would hide the
  // seal).
  std::uint64_t dropped = rig.server->counters().dropped();
  for (std::size_t bit = 0; bit < 8 * packet.bytes.size(); ++bit) {
    auto forged = packet;
    forged.bytes[10] = static_cast<std::uint8_t>(forged.bytes[10] + 40);
    forged.bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    rig.network.deliver(forged);
    EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received)) << bit;
    EXPECT_EQ(rig.server->counters().dropped(), ++dropped) << bit;
  }
  for (std::size_t size = 0; size < packet.bytes.size(); ++size) {
    auto cut = packet;
    cut.bytes.resize(size);
    rig.network.deliver(cut);
    EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received)) << size;
    EXPECT_EQ(rig.server->counters().dropped(), ++dropped) << size;
  }
  EXPECT_EQ(rig.server->established(), 1u);
  EXPECT_TRUE(rig.hears("two"));
}

// Records of every type, epoch and length, under a fresh sequence number: none is taken, none ends anything.
// (OpenSSL 3.0.19 by itself ends the association at sealed records shorter than their seal, 3.0.22 does not.)
TEST(Dtls, ForgedRecordsOfEveryLengthEndNothing) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  ASSERT_TRUE(rig.hears("one"));
  std::uint8_t sequence = 0;
  for (std::uint8_t type = 18; type < 27; ++type) {
    for (std::uint8_t epoch = 0; epoch < 4; ++epoch) {
      for (std::size_t length = 0; length < 80; ++length) {
        std::vector<std::uint8_t> bytes(kRecordHeaderBytes + length, 0x2a);
        const std::uint8_t head[] = {
            type, 0xfe, 0xfd, 0, epoch, 0, 0, 0, 0, 1, ++sequence, 0, static_cast<std::uint8_t>(length)};
        std::copy(std::begin(head), std::end(head), bytes.begin());
        rig.network.deliver({rig.station_end.address(), rig.server_end.address(), bytes});
        EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
        rig.network.deliver({rig.server_end.address(), rig.station_end.address(), bytes});
        EXPECT_FALSE(rig.station->receive(rig.station_buffer, rig.station_received));
        ASSERT_TRUE(rig.server->established() == 1 && rig.station->established())
            << int{type} << " " << int{epoch} << " " << length;
      }
    }
  }
  EXPECT_TRUE(rig.hears("two"));
}

TEST(Dtls, LateRecordsWithinTheWindowAreTakenOnce) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  std::vector<DatagramNet::Packet> held;
  for (int i = 0; i < 100; ++i) {
    rig.station->send(bytes_of(std::to_string(i)), rig.server_end.address());
    held.push_back(rig.network.sent().back());
  }
  rig.network.drop_waiting(rig.server_end.address());
  // Newest first: of the 64 newest each comes once (RFC 6347 4.1.2.6), those before are too old.
  int taken = 0;
  for (auto it = held.rbegin(); it != held.rend(); ++it) {
    for (int twice = 0; twice < 2; ++twice) {
      rig.network.deliver(*it);
      taken += rig.server->receive(rig.buffer, rig.received) ? 1 : 0;
    }
  }
  EXPECT_EQ(taken, 64);
}

// A datagram with two records must not leave the second for the next call: answers would lag for ever.
TEST(Dtls, ASecondRecordInADatagramDoesNotLag) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  rig.station->send(bytes_of("first"), rig.server_end.address());
  auto packet = rig.network.sent().back();
  rig.station->send(bytes_of("second"), rig.server_end.address());
  const auto second = rig.network.sent().back().bytes;
  packet.bytes.insert(packet.bytes.end(), second.begin(), second.end());
  rig.network.drop_waiting(rig.server_end.address());
  rig.network.deliver(packet);
  EXPECT_TRUE(rig.server->receive(rig.buffer, rig.received));
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
  EXPECT_TRUE(rig.hears("third"));
}

TEST(Dtls, PlainDatagramsAreNotGiven) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  std::vector<std::uint8_t> plain(126, 0);
  std::copy_n("TLNO\x01\x05", 6, plain.begin());
  rig.network.deliver({rig.station_end.address(), rig.server_end.address(), plain});
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
  EXPECT_EQ(rig.events(Event::kNotDtls), 1u);
  // Application data of epoch 0, which is not sealed.
  std::vector<std::uint8_t> clear{23, 0xfe, 0xfd, 0, 0, 0, 0, 0, 0, 0, 99, 0, 3, 'a', 'b', 'c'};
  rig.network.deliver({rig.station_end.address(), rig.server_end.address(), clear});
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
  rig.network.deliver({rig.server_end.address(), rig.station_end.address(), clear});
  EXPECT_FALSE(rig.station->receive(rig.station_buffer, rig.station_received));
  std::vector<std::uint8_t> alert{21, 0xfe, 0xfd, 0, 0, 0, 0, 0,
                                  0,  0,    99,   0, 2, 2, 40};  // fatal, in the clear
  rig.network.deliver({rig.station_end.address(), rig.server_end.address(), alert});
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received));
  rig.network.deliver({rig.server_end.address(), rig.station_end.address(), alert});
  EXPECT_FALSE(rig.station->receive(rig.station_buffer, rig.station_received));
  EXPECT_TRUE(rig.hears("still here"));
}

TEST(Dtls, RandomAndMutatedDatagramsDoNotHarm) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  const auto sample = rig.network.sent();
  Random random(5);
  std::uint64_t given = 0;
  for (int i = 0; i < 200'000; ++i) {
    auto packet = sample[random.below(sample.size())];
    packet.to = random.chance(0.8) ? rig.server_end.address() : rig.station_end.address();
    packet.from = random.chance(0.7) ? rig.station_end.address() : DatagramNet::address(5, 5);
    if (packet.to == rig.station_end.address()) packet.from = rig.server_end.address();
    const int changes = static_cast<int>(random.below(4));
    for (int k = 0; k < changes; ++k)
      packet.bytes[random.below(packet.bytes.size())] = static_cast<std::uint8_t>(random.bits());
    if (random.chance(0.1)) packet.bytes.resize(random.below(packet.bytes.size() + 1));
    rig.network.deliver(packet);
    if (i % 1000 == 0) rig.network.sent().clear();
    given += rig.turn() ? 1 : 0;
  }
  EXPECT_EQ(given, 0u);
  EXPECT_LE(rig.server->established() + rig.server->under_way(), 128u);
  // The station may have been talked into a new attempt; it must find its way back.
  for (int i = 0; i < 50 && !rig.hears("well"); ++i) {
    rig.pass_ms(200);
    rig.turns(4);
  }
  EXPECT_TRUE(rig.hears("still well"));
}

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

// Counted in flights of one half round trip each: cookie 1 round trip, resumed handshake 1, and the Hello of
// the session goes out with its end.
TEST(Dtls, ANewAddressTakesTwoRoundTripsAndTheHelloGoesWithTheLast) {
  DtlsRig rig;
  rig.connect();
  rig.turns(4);
  rig.station_end.set_address(DatagramNet::address(3, 41000));
  rig.station->receive(rig.station_buffer, rig.station_received);
  rig.station->send(bytes_of("lost: this address is not known"), rig.server_end.address());
  rig.turn();
  rig.pass_ms(501);
  rig.station->receive(rig.station_buffer, rig.station_received);  // silence noticed: begins
  std::vector<std::uint8_t> hello(512, 0);
  std::copy_n("TLNO\x01\x01", 6, hello.begin());
  rig.station->send(hello, rig.server_end.address());
  int round_trips = 0;
  while (!rig.server->receive(rig.buffer, rig.received) && round_trips < 10) {
    rig.station->receive(rig.station_buffer, rig.station_received);
    ++round_trips;
  }
  EXPECT_EQ(round_trips, 2);
  EXPECT_EQ(rig.received.size, 512u);
  EXPECT_TRUE(rig.received.from == rig.station_end.address());
  EXPECT_EQ(rig.station->counters().resumed, 1u);
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

/// Every look at it takes a quarter of a millisecond: so do the steps of handshakes, by this clock.
class SlowClock final : public rt::Clock {
 public:
  std::int64_t now_ns() const noexcept override { return now_ns_ += 250'000; }

 private:
  mutable std::int64_t now_ns_ = 1'000'000'000;
};

// A crowd that shows up all the time gets a tenth of the time, and a session its datagrams.
TEST(Dtls, HandshakesTakeATenthOfTheTimeAndNoMore) {
  DatagramNet network;
  DatagramNet::End server_end(network, DatagramNet::address(1, 5100)),
      station_end(network, DatagramNet::address(2, 1));
  SlowClock clock;
  rt::VirtualClock station_clock;
  station_clock.advance_to(1'000'000'000);
  DtlsServer server({}, two_keys(), server_end, clock);
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
