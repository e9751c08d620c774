// Feature bits: what is agreed, what is sent and taken with and without it, and totals that count from the
// Welcome.
#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <utility>

#include "tests/unit/link/golden_messages.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::DropCause;
using link::kFeatureLocalModel;
using link::kFeaturePortControl;

constexpr std::uint64_t kUnknownFeature = 1ull << 40;

/// A station that asks and a server that grants, after the handshake.
struct Pair {
  Pair(std::uint64_t asked, std::uint64_t granted) : server(config(granted), spring_scene()) {
    link::ClientConfig client;
    client.feature_bits = asked;
    s = std::make_unique<VirtualSession>(&server, client, net::SimPath{}, net::SimPath{}, 1);
    s->client.start(0);
    s->ticks(20);
  }
  static ServerConfig config(std::uint64_t granted) {
    ServerConfig c = test_config();
    c.feature_bits = granted;
    return c;
  }
  /// A command with every field behind a feature bit, made by hand: what the server counts it as.
  DropCause hand_made_command(const link::PortControl& control) {
    link::Command c = s->command;
    c.session_id = s->client.welcome().session_id;
    c.epoch = s->client.welcome().epoch;
    c.sequence = 1000;
    c.control = control;
    link::Codec codec;
    const std::size_t n = codec.encode(c, s->buffer);
    const auto before = server.drops();
    server.on_datagram({s->buffer.data(), n}, s->link.address_a(), s->now_ns, s->answer);
    return difference(before, server.drops());
  }
  DropCause hand_made_reply(const link::PortAnswer& port, const link::LocalModel& model) {
    return hand_made_reply([&](link::Reply& r) {
      r.port = port;
      r.model = model;
    });
  }
  template <class Set>
  DropCause hand_made_reply(Set set) {
    link::Reply r = s->client.reply();
    link::Command c = s->command;
    s->client.make_command(c, s->now_ns, s->buffer);  // on its way while this answer to it comes
    r.sequence = r.command_sequence = c.sequence;
    set(r);
    link::Codec codec;
    const std::size_t n = codec.encode(r, s->buffer);
    const auto before = s->client.drops();
    s->client.on_datagram({s->buffer.data(), n}, s->now_ns);
    return difference(before, s->client.drops());
  }
  static DropCause difference(const link::DropCounters& before, const link::DropCounters& after) {
    for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
      const auto cause = static_cast<DropCause>(i);
      if (after[cause] != before[cause]) return cause;
    }
    return DropCause::kNone;
  }

  Server server;
  std::unique_ptr<VirtualSession> s;
};

TEST(Features, AgreedIsWhatIsAskedForAndGranted) {
  for (std::uint64_t asked = 0; asked < 4; ++asked) {
    for (std::uint64_t granted = 0; granted < 4; ++granted) {
      Pair p(asked | kUnknownFeature, granted);
      ASSERT_EQ(p.s->client.state(), link::ClientState::kEstablished);
      EXPECT_EQ(p.s->client.features(), asked & granted);
      EXPECT_EQ(p.s->client.welcome().feature_bits, asked & granted);
      EXPECT_EQ(p.server.sessions()[0].feature_bits, asked & granted);
      EXPECT_EQ(p.server.drops().total() + p.s->client.drops().total(), 0u);
    }
  }
  EXPECT_EQ(link::ClientConfig{}.feature_bits, link::kKnownFeatures) << "a station asks for all it knows";
  EXPECT_EQ(ServerConfig{}.feature_bits, link::kKnownFeatures);
  EXPECT_EQ(link::ClientSession({}).features(), 0u) << "none before a Welcome";
}

TEST(Features, AWelcomeThatGrantsWhatWasNotAskedForIsDropped) {
  Pair p(kFeaturePortControl, link::kKnownFeatures);
  link::ClientConfig config;
  config.feature_bits = kFeaturePortControl;
  link::ClientSession client(config);
  client.start(0);
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Codec codec;
  link::Incoming hello;
  codec.decode(std::span(out).first(client.poll(0, out)), hello);
  link::Welcome w = p.s->client.welcome();
  w.nonce = hello.hello.nonce;
  w.feature_bits = kFeaturePortControl | kFeatureLocalModel;
  EXPECT_EQ(client.on_datagram(std::span(out).first(codec.encode(w, out)), 1), link::ClientEvent::kDropped);
  EXPECT_NE(client.last_drop(), link::DropCause::kNone);
  EXPECT_EQ(client.drops()[DropCause::kOutOfRange], 1u);
  w.feature_bits = kFeaturePortControl;
  w.well_aj = 1;
  EXPECT_EQ(client.on_datagram(std::span(out).first(codec.encode(w, out)), 1), link::ClientEvent::kDropped);
  EXPECT_EQ(client.drops()[DropCause::kUnexpected], 1u) << "a well that nobody has agreed to";
  w.well_aj = 0;
  EXPECT_EQ(client.on_datagram(std::span(out).first(codec.encode(w, out)), 1), link::ClientEvent::kWelcome);
  EXPECT_EQ(client.last_drop(), link::DropCause::kNone);
}

// As a station sees it: known where the slave knows it and the station asks, and only a number can be one.
TEST(Features, AWellIsToldWhereThereIsOne) {
  for (const double well_aj : {384.5, 0.0, std::numeric_limits<double>::infinity(), -1.0}) {
    for (const bool asks : {true, false}) {
      SpringSlave slave;
      slave.set_well(well_aj);
      ServedScene scene = spring_scene();
      scene.make_slave = [slave] { return std::make_unique<SpringSlave>(slave); };
      Server server(test_config(), std::move(scene));
      link::ClientConfig config;
      if (!asks) config.feature_bits &= ~std::uint64_t{link::kFeatureWell};
      link::ClientSession client(config);
      client.start(0);
      std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
      for (std::int64_t k = 0; k < 20 && !client.has_session(); ++k) {
        const std::size_t n = client.poll(k * 200'000'000, in);
        if (n == 0) continue;
        const std::size_t m =
            server.on_datagram(std::span(in).first(n), net::Address{}, k * 200'000'000, out);
        client.on_datagram(std::span(out).first(m), k * 200'000'000);
      }
      ASSERT_TRUE(client.has_session());
      const bool told = asks && well_aj == 384.5;
      EXPECT_EQ(client.welcome().well_aj, told ? 384.5 : 0) << well_aj;
      EXPECT_EQ((client.features() & link::kFeatureWell) != 0, told) << well_aj;
    }
  }
}

TEST(Features, FieldsOfAFeatureThatWasNotAgreedAreUnexpected) {
  const link::GoldenMessages golden;
  const auto& control = golden.command_with_features.control;
  const auto& port = golden.reply_with_features.port;
  const auto& model = golden.reply_with_features.model;
  EXPECT_EQ(Pair(3, 3).hand_made_command(control), DropCause::kNone);
  EXPECT_EQ(Pair(3, 3).hand_made_reply(port, model), DropCause::kNone);
  EXPECT_EQ(Pair(3, kFeatureLocalModel).hand_made_command(control), DropCause::kUnexpected);
  EXPECT_EQ(Pair(3, kFeatureLocalModel).hand_made_reply({}, model), DropCause::kNone);
  EXPECT_EQ(Pair(3, kFeatureLocalModel).hand_made_reply(port, {}), DropCause::kUnexpected);
  EXPECT_EQ(Pair(3, kFeaturePortControl).hand_made_reply(port, {}), DropCause::kNone);
  EXPECT_EQ(Pair(3, kFeaturePortControl).hand_made_reply({}, model), DropCause::kUnexpected);
  EXPECT_EQ(Pair(0, 3).hand_made_command({}), DropCause::kNone);
  EXPECT_EQ(Pair(0, 3).hand_made_reply({}, {}), DropCause::kNone);

  // Any one field counts.
  const auto alone = [](auto set) {
    link::PortControl c;
    set(c);
    return Pair(0, 0).hand_made_command(c);
  };
  EXPECT_EQ(alone([](auto& c) { c.method = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(alone([](auto& c) { c.energy_scale_aj_j = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(alone([](auto& c) { c.energy_sent_j = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(alone([](auto& c) { c.wave_sum.z() = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(alone([](auto& c) { c.wave_energy_aj = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(alone([](auto& c) { c.wave_impedance_n_s_m = 1; }), DropCause::kUnexpected);
  const auto port_alone = [](auto set) {
    link::PortAnswer a;
    set(a);
    return Pair(0, 0).hand_made_reply(a, {});
  };
  EXPECT_EQ(port_alone([](auto& a) { a.energy_sent_aj = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(port_alone([](auto& a) { a.wave_sum.y() = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(port_alone([](auto& a) { a.wave_energy_aj = 1; }), DropCause::kUnexpected);
  const auto model_alone = [](auto set) {
    link::LocalModel m;
    set(m);
    return Pair(0, 0).hand_made_reply({}, m);
  };
  EXPECT_EQ(model_alone([](auto& m) { m.point_w_nm.x() = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(model_alone([](auto& m) { m.normal_w.z() = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(model_alone([](auto& m) { m.stiffness_n_m = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(model_alone([](auto& m) { m.adhesion_nn = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(model_alone([](auto& m) { m.shear_stiffness_n_m = 1; }), DropCause::kUnexpected);
  EXPECT_EQ(model_alone([](auto& m) { m.friction_nn = 1; }), DropCause::kUnexpected);
}

TEST(Features, WhatWasNotAgreedOfTipHistoryAndParticleIsUnexpectedToo) {
  const link::GoldenMessages golden;
  const auto tip = [&](link::Reply& r) { r.tip = golden.reply_with_sharing.tip; };
  const auto history = [](link::Reply& r) { r.steps_before = 1; };
  const auto particle = [&](link::Reply& r) { r.particle = golden.reply_with_particle.particle; };
  const auto radius = [](link::Reply& r) { r.particle.radius_nm = 1; };
  EXPECT_EQ(Pair(0, 0).hand_made_reply(tip), DropCause::kUnexpected);
  EXPECT_EQ(Pair(0, 0).hand_made_reply(history), DropCause::kUnexpected);
  EXPECT_EQ(Pair(0, 0).hand_made_reply(particle), DropCause::kUnexpected);
  EXPECT_EQ(Pair(0, 0).hand_made_reply(radius), DropCause::kUnexpected);
  Pair agreed(link::kFeatureStepHistory, link::kFeatureStepHistory);
  EXPECT_EQ(agreed.hand_made_reply(history), DropCause::kNone);
  EXPECT_EQ(agreed.hand_made_reply(particle), DropCause::kUnexpected);
}

link::Command command_with_totals(double more) {
  link::Command c = VirtualSession::engaged();
  c.control = link::GoldenMessages{}.command_with_features.control;
  c.control.energy_sent_j += more;
  c.control.wave_sum += Vec3(more, -2 * more, 3 * more);
  c.control.wave_energy_aj += 4 * more;
  return c;
}

TEST(Features, TotalsAndTheWaveCountFromEachWelcome) {
  Pair p(3, 3);
  VirtualSession& s = *p.s;
  // A session whose first command has gone out with zero totals: they count from there.
  link::Command c = command_with_totals(0);
  const link::PortControl first = c.control;
  ASSERT_GT(s.client.make_command(c, s.now_ns, s.buffer), 0u);
  EXPECT_TRUE(link::same(c.control, first))
      << "the base of this session is the totals of its first command, 0";

  // Silence, resumed: the same totals are the new zero.
  s.link.path_a_to_b().down = true;
  s.command = command_with_totals(0);
  s.ticks(3000);
  s.link.path_a_to_b().down = false;
  s.ticks(2000);
  ASSERT_EQ(s.client.sessions(), 2u);
  ASSERT_EQ(s.client.state(), link::ClientState::kEstablished);
  EXPECT_EQ(s.client.features(), 3u) << "agreed again";
  c = command_with_totals(0.5);
  ASSERT_GT(s.client.make_command(c, s.now_ns, s.buffer), 0u);
  EXPECT_EQ(c.control.energy_sent_j, 0.5);
  EXPECT_EQ(c.control.wave_sum, Vec3(0.5, -1, 1.5));
  EXPECT_EQ(c.control.wave_energy_aj, 2);
  EXPECT_EQ(c.control.method, first.method);
  EXPECT_EQ(c.control.energy_scale_aj_j, first.energy_scale_aj_j);
  EXPECT_EQ(c.control.wave_impedance_n_s_m, first.wave_impedance_n_s_m);
  // Totals may not fall; if they do, what is sent is still in range.
  c = command_with_totals(-0.001);
  ASSERT_GT(s.client.make_command(c, s.now_ns, s.buffer), 0u);
  EXPECT_EQ(c.control.energy_sent_j, 0);
  EXPECT_EQ(c.control.wave_energy_aj, 0);
}

TEST(Features, WithoutAgreementAStationSendsNoneOfTheFields) {
  Pair p(3, kFeatureLocalModel);
  VirtualSession& s = *p.s;
  s.command = command_with_totals(1);
  s.ticks(100);
  EXPECT_EQ(p.server.drops().total(), 0u);
  EXPECT_GT(p.server.counters().exchanges, 100u);
  link::Command c = command_with_totals(1);
  const std::size_t n = s.client.make_command(c, s.now_ns, s.buffer);
  EXPECT_TRUE(c.control.empty());
  link::Command plain = c;
  link::Codec codec;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  ASSERT_EQ(codec.encode(plain, out), n);
  EXPECT_TRUE(std::equal(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n), s.buffer.begin()));
}

/// A slave with a particle, or one without that tells of one all the same, and the station that asked for it.
struct ParticleSession {
  ParticleSession(bool asks, bool has_one, const link::Particle& particle)
      : server(test_config(), spring_scene(&slave, nullptr, has_one)) {
    slave->particle = particle;
    link::ClientConfig client;
    if (!asks) client.feature_bits &= ~std::uint64_t{link::kFeatureParticle};
    s = std::make_unique<VirtualSession>(&server, client, net::SimPath{}, net::SimPath{}, 1);
    s->client.start(0);
    s->ticks(50);
  }
  std::size_t reply_bytes() {
    link::Codec codec;
    std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
    return codec.encode(s->client.reply(), out);
  }
  SpringSlave* slave = nullptr;
  Server server;
  std::unique_ptr<VirtualSession> s;
};

TEST(Features, AParticleIsToldWhereThereIsOneAndItWasAskedFor) {
  const link::Particle particle{{60, -1.5, 30}, 29.5, link::ParticleStatus::kPushed};
  ParticleSession told(true, true, particle);
  EXPECT_NE(told.s->client.features() & link::kFeatureParticle, 0u);
  EXPECT_EQ(told.s->client.reply().particle, particle);
  const std::size_t without = ParticleSession(true, false, {}).reply_bytes();
  EXPECT_EQ(told.reply_bytes(), without + 4 * 10 + 6) << "four doubles and a fixed32, two bytes of tag each";
  for (const auto& [asks, has_one] : {std::pair{false, true}, {true, false}, {false, false}}) {
    ParticleSession silent(asks, has_one, particle);
    ASSERT_TRUE(silent.s->client.has_session());
    EXPECT_EQ(silent.s->client.features() & link::kFeatureParticle, 0u) << asks << has_one;
    EXPECT_TRUE(silent.s->client.reply().particle.empty());
    EXPECT_EQ(silent.reply_bytes(), without) << asks << has_one;
    EXPECT_EQ(silent.s->client.drops().total() + silent.server.drops().total(), 0u);
    // Told all the same: unexpected.
    link::Reply r = silent.s->client.reply();
    link::Command c = silent.s->command;
    silent.s->client.make_command(c, silent.s->now_ns, silent.s->buffer);
    r.sequence = r.command_sequence = c.sequence;
    r.particle = particle;
    link::Codec codec;
    const std::size_t n = codec.encode(r, silent.s->buffer);
    silent.s->client.on_datagram({silent.s->buffer.data(), n}, silent.s->now_ns);
    EXPECT_EQ(silent.s->client.drops()[DropCause::kUnexpected], 1u);
  }
}

// The force may be right all the same: it is only left out of the picture.
TEST(Features, AParticleThatIsNowhereIsNotTold) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const link::Particle& bad : {link::Particle{{60, kNan, 30}, 30}, link::Particle{{60, 0, 30}, kNan}}) {
    ParticleSession session(true, true, bad);
    EXPECT_GT(session.server.counters().exchanges, 20u);
    EXPECT_TRUE(session.s->client.reply().particle.empty());
    EXPECT_EQ(session.s->client.reply().fault_bits & link::kFaultNonFinite, 0u);
    EXPECT_EQ(session.s->client.drops().total(), 0u);
  }
}

TEST(Features, AreAgreedAnewWithEachSession) {
  Pair p(3, 3);
  link::Codec codec;
  link::Incoming answer;
  link::Hello hello;
  hello.nonce = 4711;
  hello.feature_bits = kFeatureLocalModel | kUnknownFeature;
  hello.resume_token = p.s->client.welcome().resume_token;
  for (int round = 0; round < 3; ++round) {  // the third one: the same Welcome again
    const std::size_t n = codec.encode(hello, p.s->buffer);
    const std::size_t m =
        p.server.on_datagram({p.s->buffer.data(), n}, p.s->link.address_a(), p.s->now_ns, p.s->answer);
    ASSERT_EQ(codec.decode({p.s->answer.data(), m}, answer), DropCause::kNone);
    if (answer.type == link::MessageType::kChallenge) hello.cookie = answer.challenge.cookie;
    if (answer.type == link::MessageType::kWelcome) {
      EXPECT_EQ(answer.welcome.feature_bits, kFeatureLocalModel);
    }
  }
  EXPECT_EQ(answer.type, link::MessageType::kWelcome);
  EXPECT_EQ(p.server.counters().resumed, 1u);
}

}  // namespace
}  // namespace telenano::server
