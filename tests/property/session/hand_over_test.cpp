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

}  // namespace
}  // namespace telenano::support
