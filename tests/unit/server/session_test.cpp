#include <gtest/gtest.h>

#include <limits>

#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::ClientState;
using link::DropCause;

net::SimPath path(double ms) {
  net::SimPath p;
  p.delay_ns = static_cast<std::int64_t>(ms * 1e6);
  return p;
}

TEST(Session, IsEstablishedThroughACookieAndExchanges) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(15);
  EXPECT_EQ(s.client.state(), ClientState::kChallenged);
  EXPECT_EQ(server.sessions().active(), 0u) << "no state before the cookie comes back";
  s.ticks(100);
  ASSERT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_EQ(s.client.welcome().scene_name, scene_name("spring floor"));
  EXPECT_EQ(s.client.welcome().start_pos_w_nm.z(), 50);
  EXPECT_EQ(s.client.reply().force_w_nn.z(), 3);  // 3 nm into 1 nN/nm
  EXPECT_EQ(s.client.reply().tip_pos_w_nm, Vec3(1, 2, -3));
  EXPECT_EQ(s.client.slave_energy_aj().in(), 4.5);  // ½·1·3²
  EXPECT_EQ(server.drops().total(), 0u);
  EXPECT_EQ(s.client.drops().total(), 0u);
  // Round trip: 5 + 5 ms, and the answer is made at once.
  EXPECT_EQ(s.client.stats().rtt_min_ns(), 10'000'000);
  EXPECT_NEAR(s.client.stats().rtt_ns(), 10e6, 1);
  EXPECT_NEAR(slave->last_dt_s, 1e-3, 1e-12);
}

TEST(Session, ComesUpUnderHeavyLossAndReordering) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    Server server(test_config(), spring_scene());
    net::SimPath bad = path(10);
    bad.jitter_ns = 10'000'000;
    bad.in_order = false;
    bad.loss = 0.4;
    bad.duplicate = 0.2;
    bad.reorder = 0.2;
    link::ClientConfig config;
    config.nonce_seed = seed;
    VirtualSession s(&server, config, bad, bad, seed);
    s.client.start(0);
    s.ticks(10000);
    EXPECT_TRUE(s.client.has_session()) << seed;
    // 36 % of the round trips succeed: the handshake takes two of them at back-offs of 0.1 to 1 s.
    EXPECT_GT(s.client.replies().newest(), 300u) << seed;
    EXPECT_EQ(s.client.slave_energy_aj().in(), 4.5) << seed;
    // A repeated Hello opens no second session, unless every Welcome was lost for the 2 s that an unused one
    // is kept.
    EXPECT_EQ(server.sessions().active(), 1u) << seed;
    EXPECT_LE(server.counters().opened, 4u) << seed;
  }
}

// The first command comes a whole round trip after the Welcome has left, here after 0.8 s: a time-out of 0.3
// s must not end what has not begun.
TEST(Session, BeginsAndIsResumedAtARoundTripLongerThanItsTimeOut) {
  ServerConfig config = test_config();
  config.table.timeout_ns = 300'000'000;
  Server server(config, spring_scene());
  VirtualSession s(&server, {}, path(400), path(400), 1);
  s.client.start(0);
  s.ticks(4000);
  ASSERT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_EQ(server.counters().opened, 1u);
  EXPECT_EQ(server.counters().timed_out, 0u);
  EXPECT_EQ(s.client.reply().force_w_nn.z(), 3);
  // A silence under way still ends it after 0.3 s, and it comes back.
  s.run_until(s.now_ns += 1'000'000'000);
  server.poll(s.now_ns);
  EXPECT_EQ(server.counters().timed_out, 1u);
  const std::uint64_t before = server.counters().exchanges;
  s.ticks(6000);
  EXPECT_EQ(server.counters().opened, 1u);
  EXPECT_EQ(server.counters().resumed, 1u);
  EXPECT_EQ(server.counters().timed_out, 1u);
  EXPECT_GT(server.counters().exchanges, before + 3000);
}

// It is not waited for longer than that: 2 s, then nothing is left, and a Hello that the network repeats
// holds no place for ever.
TEST(Session, WithoutAFirstCommandIsForgottenAfterTwoSeconds) {
  ServerConfig config = test_config();
  config.table.timeout_ns = 300'000'000;
  link::SessionTable table(config.table, config.secret);
  const auto changed = [](std::size_t, link::SlotState) {};
  const std::size_t slot = table.open({}, 1, 1000, 0);
  table.expire(2'000'000'000, changed);
  EXPECT_EQ(table[slot].state, link::SlotState::kActive);
  table.expire(2'000'000'001, changed);
  EXPECT_EQ(table[slot].state, link::SlotState::kFree);
}

// What only a station may send is of no type that a server has: never taken for what came before it.
TEST(Session, AServerThatAsksForTheStationsStateIsNotHeard) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(20);
  ASSERT_EQ(s.client.state(), ClientState::kEstablished);
  link::SnapshotRequest request;
  request.session_id = s.client.welcome().session_id;
  request.snapshot = 1;
  link::Codec codec;
  const std::size_t size = codec.encode(request, s.buffer);
  ASSERT_GT(size, 0u);
  const std::uint64_t before = s.client.drops()[DropCause::kUnknownType];
  EXPECT_EQ(s.client.on_datagram({s.buffer.data(), size}, s.now_ns), link::ClientEvent::kDropped);
  EXPECT_EQ(s.client.drops()[DropCause::kUnknownType], before + 1);
}

TEST(Session, SlaveSeesEachCommandOnceAndNewestOnly) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  net::SimPath bad = path(10);
  bad.duplicate = 0.3;
  bad.reorder = 0.3;
  bad.reorder_ns = 3'500'000;
  VirtualSession s(&server, {}, bad, bad, 3);
  s.client.start(0);
  s.ticks(5000);
  const auto& window = server.sessions()[0].commands;
  EXPECT_GT(window.reordered(), 500u);
  EXPECT_GT(window.duplicate(), 1000u);
  EXPECT_EQ(slave->steps, server.counters().exchanges);
  // All came, so all are either stepped, or late (after a newer one) and dropped.
  EXPECT_EQ(window.lost() + window.received(), window.newest());
  EXPECT_EQ(server.drops()[DropCause::kStale], window.reordered());
  EXPECT_EQ(server.drops()[DropCause::kDuplicate], window.duplicate());
  // The time given to the slave is the station's, whatever the network did to the order: newest command minus
  // first.
  EXPECT_NEAR(slave->total_dt_s, 1e-3 * static_cast<double>(window.newest()), 1e-3 * 4);
}

TEST(Session, TwoAtOnceHaveSlavesOfTheirOwn) {
  int made = 0;
  Server server(test_config(), spring_scene(nullptr, &made));
  link::ClientConfig config_a;
  link::ClientConfig config_b;
  config_b.nonce_seed = 99;
  VirtualSession a(&server, config_a, path(2), path(2), 1);
  VirtualSession b(&server, config_b, path(3), path(3), 2);
  net::Address other = b.link.address_a();
  other.port = 40001;
  b.link.set_address_a(other);
  b.command.tip_pos_w_nm = {0, 0, -7};
  a.client.start(0);
  b.client.start(0);
  for (int i = 0; i < 200; ++i) {
    a.tick();
    b.tick();
  }
  EXPECT_EQ(server.sessions().active(), 2u);
  EXPECT_EQ(made, 2);
  EXPECT_EQ(a.client.reply().force_w_nn.z(), 3);
  EXPECT_EQ(b.client.reply().force_w_nn.z(), 7);
  EXPECT_NE(a.client.welcome().epoch, b.client.welcome().epoch);
  EXPECT_EQ(server.drops().total(), 0u);
}

TEST(Session, GoesOnAfterAShortOutageInTheSameAccount) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(500);
  const auto epoch = s.client.welcome().epoch;
  s.link.path_a_to_b().down = s.link.path_b_to_a().down = true;
  s.ticks(600);
  EXPECT_EQ(s.client.state(), ClientState::kLost);
  s.link.path_a_to_b().down = s.link.path_b_to_a().down = false;
  s.ticks(1500);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_EQ(s.client.welcome().epoch, epoch);
  EXPECT_FALSE(s.client.epoch_changed());
  EXPECT_EQ(s.client.slave_energy_aj().in(), 4.5) << "no energy lost or credited twice";
  EXPECT_EQ(server.counters().opened, 1u);
  EXPECT_EQ(s.client.sessions(), 1u) << "the first reply is enough, no new handshake";
}

TEST(Session, RetractsOnTimeOutAndIsResumedWhereTheTipIs) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(500);
  const auto epoch = s.client.welcome().epoch;
  const auto before = s.client.sessions();
  s.link.path_a_to_b().down = true;
  s.ticks(1990);
  EXPECT_EQ(slave->retracts, 0u);
  s.ticks(30);
  EXPECT_GT(slave->retracts, 0u) << "2 s after the last command";
  EXPECT_EQ(server.counters().timed_out, 1u);
  s.ticks(2000);
  s.link.path_a_to_b().down = false;
  s.on_event = [&](link::ClientEvent event) {
    if (event != link::ClientEvent::kWelcome) return;
    EXPECT_EQ(s.client.welcome().start_pos_w_nm, Vec3(1, 2, 100));
  };
  s.ticks(1500);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_EQ(s.client.sessions(), before + 1);
  EXPECT_EQ(s.client.welcome().epoch, epoch);
}

// In the middle of the retract the tip is still in contact, half of the way behind the commanded end:
// resuming there would be a step of the force.
TEST(Session, IsResumedInARetractAtTheCommandedEndAndNotAtTheTip) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(5), path(5), 1);
  slave->yield_nm_nn = 0.5;
  s.client.start(0);
  s.command.tip_pos_w_nm = {1, 2, -3000};
  s.ticks(500);
  s.link.path_a_to_b().down = true;
  s.ticks(2500);
  ASSERT_GT(slave->retracts, 0u);
  s.link.path_a_to_b().down = false;
  int resumed = 0;
  s.on_event = [&](link::ClientEvent event) {
    if (event != link::ClientEvent::kWelcome) return;
    ++resumed;
    EXPECT_EQ(s.client.welcome().start_pos_w_nm, slave->commanded_w_nm());
    EXPECT_LT(slave->commanded_w_nm().z(), -100);
    EXPECT_GT(slave->commanded_w_nm().z(), -2999);
  };
  while (resumed == 0 && s.now_ns < 5'000'000'000) s.tick();
  EXPECT_EQ(resumed, 1);
}

TEST(Session, IsForgottenAfterThirtySecondsAndStartsANewEpoch) {
  int made = 0;
  Server server(test_config(), spring_scene(nullptr, &made));
  VirtualSession s(&server, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(500);
  s.link.path_a_to_b().down = true;
  s.ticks(33000);
  EXPECT_EQ(server.sessions().occupied(), 0u);
  s.link.path_a_to_b().down = false;
  s.ticks(1500);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_TRUE(s.client.epoch_changed());
  EXPECT_EQ(made, 2);
}

TEST(Session, SurvivesARestartOfTheServerWithANewEpoch) {
  Server first(test_config(1), spring_scene());
  VirtualSession s(&first, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(250);
  s.command.tip_pos_w_nm.z() = -20;
  s.ticks(250);
  EXPECT_EQ(s.client.slave_energy_aj().in(), 200);  // ½·1·20²
  s.command.tip_pos_w_nm.z() = -3;
  s.server = nullptr;
  s.ticks(100);
  Server second(test_config(2), spring_scene());
  s.server = &second;
  const std::int64_t back_ns = s.now_ns;
  while (!s.client.epoch_changed() && s.now_ns < back_ns + 1'000'000'000) s.tick();
  // It is told by a Bye that its session is unknown: Bye, Hello, Challenge, Hello, Welcome at 10 ms a round
  // trip.
  EXPECT_LT(s.now_ns - back_ns, 45'000'000);
  s.ticks(100);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_EQ(s.client.reply().force_w_nn.z(), 3);
  EXPECT_EQ(s.client.slave_energy_aj().in(), 4.5) << "the new account alone, not the old one's maximum";
}

TEST(Session, DoesNotThinkALongWayIsSilence) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(500), path(500), 1);
  bool lost = false;
  s.before_end_of_tick = [&] { lost |= s.client.state() == ClientState::kLost; };
  s.client.start(0);
  s.ticks(10000);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_FALSE(lost);
  EXPECT_EQ(s.client.sessions(), 1u);
  EXPECT_EQ(server.counters().opened, 1u);
}

TEST(Session, AStationThatStoodStillItselfHasLostNothing) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(5), path(5), 1);
  s.client.start(0);
  s.ticks(100);
  const auto stand_still = [&](std::int64_t ns) {
    s.now_ns += ns;
    s.run_until(s.now_ns);
  };
  for (int i = 0; i < 5; ++i) {
    stand_still(1'500'000'000);
    s.ticks(1 + 4 * i);
    EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  }
  EXPECT_EQ(s.client.sessions(), 1u);
  // The server's silence counts from the first command after that, not from when the station stopped.
  stand_still(20'000'000);  // all is answered
  s.server = nullptr;
  stand_still(1'500'000'000);
  s.ticks(200);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  s.ticks(2);
  EXPECT_EQ(s.client.state(), ClientState::kLost);
}

TEST(Session, ACommandStaysOpenWhenAnEarlierOneIsAnswered) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(20), path(20), 1);
  s.client.start(0);
  s.ticks(300);
  s.server = nullptr;  // forty milliseconds of commands are on their way, and half of them are answered
  s.now_ns += 1'000'000'000;
  s.run_until(s.now_ns);
  ASSERT_EQ(s.client.state(), ClientState::kEstablished);
  s.tick();
  EXPECT_EQ(s.client.state(), ClientState::kLost);
}

TEST(Session, AReplyThatEchoesAnImpossibleTimeDoesNotHideSilence) {
  // A round trip of centuries would make every silence look explained (and overflow on the way to a limit in
  // ns).
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(100);
  ASSERT_EQ(s.client.state(), ClientState::kEstablished);
  const double rtt_ns = s.client.stats().rtt_ns();
  link::Codec codec;
  for (const std::uint64_t sent_ns : {std::uint64_t{1} << 63, (std::uint64_t{1} << 63) + 1'000'000'000}) {
    link::Reply forged = s.client.reply();
    ++forged.sequence;
    forged.command_send_time_ns = sent_ns;
    std::array<std::uint8_t, link::kMaxDatagramBytes> bytes{};
    const std::size_t n = codec.encode(forged, bytes);
    s.client.on_datagram({bytes.data(), n}, s.link.now_ns());
  }
  EXPECT_EQ(s.client.stats().rtt_ns(), rtt_ns);
  s.server = nullptr;
  s.ticks(1000);
  EXPECT_EQ(s.client.state(), ClientState::kLost);
}

TEST(Session, RoamsToAnotherAddressWithItsToken) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(5), path(5), 1);
  slave->yield_nm_nn = 0.5;
  s.client.start(0);
  s.ticks(500);
  const auto epoch = s.client.welcome().epoch;
  net::Address elsewhere = s.link.address_a();
  elsewhere.ip[15] = 77;
  s.link.set_address_a(elsewhere);
  s.ticks(50);
  EXPECT_GT(server.drops()[DropCause::kUnauthenticated], 0u);
  s.ticks(1000);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
  EXPECT_EQ(s.client.welcome().epoch, epoch);
  EXPECT_EQ(server.counters().resumed, 1u);
  EXPECT_EQ(s.client.reply().tip_pos_w_nm.z(), -1.5);
  EXPECT_EQ(s.client.welcome().start_pos_w_nm, Vec3(1, 2, -3))
      << "the command, not the tip: no step of the force";
}

TEST(Session, OfAnUnknownVersionIsRefusedWithTheRangeSpoken) {
  Server server(test_config(), spring_scene());
  link::ClientConfig config;
  config.version_min = 2;
  config.version_max = 5;
  VirtualSession s(&server, config, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(20);
  EXPECT_EQ(s.client.state(), ClientState::kRefused);
  EXPECT_EQ(s.client.refuse().reason, link::RefuseReason::kVersion);
  EXPECT_EQ(s.client.refuse().version_min, 1u);
  EXPECT_EQ(s.client.refuse().version_max, 1u);
  EXPECT_EQ(server.drops()[DropCause::kWrongVersion], 1u);
}

TEST(Session, IsRefusedWhenTooFastOrFull) {
  ServerConfig config = test_config();
  config.table.capacity = 1;
  Server server(config, spring_scene());
  link::ClientConfig fast;
  fast.rate_hz = 9000;
  VirtualSession f(&server, fast, path(1), path(1), 1);
  f.client.start(0);
  f.ticks(20);
  EXPECT_EQ(f.client.state(), ClientState::kRefused);
  EXPECT_EQ(f.client.refuse().reason, link::RefuseReason::kRate);

  VirtualSession a(&server, {}, path(1), path(1), 1);
  a.client.start(0);
  a.ticks(20);
  EXPECT_EQ(a.client.state(), ClientState::kEstablished);
  link::ClientConfig other;
  other.nonce_seed = 5;
  VirtualSession b(&server, other, path(1), path(1), 2);
  b.client.start(0);
  b.ticks(20);
  EXPECT_EQ(b.client.state(), ClientState::kRefused);
  EXPECT_EQ(b.client.refuse().reason, link::RefuseReason::kFull);
}

TEST(Session, ByeEndsItRetractsAndFreesTheSlot) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(100);
  for (int i = 0; i < 2; ++i) {
    const std::size_t n = s.client.make_bye(link::ByeReason::kDone, s.buffer);
    ASSERT_GT(n, 0u);
    s.link.a().send({s.buffer.data(), n}, {});
  }
  s.ticks(100);
  EXPECT_EQ(s.client.state(), ClientState::kClosed);
  EXPECT_EQ(server.counters().ended, 1u);
  EXPECT_GT(slave->retracts, 50u);
  s.ticks(2100);
  EXPECT_EQ(server.sessions().occupied(), 0u);
}

TEST(Session, ShuttingDownSaysByeAndTheStationKeepsAsking) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(100);
  net::Address to;
  const std::size_t n = server.next_bye(s.now_ns, s.answer, to);
  ASSERT_GT(n, 0u);
  EXPECT_EQ(to, s.link.address_a());
  s.link.b().send({s.answer.data(), n}, to);
  EXPECT_EQ(server.next_bye(s.now_ns, s.answer, to), 0u);
  s.ticks(300);
  EXPECT_EQ(s.client.state(), ClientState::kLost);
  EXPECT_EQ(s.client.refuse().reason, link::RefuseReason::kShuttingDown);
  Server next(test_config(5), spring_scene());
  s.server = &next;
  s.ticks(1500);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
}

TEST(Session, StopRetractsAndAnOpenClutchHolds) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(100);
  s.command.flags = link::kFlagClutch;  // deadman released
  s.command.tip_pos_w_nm = {0, 0, -40};
  s.ticks(10);
  EXPECT_EQ(s.client.reply().force_w_nn.z(), 3) << "held where it was";
  s.command.flags = link::kFlagClutch | link::kFlagDeadman | link::kFlagStop;
  s.ticks(10);
  EXPECT_GT(slave->retracts, 0u);
  EXPECT_TRUE(s.client.reply().fault_bits & link::kFaultRetracted);
}

TEST(Session, ASlaveThatGoesWrongIsNotFelt) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(100);
  const link::Reply before = s.client.reply();
  slave->broken_nn = std::numeric_limits<double>::quiet_NaN();
  s.command.tip_pos_w_nm = {1, 2, -40};
  s.ticks(10);
  EXPECT_EQ(s.client.reply().force_w_nn, Vec3(0, 0, 0));
  EXPECT_EQ(s.client.reply().tip_pos_w_nm, before.tip_pos_w_nm) << "nor is anything else that it says";
  EXPECT_EQ(s.client.reply().energy_in_aj, before.energy_in_aj);
  EXPECT_EQ(s.client.reply().energy_out_aj, before.energy_out_aj);
  EXPECT_EQ(s.client.reply().contact_state, before.contact_state);
  EXPECT_TRUE(s.client.reply().fault_bits & link::kFaultNonFinite);
  EXPECT_EQ(s.client.state(), ClientState::kEstablished);
}

TEST(Session, SpacingIsBoundedWhateverTheClockSays) {
  SpringSlave* slave = nullptr;
  Server server(test_config(), spring_scene(&slave));
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.ticks(100);
  link::Codec codec;
  link::Command c = s.command;
  c.session_id = s.client.welcome().session_id;
  c.epoch = s.client.welcome().epoch;
  c.sequence = 1000;
  const auto send = [&](std::uint64_t send_time_ns) {
    c.send_time_ns = send_time_ns;
    ++c.sequence;
    const std::size_t n = codec.encode(c, s.buffer);
    EXPECT_GT(server.on_datagram({s.buffer.data(), n}, s.link.address_a(), s.now_ns, s.answer), 0u);
    return slave->last_dt_s;
  };
  send(5'000'000'000);
  EXPECT_DOUBLE_EQ(send(5'002'000'000), 0.002);
  EXPECT_DOUBLE_EQ(send(5'002'000'001), 1e-6);
  EXPECT_DOUBLE_EQ(send(9'002'000'001), 0.1);
  EXPECT_DOUBLE_EQ(send(3), 1e-3) << "backwards: one nominal tick";
  EXPECT_DOUBLE_EQ(send(UINT64_MAX), 1e-3);
}

TEST(Session, EnergyOfTheStationCountsFromItsWelcome) {
  Server server(test_config(), spring_scene());
  VirtualSession s(&server, {}, path(1), path(1), 1);
  s.client.start(0);
  s.command.energy_in_j = 5;
  s.command.energy_out_j = 2;
  s.ticks(100);
  EXPECT_EQ(server.sessions()[0].station_energy.in(), 0);
  s.command.energy_in_j = 5.5;
  s.command.energy_out_j = 2.25;
  s.ticks(100);
  EXPECT_EQ(server.sessions()[0].station_energy.in(), 0.5);
  EXPECT_EQ(server.sessions()[0].station_energy.out(), 0.25);
}

}  // namespace
}  // namespace telenano::server
