// Associations with pre-shared keys, in memory: who gets in, who does not, and what strangers can make the
// server do. Every datagram is a real one, made or changed by the test.
#include <gtest/gtest.h>

#include "telenano/common/security/connection_id.h"
#include "telenano/common/security/dtls_record.h"
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
  EXPECT_EQ(last.size(),
            std::tuple_size_v<ConnectionPrefix> + kRecordHeaderBytes + secret.size() + kChaChaSealBytes);
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
  constexpr std::size_t kLowestOfNumber = std::tuple_size_v<ConnectionPrefix> + 10;
  std::uint64_t dropped = rig.server->counters().dropped();
  for (std::size_t bit = 0; bit < 8 * packet.bytes.size(); ++bit) {
    auto forged = packet;
    forged.bytes[kLowestOfNumber] = static_cast<std::uint8_t>(forged.bytes[kLowestOfNumber] + 40);
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
  constexpr auto kPrefixBytes = static_cast<std::ptrdiff_t>(std::tuple_size_v<ConnectionPrefix>);
  packet.bytes.insert(packet.bytes.end(), second.begin() + kPrefixBytes, second.end());
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

}  // namespace
}  // namespace telenano::security
