// The server dies, or leaves its sessions to another one, while the hand presses; the next one goes on from a
// checkpoint: the same epoch, no step, and nothing is given twice.
#include <gtest/gtest.h>

#include "pressed_wall.h"

namespace telenano::support {
namespace {

using control::Method;

constexpr Method kMethods[] = {Method::kNone, Method::kKs,   Method::kKsClamp, Method::kTdpa,
                               Method::kWave, Method::kTank, Method::kModel};

struct KeptWall : PressedWall {
  explicit KeptWall(Method method, const MassSpringConfig* slow = nullptr) : PressedWall(method) {
    if (slow != nullptr) config.hand = hand = std::make_shared<MassSpringHand>(*slow);
    config.to_server.delay_ns = config.to_station.delay_ns = 1'000'000;
    config.checkpoints = box;
    start();
  }
  void press() {
    steps(2500);
    ASSERT_GT(watch->force_nn, 5) << "in contact, or this shows nothing";
    ASSERT_GE(box->written(), 2);
  }
  void goes_on(std::uint32_t epoch, int taken) {
    EXPECT_LE(worst_rise_n, slew_limit_n());
    ASSERT_EQ(session->client().state(), link::ClientState::kEstablished);
    EXPECT_EQ(session->client().welcome().epoch, epoch) << "the same account";
    EXPECT_EQ(box->taken(), taken);
    EXPECT_EQ(session->server().counters().taken_up, 1u);
    EXPECT_EQ(session->station().mode(), station::Mode::kEngaged);
    if (promises(session->station().method())) {
      EXPECT_LE(hand->account().most_extracted_j(), config.station.allowance_j + 1e-9);
    }
  }
  std::shared_ptr<CheckpointBox> box = std::make_shared<CheckpointBox>(4096);
};

constexpr int kRounds = 30;
constexpr double kDeep_m = -0.012;

/// Of 2500 ms; the last checkpoint is then up to a second old.
TEST(HandOver, KilledInContactGoesOnFromTheLastCheckpoint) {
  for (const Method method : kMethods) {
    for (const int dead_ms : {0, 60, 800}) {
      SCOPED_TRACE(std::string(control::method_name(method)) + " " + std::to_string(dead_ms));
      KeptWall wall(method);
      wall.press();
      const std::uint32_t epoch = wall.session->client().welcome().epoch;
      wall.session->kill_server();
      wall.steps(dead_ms);
      wall.session->restart_server();
      wall.steps(4000);
      wall.goes_on(epoch, 1);
      // A wave knows no place: what it lost with the second that is missing comes back from surplus only.
      if (method != Method::kWave) {
        EXPECT_GT(wall.watch->force_nn, 5) << "felt again";
      }
    }
  }
}

TEST(HandOver, HandedOutInContactTheTipStaysWhereItIs) {
  for (const Method method : kMethods) {
    SCOPED_TRACE(control::method_name(method));
    KeptWall wall(method);
    wall.press();
    const std::uint32_t epoch = wall.session->client().welcome().epoch;
    const double held_nm = wall.watch->commanded_z_w_nm;
    const double in_aj = wall.watch->energy_in_aj;
    const double out_aj = wall.watch->energy_out_aj;
    const std::int64_t since_ns = wall.session->now_ns();
    wall.session->hand_out_server();
    EXPECT_EQ(wall.session->server().counters().handed_out, 1u);
    wall.session->restart_server();
    for (int ms = 0; ms < 400 && wall.session->client().welcome().epoch == epoch &&
                     wall.session->server().counters().taken_up == 0;
         ++ms)
      wall.step();
    EXPECT_LE(wall.session->now_ns() - since_ns, 200'000'000) << "held for no longer";
    EXPECT_NEAR(wall.watch->commanded_z_w_nm, held_nm, 1e-9) << "not withdrawn in between";
    wall.steps(4000);
    wall.goes_on(epoch, 1);
    EXPECT_GT(wall.watch->force_nn, 3) << "felt again";
    EXPECT_GE(wall.watch->energy_in_aj, in_aj) << "the account goes on";
    EXPECT_GE(wall.watch->energy_out_aj, out_aj);
  }
}

/// The state of a session that has not moved since it was written is let go as it lies there: so a server with
/// thousands of slow sessions is gone soon.
TEST(HandOver, WhatHasNotMovedSinceItWasWrittenIsNotWrittenAgain) {
  for (const bool moves : {false, true}) {
    SCOPED_TRACE(moves);
    KeptWall wall(Method::kTank);
    wall.press();
    const int before = wall.box->written();
    while (wall.box->written() == before) wall.step();
    wall.steps(990);  // the next is due in 10 ms
    wall.session->server().poll(wall.session->now_ns() + 20'000'000);
    wall.box->work();
    ASSERT_EQ(wall.box->written(), before + 2);
    const std::uint32_t epoch = wall.session->client().welcome().epoch;
    if (moves) wall.steps(20);
    wall.session->hand_out_server();
    EXPECT_EQ(wall.session->server().counters().handed_out, 1u);
    EXPECT_EQ(wall.box->written(), before + (moves ? 3 : 2));
    wall.session->restart_server();
    wall.steps(4000);
    wall.goes_on(epoch, 1);
    EXPECT_GT(wall.watch->force_nn, 5) << "felt again";
  }
}

/// The hand presses, a checkpoint is kept for ever, the hand lets go and has its energy back; then the server
/// dies, the hand goes down where nothing is felt, and the server comes back with the spring loaded; and that
/// again and again.
TEST(HandOver, AnOldCheckpointThatIsRestoredAgainAndAgainGivesNothing) {
  for (const Method method : kMethods) {
    SCOPED_TRACE(control::method_name(method));
    MassSpringConfig deep;  // and so slow that the device's damping takes little
    deep.goal_m = deep.lowest_goal_m = kDeep_m;
    deep.goal_speed_m_s = 0.01;
    deep.arm_stiffness_n_m = 1000;
    KeptWall wall(method, &deep);
    wall.press();
    wall.box->freeze(true);
    const double pressed_aj = wall.watch->energy_in_aj - wall.watch->energy_out_aj;
    ASSERT_GT(pressed_aj, 5);
    const std::uint32_t epoch = wall.session->client().welcome().epoch;
    for (int round = 0; round < kRounds; ++round) {
      wall.hand->go_to(0.004);  // up, with the spring's energy
      wall.steps(2000);
      wall.session->kill_server();
      wall.steps(150);
      wall.hand->go_to(kDeep_m);  // down again, where there is no force
      wall.steps(2000);
      wall.session->restart_server();
      wall.steps(1500);
    }
    EXPECT_EQ(wall.session->client().welcome().epoch, epoch);
    EXPECT_EQ(wall.box->taken(), kRounds);
    std::printf("%-8s %d times %.3g aJ: the hand got %.2f mJ\n",
                std::string(control::method_name(method)).c_str(), kRounds, pressed_aj,
                1e3 * wall.hand->account().most_extracted_j());
    EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
    if (promises(method)) {
      EXPECT_LE(wall.hand->account().most_extracted_j(), wall.config.station.allowance_j + 1e-9);
    }
    if (method == Method::kNone) {
      EXPECT_GT(wall.hand->account().most_extracted_j(), 1.5 * wall.config.station.allowance_j)
          << "who promises nothing pays out each time, or this shows nothing";
    }
  }
}

TEST(HandOver, NobodyElseGetsItAndWhoIsDoneIsForgotten) {
  KeptWall wall(Method::kKsClamp);
  wall.press();
  const std::uint64_t token = wall.session->client().resume_token();
  ASSERT_EQ(wall.box->kept().size(), 1u);
  EXPECT_EQ(wall.box->kept().begin()->first, token);
  std::array<std::uint8_t, link::kMaxDatagramBytes> out;
  const std::size_t n = wall.session->client().make_bye(link::ByeReason::kDone, out);
  wall.session->link().a().send(std::span<const std::uint8_t>(out).first(n),
                                wall.session->link().address_b());
  wall.steps(20);
  EXPECT_EQ(wall.box->kept().size(), 0u);
  EXPECT_EQ(wall.box->ended(), 1);
}

TEST(HandOver, OtherPhysicsAreANewEpoch) {
  KeptWall wall(Method::kKsClamp);
  wall.press();
  const std::uint32_t epoch = wall.session->client().welcome().epoch;
  wall.box->of.physics = 2;
  wall.session->restart_server();
  wall.steps(4000);
  EXPECT_EQ(wall.session->client().state(), link::ClientState::kEstablished);
  EXPECT_NE(wall.session->client().welcome().epoch, epoch);
  EXPECT_EQ(wall.session->server().counters().taken_up, 0u);
  EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
}

/// The same, and each time the server is killed at another scale of hand and tip than that of the checkpoint: what was
/// pressed at one price is not paid back at the other.
TEST(HandOver, AChangeOfScaleAfterTheCheckpointGivesNothing) {
  for (const Method method : {Method::kNone, Method::kKsClamp, Method::kTank, Method::kModel}) {
    SCOPED_TRACE(control::method_name(method));
    MassSpringConfig deep;
    deep.goal_m = deep.lowest_goal_m = kDeep_m;
    deep.goal_speed_m_s = 0.01;
    deep.arm_stiffness_n_m = 1000;
    KeptWall wall(method, &deep);
    wall.press();
    wall.box->freeze(true);
    const control::Scaling before = wall.session->station().config().scaling;
    const std::uint32_t epoch = wall.session->client().welcome().epoch;
    int changed = 0;
    for (int round = 0; round < 12; ++round) {
      control::Scaling other = before;
      other.velocity *= round % 2 == 0 ? 0.5 : 0.8;
      other.force *= round % 3 == 0 ? 0.5 : 1.2;
      wall.hand->go_to(0.004);
      wall.steps(2000);
      changed += wall.session->station().change_scaling(other) ? 1 : 0;
      wall.steps(20);
      wall.session->kill_server();
      wall.steps(150);
      wall.hand->go_to(kDeep_m);
      wall.steps(2000);
      wall.session->restart_server();
      wall.steps(500);
      changed += wall.session->station().change_scaling(before) ? 1 : 0;
      wall.steps(1000);
    }
    EXPECT_EQ(changed, 24);
    EXPECT_EQ(wall.session->client().welcome().epoch, epoch);
    EXPECT_EQ(wall.box->taken(), 12);
    EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
    std::printf("%-8s the hand got %.2f mJ\n", std::string(control::method_name(method)).c_str(),
                1e3 * wall.hand->account().most_extracted_j());
    if (promises(method)) {
      EXPECT_LE(wall.hand->account().most_extracted_j(), wall.config.station.allowance_j + 1e-9);
    } else {
      EXPECT_GT(wall.hand->account().most_extracted_j(), 0.5 * wall.config.station.allowance_j)
          << "who promises nothing pays out each time, or this shows nothing";
    }
  }
}

/// Whose key may only look on: the session goes on, and still nothing of the hand's moves the tip.
TEST(HandOver, AHandThatWatchesStillMovesNothing) {
  KeptWall wall(Method::kKsClamp);
  wall.config.standing = {true, net::Rights::kObserve, 11};
  wall.start();
  wall.steps(2500);
  const double stands_nm = wall.watch->commanded_z_w_nm;
  const std::uint32_t epoch = wall.session->client().welcome().epoch;
  ASSERT_GE(wall.box->written(), 1);
  wall.session->kill_server();
  wall.steps(60);
  wall.session->restart_server();
  wall.steps(3000);
  EXPECT_EQ(wall.session->client().state(), link::ClientState::kEstablished);
  EXPECT_EQ(wall.session->client().welcome().epoch, epoch);
  EXPECT_EQ(wall.session->server().counters().taken_up, 1u);
  EXPECT_EQ(wall.watch->commanded_z_w_nm, stands_nm);
  EXPECT_EQ(wall.watch->most_force_nn, 0);
  EXPECT_EQ(wall.most_force_n, 0);
}

/// An insider with 40 sessions that move all the time: a neighbour's session is kept as often as ever.
TEST(HandOver, AnInsidersSessionsLeaveTheNeighbourItsCheckpoints) {
  CheckpointBox box(4096);
  server::ServerConfig config;
  config.secret = {3, 4};
  config.table.capacity = 64;
  config.mail = &box.mail();
  config.checkpoints = &box.queue();
  server::ServedScene scene;
  scene.physics = box.of.physics;
  scene.make_slave = [] { return std::make_unique<WallSlave>(WallSlaveConfig{}); };
  box.set_make_slave(scene.make_slave);
  server::Server server(config, scene);
  link::Codec codec;
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
  link::Incoming answer;
  std::int64_t now_ns = 1'000'000'000;
  struct Station {
    net::Address from;
    net::Standing standing;
    link::Command command;
  };
  std::vector<Station> stations;
  std::uint64_t neighbour = 0;
  const auto ask = [&](const Station& who, const auto& message) {
    const std::size_t n = codec.encode(message, in);
    const std::size_t m = server.on_datagram({in.data(), n}, who.from, now_ns, out, nullptr, who.standing);
    answer = {};
    if (m > 0) codec.decode({out.data(), m}, answer);
  };
  for (std::uint16_t i = 0; i < 41; ++i) {
    Station station;
    station.from.port = static_cast<std::uint16_t>(1000 + i);
    station.standing = {true, net::Rights::kOperate, i == 20 ? 22u : 11u};
    link::Hello hello;
    hello.version_min = hello.version_max = link::kProtocolVersion;
    hello.nonce = i + 1u;
    hello.rate_hz = 1000;
    ask(station, hello);
    ASSERT_EQ(answer.type, link::MessageType::kWelcome);
    station.command.session_id = answer.welcome.session_id;
    station.command.epoch = answer.welcome.epoch;
    station.command.flags = link::kFlagClutch | link::kFlagDeadman;
    if (i == 20) neighbour = answer.welcome.resume_token;
    stations.push_back(station);
  }
  constexpr int kSeconds = 20;
  for (int ms = 0; ms < 1000 * kSeconds; ++ms) {
    now_ns += 1'000'000;
    for (Station& station : stations) {
      ++station.command.sequence;
      station.command.send_time_ns = static_cast<std::uint64_t>(now_ns);
      station.command.tip_pos_w_nm = {0, 0, 5 + 0.001 * (ms % 1000)};
      ask(station, station.command);
    }
    if (ms % 5 == 0) server.poll(now_ns);
    box.work();
  }
  EXPECT_GE(box.number(neighbour), kSeconds - 1u);
  EXPECT_LE(box.number(neighbour), kSeconds + 1u);
  EXPECT_GE(box.written(), 41 * (kSeconds - 1));
}

}  // namespace
}  // namespace telenano::support
