// One tip for several sessions, through the protocol: the spring floor can be computed by hand.
#include <gtest/gtest.h>

#include <memory>

#include "telenano/common/base/error.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::DropCause;
using net::Rights;

ServerConfig one_tip() {
  ServerConfig config = test_config();
  config.share = Share::kOneTip;
  config.table.timeout_ns = 500'000'000;
  return config;
}

/// A session that does what PROTOCOL.md asks of a station: takes up the position of the tip with every new
/// holding, and says to which holding its own position belongs.
struct Operator {
  Operator(Server* server, std::uint16_t port, Rights rights, std::uint64_t features = link::kKnownFeatures)
      : s(server, config(port, features), net::SimPath{}, net::SimPath{}, port) {
    net::Address address = s.link.address_a();
    address.port = port;
    s.link.set_address_a(address);
    s.standing.rights = rights;
    s.command.tip_pos_w_nm = {0, 0, 50};
    s.client.start(0);
  }
  static link::ClientConfig config(std::uint16_t port, std::uint64_t features) {
    link::ClientConfig c;
    c.nonce_seed = port;
    c.feature_bits = features;
    return c;
  }
  void tick(double dz_nm = 0) {
    const bool has = s.client.has_reply();
    const link::TipShare tip = has ? s.client.reply().tip : link::TipShare{};
    if (has && tip.hold != s.command.tip_hold) s.command.tip_pos_w_nm = tip.pos_w_nm;
    s.command.tip_hold = tip.hold;
    s.command.tip_pos_w_nm.z() += dz_nm;
    s.tick();
  }
  bool holds() const { return s.client.has_reply() && s.client.reply().tip.hold != 0; }
  const link::Reply& reply() const { return s.client.reply(); }

  VirtualSession s;
};

struct Sharing : testing::Test {
  Sharing() : server(one_tip(), spring_scene(&slave)) {}
  void ticks(int n, double a_nm = 0, double b_nm = 0) {
    for (int i = 0; i < n; ++i) {
      if (a) a->tick(a_nm);
      if (b) b->tick(b_nm);
    }
  }
  void two(Rights rights_a = Rights::kOperate, Rights rights_b = Rights::kOperate) {
    a = std::make_unique<Operator>(&server, 1001, rights_a);
    b = std::make_unique<Operator>(&server, 1002, rights_b);
  }
  SpringSlave* slave = nullptr;
  Server server;
  std::unique_ptr<Operator> a, b;
};

TEST_F(Sharing, OneHoldsTheOtherObserves) {
  two();
  ticks(20);
  ASSERT_TRUE(a->holds());
  ASSERT_FALSE(b->holds());
  EXPECT_EQ(b->s.client.features() & link::kFeatureSharing, link::kFeatureSharing);
  ticks(60, -1, -1);  // a goes down by 60; b, which does not hold the tip, would too
  ticks(2);
  EXPECT_EQ(slave->commanded_w_nm().z(), -10);
  EXPECT_EQ(a->reply().force_w_nn.z(), 10);
  EXPECT_EQ(b->reply().force_w_nn.z(), 10) << "sees the force";
  EXPECT_EQ(b->reply().tip.pos_w_nm.z(), -10);
  EXPECT_EQ(a->reply().energy_in_aj, 50);
  EXPECT_EQ(b->reply().energy_in_aj + b->reply().energy_out_aj, 0) << "an observer's account stays zero";
  b->s.command.flags |= link::kFlagStop;
  ticks(5);
  EXPECT_EQ(slave->retracts, 0u) << "nor does its stop";
  EXPECT_EQ(server.tip_holder().number(), 1u);
  EXPECT_EQ(server.counters().opened, 2u);
}

TEST_F(Sharing, AnObserverSeesTheAgeOfAMeasuredForce) {
  two();
  slave->age_ns = 5'000'000;
  ticks(20);
  a->s.link.path_a_to_b().down = true;
  ticks(40);
  EXPECT_NEAR(1e-6 * static_cast<double>(b->reply().measurement_age_ns), 45, 2);
  slave->age_ns = INT64_MAX;  // has not measured yet
  a->s.link.path_a_to_b().down = false;
  ticks(20);
  EXPECT_EQ(b->reply().measurement_age_ns, UINT64_MAX);
}

// Whoever looks on before anybody has moved the tip, after any time.
TEST_F(Sharing, AComputedForceHasNoAge) {
  b = std::make_unique<Operator>(&server, 1002, Rights::kObserve);
  ticks(40);
  ASSERT_TRUE(b->s.client.has_reply());
  EXPECT_EQ(b->reply().measurement_age_ns, 0u);
  a = std::make_unique<Operator>(&server, 1001, Rights::kOperate);
  ticks(20);
  a->s.link.path_a_to_b().down = true;
  ticks(40);
  EXPECT_EQ(b->reply().measurement_age_ns, 0u);
}

// Nor may an instrument that has read nothing yet look like a model.
TEST_F(Sharing, AnInstrumentThatHasReadNothingIsNoModel) {
  ServedScene scene = spring_scene();
  scene.make_slave = [] {
    auto made = std::make_unique<SpringSlave>();
    made->measure();
    return made;
  };
  Server fresh(one_tip(), std::move(scene));
  Operator lone(&fresh, 1003, Rights::kOperate);
  lone.s.command.flags |= link::kFlagHandOver;
  for (int i = 0; i < 20; ++i) lone.tick();
  ASSERT_GT(lone.reply().sequence, 5u);
  EXPECT_EQ(lone.reply().measurement_age_ns, UINT64_MAX);
}

TEST_F(Sharing, ATipThatComesBackIsANewHoldingAndFollowsNothingOfTheOldOne) {
  a = std::make_unique<Operator>(&server, 1001, Rights::kOperate);
  a->s.link.path_a_to_b().delay_ns = a->s.link.path_b_to_a().delay_ns = 20'000'000;
  ticks(200);
  ticks(55, -1);
  ticks(100);
  ASSERT_EQ(slave->commanded_w_nm().z(), -5);
  ASSERT_EQ(server.tip_holder().number(), 1u);
  a->s.command.flags |= link::kFlagStop;
  ticks(100);
  const double up_nm = slave->commanded_w_nm().z();
  ASSERT_GT(up_nm, 20);
  // A station that does not know that the tip is up, and commands on from where it was.
  a->s.command.flags &= ~std::uint32_t{link::kFlagStop};
  for (int i = 0; i < 60; ++i) {
    a->tick();
    EXPECT_GE(slave->commanded_w_nm().z(), up_nm) << i;
  }
  EXPECT_EQ(server.tip_holder().number(), 2u);
  ticks(60);
  EXPECT_EQ(a->reply().tip.hold, 2u);
  ticks(10, -1);
  ticks(60);
  EXPECT_NEAR(slave->commanded_w_nm().z(), slave->highest_nm - 10, 1e-9) << "goes on from where it stood";
}

TEST_F(Sharing, TakingOverMovesNothingAndEnergiesStayWithTheirOwners) {
  two(Rights::kOperate, Rights::kAdminister);
  ticks(20);
  ticks(60, -1);
  ticks(2);
  ASSERT_EQ(a->reply().energy_in_aj, 50);
  const Vec3 before = slave->commanded_w_nm();
  b->s.command.flags |= link::kFlagTakeOver;
  for (int i = 0; i < 6; ++i) {
    ticks(1, -1, 0);  // a still pushes: it does not know yet, or does not care
    EXPECT_LE(std::abs(slave->commanded_w_nm().z() - before.z()), 1) << "what a had sent before b took it";
  }
  ASSERT_TRUE(b->holds());
  ASSERT_FALSE(a->holds());
  const double taken_z = slave->commanded_w_nm().z();
  const double a_in = a->reply().energy_in_aj, a_out = a->reply().energy_out_aj;
  EXPECT_EQ(b->reply().energy_in_aj + b->reply().energy_out_aj, 0);
  EXPECT_EQ(b->reply().force_w_nn.z(), -taken_z) << "no step of the force";
  ticks(4, 0, -1);
  ticks(2);
  // ½(z+4)² − ½z² of b's own; then it lets the whole spring go, and gets back what it had put in.
  const double own_aj = 0.5 * ((taken_z - 4) * (taken_z - 4) - taken_z * taken_z);
  EXPECT_NEAR(b->reply().energy_in_aj, own_aj, 1e-9);
  ticks(40, 0, 1);
  ticks(2);
  EXPECT_EQ(slave->commanded_w_nm().z(), taken_z + 36);
  EXPECT_NEAR(b->reply().energy_out_aj, own_aj, 1e-9) << "not a's";
  EXPECT_EQ(a->reply().energy_in_aj, a_in);
  EXPECT_EQ(a->reply().energy_out_aj, a_out);
}

TEST_F(Sharing, APositionThatIsNotAnchoredToTheHoldingMovesNothing) {
  two(Rights::kOperate, Rights::kAdminister);
  ticks(20);
  ticks(10, -1);
  b->s.command.flags |= link::kFlagTakeOver;
  b->s.command.tip_pos_w_nm = {0, 0, -40};
  for (int i = 0; i < 50; ++i) {
    a->tick();
    b->s.command.tip_hold = 0;  // never learns that it has the tip
    b->s.tick();
    EXPECT_EQ(slave->commanded_w_nm().z(), 40);
  }
  EXPECT_TRUE(b->holds());
}

TEST_F(Sharing, ATipThatWasLeftIsWithdrawnAndThenFree) {
  two();
  ticks(20);
  ticks(60, -1);
  a->s.link.path_a_to_b().down = a->s.link.path_b_to_a().down = true;
  b->s.command.flags |= link::kFlagTakeOver;
  ticks(490);
  EXPECT_FALSE(b->holds());
  EXPECT_EQ(slave->retracts, 0u);
  double last_z = slave->commanded_w_nm().z(), step = 0;
  for (int i = 0; i < 200 && !b->holds(); ++i) {
    ticks(1);
    step = std::max(step, std::abs(slave->commanded_w_nm().z() - last_z));
    last_z = slave->commanded_w_nm().z();
  }
  EXPECT_TRUE(b->holds()) << "110 nm at 1000 nm/s and 50 ms at rest, then it is free";
  EXPECT_EQ(last_z, 100);
  EXPECT_LE(step, 1.0 + 2e-3) << "not all at once, though nothing had moved it for half a second";
  EXPECT_EQ(b->reply().energy_out_aj, 0) << "what came out on the way up is nobody's";
  // a comes back, in the same session and account, and observes.
  a->s.link.path_a_to_b().down = a->s.link.path_b_to_a().down = false;
  ticks(1500);
  ASSERT_TRUE(a->s.client.has_session());
  EXPECT_FALSE(a->holds());
  EXPECT_EQ(a->reply().energy_in_aj, 50);
}

TEST_F(Sharing, AByeFreesTheTipLikewise) {
  two();
  ticks(20);
  ticks(60, -1);
  const std::size_t n = a->s.client.make_bye(link::ByeReason::kDone, a->s.buffer);
  a->s.link.a().send({a->s.buffer.data(), n}, {});
  b->s.command.flags |= link::kFlagTakeOver;
  ticks(5);
  EXPECT_FALSE(b->holds());
  ticks(200);
  EXPECT_TRUE(b->holds());
  // The next session in a's slot has an account of its own.
  a = std::make_unique<Operator>(&server, 1003, Rights::kAdminister);
  for (int i = 0; i < 4000; ++i) ticks(1);
  EXPECT_FALSE(a->holds());
  EXPECT_EQ(a->reply().energy_in_aj, 0);
}

TEST_F(Sharing, AHandedOverTipThatNobodyTakesIsWithdrawn) {
  a = std::make_unique<Operator>(&server, 1001, Rights::kOperate);
  ticks(20);
  ticks(60, -1);
  a->s.command.flags |= link::kFlagHandOver;
  ticks(400);
  EXPECT_FALSE(a->holds());
  EXPECT_EQ(slave->commanded_w_nm().z(), -10);
  ticks(400);
  EXPECT_EQ(slave->commanded_w_nm().z(), 100);
}

TEST_F(Sharing, AStationThatDoesNotKnowSharingIsRefusedAsTooOld) {
  a = std::make_unique<Operator>(&server, 1001, Rights::kOperate,
                                 link::kFeaturePortControl | link::kFeatureLocalModel);
  ticks(20);
  EXPECT_EQ(a->s.client.state(), link::ClientState::kRefused);
  EXPECT_EQ(a->s.client.refuse().reason, link::RefuseReason::kVersion);
  EXPECT_EQ(server.sessions().occupied(), 0u);
  EXPECT_EQ(server.drops()[DropCause::kUnexpected], 1u);
}

TEST(SharingOfferedOnlyWhereThereIsOneTip, APrivateServerDoesNotGrantIt) {
  Server server(test_config(), spring_scene());
  Operator a(&server, 1001, Rights::kOperate);
  for (int i = 0; i < 20; ++i) a.tick();
  ASSERT_TRUE(a.s.client.has_session());
  EXPECT_EQ(
      a.s.client.features(),
      link::kKnownFeatures & ~(link::kFeatureSharing | link::kFeatureRedundancy | link::kFeatureParticle |
                               link::kFeatureWell | link::kFeatureScene | link::kFeatureStepLog |
                               link::kFeatureSharedLog | link::kFeatureUndo | link::kFeatureSceneSwitch));
  EXPECT_TRUE(a.reply().tip.empty());
  // A tip_hold that was not agreed is unexpected.
  link::Command c = a.s.command;
  c.session_id = a.s.client.welcome().session_id;
  c.epoch = a.s.client.welcome().epoch;
  c.sequence = 500;
  c.tip_hold = 1;
  link::Codec codec;
  const std::size_t n = codec.encode(c, a.s.buffer);
  server.on_datagram({a.s.buffer.data(), n}, a.s.link.address_a(), a.s.now_ns, a.s.answer);
  EXPECT_EQ(server.drops()[DropCause::kUnexpected], 1u);
}

TEST(SharingOfferedOnlyWhereThereIsOneTip, ASlaveThatIsTheOnlyOneCannotBePrivate) {
  ServedScene scene = spring_scene();
  scene.one_tip_only = true;
  try {
    Server server(test_config(), scene);
    FAIL();
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("--share one-tip"), std::string::npos);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
  Server server(one_tip(), scene);
  EXPECT_EQ(server.counters().opened, 0u);
}

TEST(Owner, ATokenResumesOnlyItsOwnersSession) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession a(&server, {}, {}, {}, 1);
  a.standing = {true, Rights::kOperate, 111};
  a.client.start(0);
  a.ticks(50);
  ASSERT_TRUE(a.client.has_session());
  const SpringSlave* const first = slave;

  // Another key's holder, who has read the token somewhere: a new session with a slave of its own.
  link::ClientConfig stolen;
  stolen.nonce_seed = 5;
  stolen.resume_token = a.client.resume_token();
  VirtualSession b(&server, stolen, {}, {}, 2);
  net::Address elsewhere = b.link.address_a();
  elsewhere.port = 4002;
  b.link.set_address_a(elsewhere);
  b.standing = {true, Rights::kOperate, 222};
  b.client.start(0);
  b.ticks(50);
  ASSERT_TRUE(b.client.has_session());
  EXPECT_NE(b.client.welcome().epoch, a.client.welcome().epoch);
  EXPECT_NE(b.client.resume_token(), a.client.resume_token());
  EXPECT_FALSE(b.client.resumed_unknown_account());
  EXPECT_NE(slave, first);
  EXPECT_EQ(server.counters().resumed, 0u);
  a.ticks(50);
  EXPECT_EQ(a.client.state(), link::ClientState::kEstablished) << "undisturbed";

  // Nor may it speak or say goodbye in it from a's address.
  link::Codec codec;
  link::Command c = a.command;
  c.session_id = a.client.welcome().session_id;
  c.epoch = a.client.welcome().epoch;
  c.sequence = 900;
  server.on_datagram({a.buffer.data(), codec.encode(c, a.buffer)}, a.link.address_a(), a.now_ns, a.answer,
                     nullptr, b.standing);
  server.on_datagram(
      {a.buffer.data(), codec.encode(link::Bye{c.session_id, link::ByeReason::kDone}, a.buffer)},
      a.link.address_a(), a.now_ns, a.answer, nullptr, b.standing);
  EXPECT_EQ(server.drops()[DropCause::kUnauthenticated], 2u);

  // The owner itself, restarted and somewhere else: the same slave and account, within three round trips.
  link::ClientConfig again = stolen;
  again.nonce_seed = 6;
  net::SimPath way;
  way.delay_ns = 10'000'000;
  VirtualSession d(&server, again, way, way, 3);
  elsewhere.port = 4003;
  d.link.set_address_a(elsewhere);
  d.standing = a.standing;
  d.command.tip_pos_w_nm = a.client.reply().tip_pos_w_nm;
  d.client.start(0);
  int came = 0;
  while (!d.client.has_reply() && came < 1000) {
    d.tick();
    ++came;
  }
  EXPECT_LE(came, 60) << "3 round trips of 20 ms";
  EXPECT_TRUE(d.client.resumed_unknown_account());
  EXPECT_EQ(d.client.welcome().epoch, a.client.welcome().epoch);
  EXPECT_EQ(d.client.welcome().start_pos_w_nm, a.client.reply().tip_pos_w_nm);
  EXPECT_EQ(server.counters().resumed, 1u);
}

}  // namespace
}  // namespace telenano::server
