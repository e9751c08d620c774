// A session brought to another of the server's scenes, in virtual time: what is new, what stays, what is lost on the way,
// and what somebody gets who asks without end. Oracles: the scenes' own numbers, and the count of slaves made.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::ClientEvent;
using link::ClientState;
using link::DropCause;
using link::SceneSwitching;

constexpr std::uint64_t kFloor = 0x1234, kParticle = 0x5678, kSlow = 0x9abc;
constexpr std::int64_t kSecond = 1'000'000'000;

/// Three: the spring's floor; one with a particle and a well; one whose slave takes 100 commands a second.
struct Scenes {
  std::vector<ServedScene> all(bool breaks = false) {
    std::vector<ServedScene> scenes;
    scenes.push_back(spring_scene(&floor, &made_floor));
    ServedScene with_particle = spring_scene();
    with_particle.name = scene_name("a particle");
    with_particle.hash = kParticle;
    with_particle.make_slave = [this, breaks]() -> std::unique_ptr<slave::Slave> {
      if (breaks && made_particle > 0) return nullptr;
      ++made_particle;
      auto slave = std::make_unique<SpringSlave>(true);
      slave->set_well(7.5);
      particle = slave.get();
      return slave;
    };
    scenes.push_back(std::move(with_particle));
    ServedScene slow = spring_scene();
    slow.name = scene_name("slow");
    slow.hash = kSlow;
    slow.make_slave = [] {
      auto slave = std::make_unique<SpringSlave>();
      slave->take_at_most(100);
      return slave;
    };
    scenes.push_back(std::move(slow));
    return scenes;
  }
  SpringSlave* floor = nullptr;
  SpringSlave* particle = nullptr;
  int made_floor = 0;
  int made_particle = 0;
};

net::SimPath path(double delay_ms, double loss = 0) {
  net::SimPath p;
  p.delay_ns = static_cast<std::int64_t>(delay_ms * 1e6);
  p.loss = loss;
  return p;
}

struct Switching {
  explicit Switching(const net::SimPath& way = path(5), std::uint64_t seed = 1, bool breaks = false,
                     std::uint64_t features = link::kKnownFeatures)
      : server(test_config(), scenes.all(breaks)), session(&server, client(features, seed), way, way, seed) {
    session.client.start(0);
  }
  static link::ClientConfig client(std::uint64_t features, std::uint64_t seed) {
    link::ClientConfig config;
    config.feature_bits = features;
    config.nonce_seed = seed;
    return config;
  }
  link::ClientSession& station() { return session.client; }
  void open() {
    session.ticks(500);
    ASSERT_EQ(station().state(), ClientState::kEstablished);
  }

  Scenes scenes;
  Server server;
  VirtualSession session;
};

TEST(SceneSwitch, BringsAnotherSlaveWithFeaturesOfItsOwnInANewEpoch) {
  Switching s;
  s.open();
  const link::Welcome before = s.station().welcome();
  EXPECT_EQ(before.scene_hash, kFloor);
  EXPECT_EQ(before.well_aj, 0);
  EXPECT_EQ(before.feature_bits & (link::kFeatureParticle | link::kFeatureWell), 0u);
  ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));
  s.session.ticks(50);
  EXPECT_EQ(s.station().scene_switching(), SceneSwitching::kDone);
  const link::Welcome& after = s.station().welcome();
  EXPECT_EQ(after.scene_hash, kParticle);
  EXPECT_EQ(after.scene_name, scene_name("a particle"));
  EXPECT_EQ(after.well_aj, 7.5);
  EXPECT_NE(after.feature_bits & link::kFeatureParticle, 0u);
  EXPECT_NE(after.session_id, before.session_id);
  EXPECT_NE(after.epoch, before.epoch);
  EXPECT_EQ(after.resume_token, before.resume_token);
  EXPECT_EQ(s.station().state(), ClientState::kEstablished);
  // The account begins at 0: the spring pressed once, as in the first scene.
  EXPECT_EQ(s.station().slave_energy_aj().in(), 4.5);
  EXPECT_EQ(s.server.sessions().active(), 1u);
  EXPECT_EQ(s.server.counters().opened, 1u);
  EXPECT_EQ(s.server.counters().switched, 1u);
  // The link is the same: what is known of it stays.
  EXPECT_EQ(s.station().stats().rtt_min_ns(), 10'000'000);
}

// Commands of the first scene are still on their way when the second one begins.
TEST(SceneSwitch, WhatWasMeantForTheSlaveBeforeMovesNothing) {
  Switching s(path(50));
  s.open();
  s.session.command.tip_pos_w_nm = {9, 9, -9};
  ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));
  std::uint64_t steps_at_welcome = 99;
  s.session.on_event = [&](ClientEvent event) {
    if (event != ClientEvent::kWelcome) return;
    steps_at_welcome = s.scenes.particle->steps;
    s.session.command.tip_pos_w_nm = {1, 1, 5};
  };
  const std::uint64_t unknown = s.server.drops()[DropCause::kUnknownSession];
  s.session.ticks(400);
  EXPECT_EQ(steps_at_welcome, 0u);
  EXPECT_GT(s.server.drops()[DropCause::kUnknownSession], unknown + 40) << "the first scene's, on their way";
  EXPECT_EQ(s.scenes.particle->commanded_w_nm(), Vec3(1, 1, 5));
  EXPECT_LE(s.scenes.particle->highest_nm, 50) << "and it was never sent anywhere else";
  EXPECT_EQ(s.station().slave_energy_aj().in(), 0) << "nor pressed";
}

TEST(SceneSwitch, LostAnswersMakeNoSecondSlave) {
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Switching s(path(10, 0.4), seed);
    s.session.ticks(8000);
    ASSERT_TRUE(s.station().has_session()) << seed;
    ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));
    s.session.ticks(8000);
    EXPECT_EQ(s.station().scene_switching(), SceneSwitching::kDone) << seed;
    EXPECT_EQ(s.station().welcome().scene_hash, kParticle) << seed;
    EXPECT_EQ(s.server.counters().switched, 1u) << seed;
    EXPECT_EQ(s.scenes.made_particle, 1) << seed;
    EXPECT_EQ(s.server.sessions().active(), 1u) << seed;
  }
}

TEST(SceneSwitch, ARefusalChangesNothing) {
  Switching s;
  s.open();
  const link::Welcome before = s.station().welcome();
  const auto refused = [&](std::uint64_t hash) {
    EXPECT_TRUE(s.station().switch_scene(hash, s.session.now_ns));
    s.session.ticks(50);
    EXPECT_EQ(s.station().scene_switching(), SceneSwitching::kRefused);
    EXPECT_EQ(s.station().welcome().session_id, before.session_id);
    EXPECT_EQ(s.station().state(), ClientState::kEstablished);
    return s.station().refuse().reason;
  };
  EXPECT_EQ(refused(0x4242), link::RefuseReason::kScene);
  EXPECT_EQ(refused(kSlow), link::RefuseReason::kRate) << "1000 commands a second";
  EXPECT_EQ(s.server.counters().switched, 0u);
  const std::uint64_t steps = s.scenes.floor->steps;
  s.session.ticks(50);
  EXPECT_GT(s.scenes.floor->steps, steps + 40) << "the session goes on";
}

TEST(SceneSwitch, ASceneWhoseSlaveCannotBeMadeLeavesTheSessionWhereItIs) {
  Switching s(path(5), 1, true);
  s.open();
  ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));  // the spare one
  s.session.ticks(50);
  ASSERT_TRUE(s.station().switch_scene(kFloor, s.session.now_ns));
  s.session.ticks(50);
  const std::uint64_t id = s.station().welcome().session_id;
  const std::uint64_t steps = s.scenes.floor->steps;
  ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));
  s.session.ticks(50);
  EXPECT_EQ(s.station().scene_switching(), SceneSwitching::kRefused);
  EXPECT_EQ(s.station().refuse().reason, link::RefuseReason::kScene);
  EXPECT_EQ(s.station().welcome().session_id, id);
  EXPECT_GT(s.scenes.floor->steps, steps);
}

// A station that comes back finds the scene where it left it, with that scene's features.
TEST(SceneSwitch, AResumedSessionStaysInItsScene) {
  Switching s;
  s.open();
  ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));
  s.session.ticks(50);
  const link::Welcome before = s.station().welcome();
  s.session.link.path_a_to_b().loss = s.session.link.path_b_to_a().loss = 1;
  s.session.ticks(3000);
  ASSERT_EQ(s.station().state(), ClientState::kLost);
  s.session.link.path_a_to_b().loss = s.session.link.path_b_to_a().loss = 0;
  s.session.ticks(2000);
  const link::Welcome& after = s.station().welcome();
  EXPECT_NE(after.session_id, before.session_id);
  EXPECT_EQ(after.epoch, before.epoch);
  EXPECT_EQ(after.scene_hash, kParticle);
  EXPECT_EQ(after.feature_bits, before.feature_bits);
  EXPECT_EQ(after.well_aj, 7.5);
  // Another session begins in the first scene.
  VirtualSession next(&s.server, Switching::client(link::kKnownFeatures, 77), path(5), path(5), 77);
  next.now_ns = s.session.now_ns;
  next.link.advance_to(next.now_ns);
  next.client.start(next.now_ns);
  next.ticks(100);
  EXPECT_EQ(next.client.welcome().scene_hash, kFloor);
}

TEST(SceneSwitch, TheListNamesEachSceneOnce) {
  Switching s;
  std::set<std::string> names;
  std::set<std::uint64_t> hashes;
  s.session.on_event = [&](ClientEvent event) {
    if (event != ClientEvent::kSceneEntry) return;
    const link::SceneListEntry& entry = s.station().incoming().scene_list_entry;
    EXPECT_EQ(entry.count, 3u);
    names.emplace(entry.scene_name.text.data());
    hashes.insert(entry.scene_hash);
  };
  s.open();
  for (std::uint32_t i = 0; i < 5; ++i) {
    const std::size_t n = s.station().make_scene_list_request(i, s.session.buffer);
    s.session.link.a().send({s.session.buffer.data(), n}, {});
  }
  s.session.ticks(30);
  EXPECT_EQ(names, (std::set<std::string>{"spring floor", "a particle", "slow"}));
  EXPECT_EQ(hashes, (std::set<std::uint64_t>{kFloor, kParticle, kSlow}));
  EXPECT_EQ(s.server.drops()[DropCause::kOutOfRange], 2u) << "lines 3 and 4";
}

// Old stations do not ask for the feature, old servers do not grant it; neither sees anything of it.
TEST(SceneSwitch, WithoutTheFeatureNothingIsSentAndNothingIsTaken) {
  Switching old(path(5), 1, false, link::kKnownFeatures & ~std::uint64_t{link::kFeatureSceneSwitch});
  old.open();
  EXPECT_FALSE(old.station().switch_scene(kParticle, old.session.now_ns));
  EXPECT_EQ(old.station().make_scene_list_request(0, old.session.buffer), 0u);
  link::Codec codec;
  for (const bool list : {true, false}) {
    const std::uint64_t id = old.station().welcome().session_id;
    const std::size_t n = list ? codec.encode(link::SceneListRequest{id, 0}, old.session.buffer)
                               : codec.encode(link::SceneSwitch{id, 5, kParticle}, old.session.buffer);
    const std::uint64_t before = old.server.drops()[DropCause::kUnexpected];
    old.session.link.a().send({old.session.buffer.data(), n}, {});
    old.session.ticks(20);
    EXPECT_EQ(old.server.drops()[DropCause::kUnexpected], before + 1);
  }
  Server one(test_config(), spring_scene());
  VirtualSession s(&one, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(100);
  EXPECT_EQ(s.client.features() & link::kFeatureSceneSwitch, 0u) << "there is one scene only";
  EXPECT_FALSE(s.client.switch_scene(kParticle, s.now_ns));
}

// Who asks 1000 times a second gets no more slaves than one who opens sessions, and others still come in.
TEST(SceneSwitch, AStormOfThemIsBoundedAsOpeningsAreAndStarvesNobody) {
  Scenes scenes;
  ServerConfig config = test_config();
  config.openings_per_s = 8;
  config.openings_per_party_s = 2;
  Server server(config, scenes.all());
  VirtualSession enemy(&server, {}, path(1), path(1), 1);
  enemy.client.start(0);
  enemy.ticks(50);
  ASSERT_EQ(enemy.client.state(), ClientState::kEstablished);
  const int before = scenes.made_floor + scenes.made_particle;
  link::Codec codec;
  std::uint64_t nonce = 1000;
  enemy.before_end_of_tick = [&] {
    const std::size_t n = codec.encode(
        link::SceneSwitch{enemy.client.welcome().session_id, ++nonce, nonce % 2 == 0 ? kFloor : kParticle},
        enemy.buffer);
    enemy.link.a().send({enemy.buffer.data(), n}, {});
  };
  enemy.ticks(4000);
  const int made = scenes.made_floor + scenes.made_particle - before;
  EXPECT_LE(made, 2 + 2 * 4 + 1) << "a second's burst, and two a second";
  // Another party, while the storm goes on.
  net::Address other;
  other.ip[15] = 9;
  other.port = 4000;
  link::ClientSession good({});
  good.start(enemy.now_ns);
  for (int i = 0; i < 200 && good.state() != ClientState::kEstablished; ++i) {
    enemy.tick();
    std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
    const std::size_t n = good.poll(enemy.now_ns, in);
    if (n == 0) continue;
    const std::size_t m = server.on_datagram({in.data(), n}, other, enemy.now_ns, out);
    if (m > 0) good.on_datagram({out.data(), m}, enemy.now_ns);
  }
  EXPECT_EQ(good.state(), ClientState::kEstablished);
}

TEST(SceneSwitch, NobodyElseMayAsk) {
  Switching s;
  s.open();
  link::Codec codec;
  net::Address stranger;
  stranger.ip[15] = 66;
  const std::size_t n =
      codec.encode(link::SceneSwitch{s.station().welcome().session_id, 5, kParticle}, s.session.buffer);
  EXPECT_EQ(s.server.on_datagram({s.session.buffer.data(), n}, stranger, s.session.now_ns, s.session.answer),
            0u);
  EXPECT_EQ(s.server.drops()[DropCause::kUnauthenticated], 1u);
  EXPECT_EQ(s.server.counters().switched, 0u);
}

// A server that answers with a scene that nobody asked for is not believed.
TEST(SceneSwitch, AWelcomeOfAThirdSceneIsNotTaken) {
  Switching s;
  s.open();
  ASSERT_TRUE(s.station().switch_scene(kParticle, s.session.now_ns));
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  const std::size_t n = s.station().poll(s.session.now_ns, out);
  link::Codec codec;
  link::Incoming in;
  ASSERT_EQ(codec.decode({out.data(), n}, in), DropCause::kNone);
  link::Welcome lie = s.station().welcome();
  lie.nonce = in.scene_switch.nonce;
  lie.session_id ^= 0x1000;
  lie.epoch += 1;
  lie.scene_hash = kSlow;
  std::size_t m = codec.encode(lie, out);
  EXPECT_EQ(s.station().on_datagram({out.data(), m}, s.session.now_ns), ClientEvent::kDropped);
  EXPECT_EQ(s.station().drops()[DropCause::kOutOfRange], 1u);
  EXPECT_EQ(s.station().welcome().scene_hash, kFloor);
  lie.scene_hash = kParticle;
  m = codec.encode(lie, out);
  EXPECT_EQ(s.station().on_datagram({out.data(), m}, s.session.now_ns), ClientEvent::kWelcome);
}

TEST(SceneSwitch, SeveralScenesGoNeitherWithASharedTipNorTwice) {
  Scenes scenes;
  ServerConfig config = test_config();
  config.share = Share::kOneTip;
  EXPECT_THROW(Server(config, scenes.all()), UserError);
  std::vector<ServedScene> twice = scenes.all();
  twice[2].hash = twice[0].hash;
  EXPECT_THROW(Server(test_config(), std::move(twice)), UserError);
  std::vector<ServedScene> named = scenes.all();
  named[2].name = named[0].name;
  EXPECT_THROW(Server(test_config(), std::move(named)), UserError);
}

}  // namespace
}  // namespace telenano::server
