// Stations that come to another address, known by their connection id: they go on with their next datagram;
// and what somebody can make of it who holds back, repeats, forges or writes under a false address.
#include <gtest/gtest.h>

#include <memory>

#include "telenano/common/security/connection_id.h"
#include "telenano/common/security/dtls_record.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

constexpr std::size_t kPrefix = std::tuple_size_v<ConnectionPrefix>;
const net::Address kHome = DatagramNet::address(2, 40000);
const net::Address kElsewhere = DatagramNet::address(3, 41000);
const net::Address kVictim = DatagramNet::address(66, 53);

struct MovingRig : DtlsRig {
  explicit MovingRig(DtlsServerConfig config = {}) : DtlsRig(two_keys(), config) {
    connect();
    turns(4);
  }
  bool answers(std::string_view text) {
    return server->send(bytes_of(text), received.from) == net::SendStatus::kSent &&
           station->receive(station_buffer, station_received) && station_received.size == text.size() &&
           std::memcmp(station_buffer.data(), text.data(), text.size()) == 0;
  }
  /// What the station says now, taken off the way.
  DatagramNet::Packet held(std::string_view text) {
    station->send(bytes_of(text), server_end.address());
    const DatagramNet::Packet packet = network.sent().back();
    network.drop_waiting(server_end.address());
    return packet;
  }
  bool hears_from(DatagramNet::Packet packet, const net::Address& from) {
    packet.from = from;
    network.deliver(packet);
    return server->receive(buffer, received);
  }
  std::size_t bytes_to(const net::Address& to) {
    std::size_t sum = 0;
    for (const auto& packet : network.sent()) sum += packet.to == to ? packet.bytes.size() : 0;
    return sum;
  }
};

TEST(DtlsMoving, TheNextDatagramFromAnotherAddressIsHeardAndAnsweredThere) {
  MovingRig rig;
  ASSERT_TRUE(rig.hears("here"));
  const std::uint64_t channel = rig.received.from.channel;
  EXPECT_NE(channel, 0u);
  EXPECT_TRUE(rig.answers("force"));
  for (std::uint64_t move = 1; move <= 3; ++move) {
    rig.station_end.set_address(DatagramNet::address(3, static_cast<std::uint16_t>(41000 + move)));
    ASSERT_TRUE(rig.hears("there"));
    EXPECT_TRUE(rig.received.from == rig.station_end.address());
    EXPECT_EQ(rig.received.from.channel, channel);
    EXPECT_FALSE(rig.received.standing.address_proven) << "nothing that was sent there was answered yet";
    EXPECT_STREQ(rig.server->identity(rig.received.from), "omega-1");
    rig.turns(2);  // the question and its answer, which neither side sees
    EXPECT_EQ(rig.station->counters().proofs, move);
    ASSERT_TRUE(rig.hears("there again"));
    EXPECT_TRUE(rig.received.standing.address_proven);
    EXPECT_TRUE(rig.answers("force"));
    EXPECT_EQ(rig.events(Event::kMoved), move);
  }
  EXPECT_EQ(rig.station->counters().handshakes, 1u);
  EXPECT_EQ(rig.server->established(), 1u);
  EXPECT_EQ(rig.events(Event::kHandshakesDone), 1u);
  EXPECT_EQ(rig.server->counters().dropped(), 0u);
}

// The force does not wait for the answer: it is shorter than three times what came.
TEST(DtlsMoving, AForceIsAnsweredBeforeTheAddressIsProven) {
  MovingRig rig;
  rig.station_end.set_address(kElsewhere);
  const std::string command(126, 'c'), reply(171, 'r');
  ASSERT_TRUE(rig.hears(command));
  EXPECT_EQ(rig.server->send(bytes_of(reply), rig.received.from), net::SendStatus::kSent);
  rig.station->receive(rig.station_buffer, rig.station_received);
  EXPECT_EQ(rig.station_received.size, reply.size());
}

// A datagram that was overtaken says where the station was. One that was held back and comes from elsewhere is
// the listener's who holds it.
TEST(DtlsMoving, OnlyADatagramNewerThanAllBeforeMovesAnAssociation) {
  MovingRig rig;
  const auto first = rig.held("one");
  const auto second = rig.held("two");
  ASSERT_TRUE(rig.hears("three"));
  EXPECT_TRUE(rig.hears_from(first, kVictim));  // its own words, late
  EXPECT_TRUE(rig.received.from == kHome) << "and answered where it is";
  EXPECT_TRUE(rig.answers("force"));
  rig.station_end.set_address(kElsewhere);
  ASSERT_TRUE(rig.hears("four"));
  EXPECT_TRUE(rig.hears_from(second, kHome));
  EXPECT_TRUE(rig.received.from == kElsewhere);
  EXPECT_EQ(rig.events(Event::kMoved), 1u);
  // The same again, from anywhere, is nothing.
  EXPECT_FALSE(rig.hears_from(second, kVictim));
  EXPECT_EQ(rig.events(Event::kForged), 1u);
  EXPECT_EQ(rig.bytes_to(kVictim), 0u);
}

// Whoever holds a datagram back and is the first to bring it has the answer sent to himself, sealed, until the
// station's own next one.
TEST(DtlsMoving, AHeldBackDatagramIsUndoneByTheStationsNext) {
  MovingRig rig;
  const auto taken = rig.held("one");
  EXPECT_TRUE(rig.hears_from(taken, kVictim));
  EXPECT_FALSE(rig.received.standing.address_proven);
  ASSERT_TRUE(rig.hears("two"));
  EXPECT_TRUE(rig.received.from == kHome);
  EXPECT_EQ(rig.events(Event::kMoved), 2u);
  rig.turns(3);
  ASSERT_TRUE(rig.hears("three"));
  EXPECT_TRUE(rig.received.standing.address_proven);
}

// Every bit of a datagram from another address, prefix included: nothing is heard, nothing moves.
TEST(DtlsMoving, NoForgedDatagramMovesAnything) {
  MovingRig rig;
  auto packet = rig.held("one");
  ASSERT_EQ(packet.bytes[0], kConnectionMark);
  packet.bytes[kPrefix + 10] = static_cast<std::uint8_t>(packet.bytes[kPrefix + 10] + 40);
  std::uint64_t dropped = rig.server->counters().dropped();
  for (std::size_t bit = 0; bit < 8 * packet.bytes.size(); ++bit) {
    auto forged = packet;
    forged.bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    EXPECT_FALSE(rig.hears_from(forged, kVictim)) << bit;
    EXPECT_EQ(rig.server->counters().dropped(), ++dropped) << bit;
  }
  for (std::size_t size = 0; size < packet.bytes.size(); ++size) {
    auto cut = packet;
    cut.bytes.resize(size);
    EXPECT_FALSE(rig.hears_from(cut, kVictim)) << size;
    EXPECT_EQ(rig.server->counters().dropped(), ++dropped) << size;
  }
  // The prefix before what begins a handshake, or is not sealed.
  for (const std::uint8_t type : std::initializer_list<std::uint8_t>{20, 22, 23}) {
    auto other = packet;
    other.bytes[kPrefix] = type;
    other.bytes[kPrefix + 4] = 0;
    EXPECT_FALSE(rig.hears_from(other, kVictim));
  }
  EXPECT_EQ(rig.events(Event::kMoved), 0u);
  EXPECT_EQ(rig.bytes_to(kVictim), 0u);
  EXPECT_TRUE(rig.hears("two"));
}

// A station with a good key writes under the address of somebody else, who never asked for anything.
TEST(DtlsMoving, WhoHasNotAnsweredIsSentAtMostThreeTimesWhatCameFromThere) {
  MovingRig rig;
  const std::string question(60, 'q'), flood(480, 'f');
  std::size_t from_victim = 0;
  for (int i = 0; i < 50; ++i) {
    const auto packet = rig.held(question);
    from_victim += packet.bytes.size();
    ASSERT_TRUE(rig.hears_from(packet, kVictim));
    EXPECT_FALSE(rig.received.standing.address_proven);
    for (int k = 0; k < 10; ++k) rig.server->send(bytes_of(flood), rig.received.from);
    ASSERT_LE(rig.bytes_to(kVictim), 3 * from_victim);
    rig.pass_ms(21);
  }
  EXPECT_GT(rig.bytes_to(kVictim), from_victim) << "else this shows nothing";
  // What was asked there is answered from home, by somebody who can listen at both: that proves home only.
  std::vector<DatagramNet::Packet> questions;
  while (!rig.network.waiting(kVictim).empty()) {
    questions.push_back(rig.network.waiting(kVictim).front());
    rig.network.waiting(kVictim).pop_front();
  }
  for (auto packet : questions) {
    packet.to = kHome;
    rig.network.deliver(packet);
  }
  while (rig.station->receive(rig.station_buffer, rig.station_received)) {
  }
  ASSERT_GT(rig.station->counters().proofs, 0u);
  const auto answers = rig.network.waiting(rig.server_end.address());
  rig.network.drop_waiting(rig.server_end.address());
  ASSERT_EQ(answers.size(), rig.station->counters().proofs);
  // Late, behind a newer datagram from there: these move nothing.
  ASSERT_TRUE(rig.hears_from(rig.held(question), kVictim));
  for (const auto& answer : answers) EXPECT_FALSE(rig.hears_from(answer, kHome));
  ASSERT_TRUE(rig.hears_from(rig.held(question), kVictim));
  EXPECT_FALSE(rig.received.standing.address_proven);
}

// An answer shows who hears at the address asked. Where its station is, only what else it says does: an answer that
// goes another way, or that a listener brings from his own address, moves nothing, however new it is.
TEST(DtlsMoving, AnAnswerFromElsewhereMovesNothing) {
  for (const net::Address& elsewhere : {kHome, kVictim}) {
    MovingRig rig;
    rig.station_end.set_address(kElsewhere);
    ASSERT_TRUE(rig.hears("moved"));
    const net::Address there = rig.received.from;
    rig.station->receive(rig.station_buffer, rig.station_received);
    ASSERT_EQ(rig.station->counters().proofs, 1u);
    const auto answer = rig.network.waiting(rig.server_end.address()).front();
    rig.network.drop_waiting(rig.server_end.address());
    const std::size_t told = rig.bytes_to(elsewhere);
    EXPECT_FALSE(rig.hears_from(answer, elsewhere));
    EXPECT_EQ(rig.events(Event::kMoved), 1u);
    EXPECT_EQ(rig.server->send(bytes_of("force"), there), net::SendStatus::kSent);
    EXPECT_EQ(rig.bytes_to(elsewhere), told);
    // Nor does it prove the address that was asked, which the next answer from there does.
    rig.pass_ms(21);
    ASSERT_TRUE(rig.hears("here"));
    EXPECT_FALSE(rig.received.standing.address_proven);
    rig.turns(2);
    ASSERT_TRUE(rig.hears("here"));
    EXPECT_TRUE(rig.received.standing.address_proven);
    EXPECT_EQ(rig.events(Event::kMoved), 1u);
  }
}

// What was said before an answer and comes after it has been overtaken, as by any other datagram.
TEST(DtlsMoving, AnAnswerFromTheAddressAskedIsNewerThanWhatWasHeldBack) {
  MovingRig rig;
  rig.station_end.set_address(kElsewhere);
  ASSERT_TRUE(rig.hears("moved"));
  const auto held = rig.held("held back");
  rig.station->receive(rig.station_buffer, rig.station_received);
  ASSERT_EQ(rig.station->counters().proofs, 1u);
  EXPECT_FALSE(rig.server->receive(rig.buffer, rig.received)) << "the answer";
  EXPECT_TRUE(rig.hears_from(held, kVictim));
  EXPECT_TRUE(rig.received.from == kElsewhere);
  EXPECT_TRUE(rig.received.standing.address_proven);
  EXPECT_EQ(rig.events(Event::kMoved), 1u);
  EXPECT_EQ(rig.bytes_to(kVictim), 0u);
}

TEST(DtlsMoving, AQuestionThatIsLostIsAskedAgain) {
  MovingRig rig;
  rig.station_end.set_address(kElsewhere);
  ASSERT_TRUE(rig.hears("one"));
  rig.network.drop_waiting(kElsewhere);
  ASSERT_TRUE(rig.hears("two"));
  rig.turn();
  EXPECT_EQ(rig.station->counters().proofs, 0u) << "not within 20 ms";
  rig.pass_ms(20);
  ASSERT_TRUE(rig.hears("three"));
  rig.turns(2);
  EXPECT_EQ(rig.station->counters().proofs, 1u);
  ASSERT_TRUE(rig.hears("four"));
  EXPECT_TRUE(rig.received.standing.address_proven);
}

// Two stations change places, as behind a router that gives ports anew. Each is answered for itself.
TEST(DtlsMoving, TwoStationsThatChangePlacesAreTakenForThemselves) {
  MovingRig rig;
  DatagramNet::End other_end(rig.network, kElsewhere);
  DtlsClientConfig config;
  config.key = StationKey{"guest", psk_of(2)};
  DtlsClient other(config, other_end, rig.server_end.address(), rig.clock);
  std::array<std::uint8_t, 513> other_buffer{};
  net::Received other_received;
  for (int i = 0; i < 6; ++i) {
    rig.turn();
    other.receive(other_buffer, other_received);
  }
  ASSERT_TRUE(other.established());
  rig.station_end.set_address(kElsewhere);
  other_end.set_address(kHome);
  for (int i = 0; i < 3; ++i) {
    // Both are heard before either is answered.
    ASSERT_TRUE(rig.hears("from omega-1"));
    const net::Received one = rig.received;
    other.send(bytes_of("from guest"), rig.server_end.address());
    bool heard = false;
    while (rig.server->receive(rig.buffer, rig.received)) heard = true;
    ASSERT_TRUE(heard);
    const net::Received two = rig.received;
    EXPECT_EQ(one.standing.rights, net::Rights::kOperate);
    EXPECT_EQ(two.standing.rights, net::Rights::kObserve);
    EXPECT_STREQ(rig.server->identity(one.from), "omega-1");
    EXPECT_STREQ(rig.server->identity(two.from), "guest");
    EXPECT_EQ(rig.server->send(bytes_of("A"), one.from), net::SendStatus::kSent);
    EXPECT_EQ(rig.server->send(bytes_of("B"), two.from), net::SendStatus::kSent);
    ASSERT_TRUE(rig.station->receive(rig.station_buffer, rig.station_received));
    EXPECT_EQ(rig.station_buffer[0], 'A');
    ASSERT_TRUE(other.receive(other_buffer, other_received));
    EXPECT_EQ(other_buffer[0], 'B');
    while (rig.server->receive(rig.buffer, rig.received)) {
    }
  }
  EXPECT_EQ(rig.events(Event::kMoved), 2u);
  EXPECT_EQ(rig.station->counters().handshakes + other.counters().handshakes, 2u);
}

// The address that a station has left is given to another, which agrees on keys from there.
TEST(DtlsMoving, ANewStationAtTheOldAddressEndsNothing) {
  MovingRig rig;
  rig.station_end.set_address(kElsewhere);
  ASSERT_TRUE(rig.hears("moved"));
  DatagramNet::End other_end(rig.network, kHome);
  DtlsClientConfig config;
  config.key = StationKey{"guest", psk_of(2)};
  DtlsClient other(config, other_end, rig.server_end.address(), rig.clock);
  std::array<std::uint8_t, 513> other_buffer{};
  net::Received other_received;
  for (int i = 0; i < 6; ++i) {
    rig.turn();
    other.receive(other_buffer, other_received);
  }
  ASSERT_TRUE(other.established());
  EXPECT_EQ(rig.server->established(), 2u);
  EXPECT_TRUE(rig.hears("still here"));
}

// Ends that do not know of connection ids go on as before: an address is an association.
TEST(DtlsMoving, EitherEndMayBeOneOfBefore) {
  for (const bool old_station : {true, false}) {
    DtlsServerConfig old_server;
    old_server.connection_ids = old_station;
    DtlsRig rig(two_keys(), old_server);
    DtlsClientConfig config;
    config.key = StationKey{"omega-1", psk_of(1)};
    config.connection_id = !old_station;
    rig.connect(config);
    rig.turns(4);
    ASSERT_TRUE(rig.hears("here"));
    EXPECT_EQ(rig.received.from.channel, 0u);
    EXPECT_EQ(rig.network.sent().back().bytes[0], 23) << "no prefix";
    rig.station_end.set_address(kElsewhere);
    EXPECT_FALSE(rig.hears("there"));
    EXPECT_EQ(rig.events(Event::kNoHandshake), 1u);
    rig.pass_ms(501);
    rig.turns(6);
    EXPECT_TRUE(rig.hears("there"));
    EXPECT_EQ(rig.station->counters().resumed, 1u);
  }
}

// A resumed association has a name of its own; the one before it is nobody's any more.
TEST(DtlsMoving, AResumedAssociationMovesToo) {
  MovingRig rig;
  const auto before = rig.held("lost");
  rig.pass_ms(501);
  rig.turns(6);
  ASSERT_EQ(rig.station->counters().resumed, 1u);
  rig.station_end.set_address(kElsewhere);
  ASSERT_TRUE(rig.hears("there"));
  EXPECT_EQ(rig.station->counters().handshakes, 2u);
  EXPECT_FALSE(rig.hears_from(before, kVictim));
  EXPECT_EQ(rig.events(Event::kNoHandshake), 1u);
}

// A datagram that names an association which there is not.
TEST(DtlsMoving, AnotherAssociationIsNotServed) {
  MovingRig rig;
  const auto packet = rig.held("for it");
  EXPECT_EQ(packet.bytes[1], 0);
  EXPECT_TRUE(rig.hears_from(packet, kHome));
  auto other = rig.held("for another");
  other.bytes[1] = 1;
  EXPECT_FALSE(rig.hears_from(other, kHome));
  EXPECT_EQ(rig.events(Event::kNoHandshake), 1u);
  // Nor one that was there before, in the same place of the table.
  auto earlier = rig.held("for an earlier one");
  earlier.bytes[kPrefix - 1] ^= 1;
  EXPECT_FALSE(rig.hears_from(earlier, kHome));
  EXPECT_EQ(rig.events(Event::kNoHandshake), 2u);
}

TEST(DtlsMoving, AFarewellFromAnotherAddressEndsTheAssociation) {
  MovingRig rig;
  rig.station_end.set_address(kElsewhere);
  rig.station.reset();
  rig.turn();
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_EQ(rig.events(Event::kClosed), 1u);
}

// RFC 5489: what was recorded cannot be opened with the key that is lost later. Read off the ServerHello.
TEST(DtlsMoving, AKeyGivesForwardSecrecy) {
  MovingRig rig;
  int hellos = 0;
  for (const auto& packet : rig.network.sent()) {
    const auto& b = packet.bytes;
    constexpr std::size_t kSessionId = kRecordHeaderBytes + 12 + 2 + 32;
    if (b[0] != 22 || b[kRecordHeaderBytes] != 2) continue;
    ++hellos;
    const std::size_t suite = kSessionId + 1 + b[kSessionId];
    EXPECT_EQ((b[suite] << 8) | b[suite + 1], 0xccac) << "TLS_ECDHE_PSK_WITH_CHACHA20_POLY1305_SHA256";
  }
  EXPECT_EQ(hellos, 1);
}

}  // namespace
}  // namespace telenano::security
