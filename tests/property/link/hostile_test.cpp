// A million hostile datagrams against both ends: nothing crashes, nothing is accepted that should not be, and
// every one is counted under one cause. Seeded, so that a failure repeats.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>

#include "random_messages.h"
#include "telenano/common/link/wire_scan.h"
#include "tests/unit/link/golden_messages.h"
#include "tests/unit/server/virtual_session.h"

namespace telenano::server {
namespace {

using link::DropCause;

/// Random bytes, ever closer to the real thing: noise; a good header with noise behind; good messages of any
/// values; good messages with a few bytes changed, cut or extended.
class Attacker {
 public:
  explicit Attacker(std::uint64_t seed) : random_(seed), golden_(link::GoldenMessages{}.encoded()) {}

  std::span<const std::uint8_t> next() {
    std::size_t n = 0;
    switch (random_.below(4)) {
      case 0:
        n = random_.below(bytes_.size() + 1);
        fill(0, n);
        break;
      case 1: {
        const std::size_t payload = random_.below(link::kMaxPayloadBytes + 1);
        n = link::kHeaderBytes + payload;
        fill(0, n);
        link::write_header(std::span<std::uint8_t, link::kHeaderBytes>(bytes_.data(), link::kHeaderBytes),
                           static_cast<link::MessageType>(random_.below(12)), payload);
        break;
      }
      case 2:
        n = message();
        break;
      default: {
        const auto& from = golden_[random_.below(golden_.size())];
        n = from.size();
        std::copy(from.begin(), from.end(), bytes_.begin());
        const std::uint64_t changes = 1 + random_.below(4);
        for (std::uint64_t k = 0; k < changes; ++k)
          bytes_[random_.below(n)] = static_cast<std::uint8_t>(random_.bits());
        if (random_.chance(0.2)) n = random_.below(bytes_.size() + 1);
        break;
      }
    }
    return {bytes_.data(), n};
  }

 private:
  void fill(std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < to; ++i) bytes_[i] = static_cast<std::uint8_t>(random_.bits());
  }
  std::size_t message() {
    switch (random_.below(9)) {
      case 0:
        return codec_.encode(link::any_hello(random_), bytes_);
      case 1:
        return codec_.encode(link::any_challenge(random_), bytes_);
      case 2:
        return codec_.encode(link::any_welcome(random_), bytes_);
      case 3:
        return codec_.encode(link::any_refuse(random_), bytes_);
      case 4:
        return codec_.encode(link::any_command(random_), bytes_);
      case 5:
        return codec_.encode(link::any_reply(random_), bytes_);
      case 6:
        return codec_.encode(link::any_scene_request(random_), bytes_);
      case 7:
        return codec_.encode(link::any_scene_chunk(random_), bytes_);
      case 8:
        return codec_.encode(link::any_scene_list_request(random_), bytes_);
      case 9:
        return codec_.encode(link::any_scene_list_entry(random_), bytes_);
      case 10:
        return codec_.encode(link::any_scene_switch(random_), bytes_);
      default:
        return codec_.encode(link::any_bye(random_), bytes_);
    }
  }

  Random random_;
  link::Codec codec_;
  std::vector<std::vector<std::uint8_t>> golden_;
  std::array<std::uint8_t, 600> bytes_{};
};

void print(const char* who, const link::DropCounters& drops) {
  std::printf("%s:", who);
  for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
    const auto cause = static_cast<DropCause>(i);
    if (drops[cause] > 0)
      std::printf(" %s %llu", link::name(cause), static_cast<unsigned long long>(drops[cause]));
  }
  std::printf("\n");
}

TEST(Hostile, AMillionDatagramsDoNotReachARunningSession) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, {}, {}, 1);
  s.client.start(0);
  s.ticks(200);
  ASSERT_EQ(s.client.state(), link::ClientState::kEstablished);
  const auto session_id = s.client.welcome().session_id;
  const auto steps_before = slave->steps;
  const auto commands_before = s.commands;

  Attacker attacker(2026);
  net::Address elsewhere = s.link.address_a();
  elsewhere.port = 6666;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  std::uint64_t hostile = 0, challenges = 0, server_before = server.drops().total();
  for (; hostile < 1'000'000; ++hostile) {
    const auto bytes = attacker.next();
    // Half of them from the station's own address: spoofed, the worst that somebody off the path can do.
    const net::Address from = hostile % 2 == 0 ? elsewhere : s.link.address_a();
    const std::size_t n = server.on_datagram(bytes, from, s.now_ns, out);
    ASSERT_LE(n, bytes.size()) << "amplification";
    if (n > 0 && out[5] == static_cast<std::uint8_t>(link::MessageType::kChallenge)) ++challenges;
    ASSERT_NE(s.client.on_datagram(bytes, s.now_ns), link::ClientEvent::kReply);
    if (hostile % 1000 == 0) s.tick();
  }
  s.ticks(100);
  print("server", server.drops());
  print("client", s.client.drops());
  EXPECT_EQ(s.client.state(), link::ClientState::kEstablished);
  EXPECT_EQ(s.client.welcome().session_id, session_id);
  EXPECT_EQ(server.sessions().occupied(), 1u) << "no state for strangers";
  // Only the station's own commands moved the slave: all but the one still on its way.
  EXPECT_NEAR(static_cast<double>(slave->steps - steps_before),
              static_cast<double>(s.commands - commands_before), 1);
  EXPECT_EQ(s.client.drops().total(), hostile) << "each one counted once";
  // First Hellos (cookie 0) that were challenged are no drops; those with a wrong cookie are, and are
  // challenged too.
  const std::uint64_t dropped = server.drops().total() - server_before;
  EXPECT_LE(dropped, hostile);
  EXPECT_GE(dropped + challenges, hostile);
  for (const DropCause cause :
       {DropCause::kTruncated, DropCause::kOversize, DropCause::kBadMagic, DropCause::kBadLength,
        DropCause::kWrongVersion, DropCause::kUnknownType, DropCause::kMalformedField,
        DropCause::kUnknownSession, DropCause::kUnauthenticated, DropCause::kRateLimited}) {
    EXPECT_GT(server.drops()[cause], 0u) << link::name(cause);
  }
}

TEST(Hostile, AClientInAnyStateOutlivesThem) {
  for (const int ticks : {0, 1, 3, 6, 50}) {
    Server server(test_config(), spring_scene());
    net::SimPath path;
    path.delay_ns = 1'500'000;
    VirtualSession s(&server, {}, path, path, 1);
    s.client.start(0);
    s.ticks(ticks);
    Attacker attacker(static_cast<std::uint64_t>(ticks));
    for (int i = 0; i < 50'000; ++i) {
      ASSERT_EQ(s.client.on_datagram(attacker.next(), s.now_ns), link::ClientEvent::kDropped) << ticks;
    }
    s.ticks(100);
    EXPECT_EQ(s.client.state(), link::ClientState::kEstablished) << ticks;
  }
}

TEST(Hostile, NoAnswerToAHelloIsLargerThanIt) {
  // Every length of a would-be Hello, from a Hello's real beginning: only the full 512 bytes are answered at
  // all.
  Server server(test_config(), spring_scene());
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  const auto hello = link::GoldenMessages{}.encoded()[0];
  for (std::size_t n = 0; n <= hello.size(); ++n) {
    for (const bool honest_header : {false, true}) {
      auto bytes = std::vector<std::uint8_t>(hello.begin(), hello.begin() + static_cast<std::ptrdiff_t>(n));
      if (honest_header && n >= 8) {
        bytes[6] = static_cast<std::uint8_t>((n - 8) & 0xff);
        bytes[7] = static_cast<std::uint8_t>((n - 8) >> 8);
      }
      const std::size_t answer = server.on_datagram(bytes, {}, 1, out);
      EXPECT_EQ(answer > 0, n == 512) << n;
      EXPECT_LE(answer, n);
    }
  }
}

TEST(Hostile, AFloodOfStrangersLeavesProvenStationsAlone) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, {}, {}, 1);
  s.client.start(0);
  s.ticks(100);
  link::Codec codec;
  Random random(3);
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  net::Address from = s.link.address_a();
  std::uint64_t answered = 0;
  for (int ms = 0; ms < 1000; ++ms) {
    for (int k = 0; k < 200; ++k) {
      from.port = static_cast<std::uint16_t>(random.bits());
      link::Hello hello;
      hello.nonce = random.bits() | 1;
      const std::size_t n = codec.encode(hello, in);
      answered += server.on_datagram({in.data(), n}, from, s.now_ns, out) > 0 ? 1 : 0;
    }
    s.tick();
  }
  EXPECT_LT(answered, 23'000u) << "bounded: 20 000 a second and a burst of 2000";
  EXPECT_EQ(server.sessions().occupied(), 1u);
  EXPECT_EQ(s.client.state(), link::ClientState::kEstablished);
  EXPECT_EQ(s.client.replies().lost(), 0u);
}

}  // namespace
}  // namespace telenano::server
