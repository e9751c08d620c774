// The server dies, or is shut down, while the hand presses; another one comes in its place.
#include <gtest/gtest.h>

#include "pressed_wall.h"

namespace telenano::support {
namespace {

using control::Method;

constexpr Method kMethods[] = {Method::kNone, Method::kKs,   Method::kKsClamp, Method::kTdpa,
                               Method::kWave, Method::kTank, Method::kModel};

void press(PressedWall& wall) {
  wall.config.to_server.delay_ns = wall.config.to_station.delay_ns = 1'000'000;
  wall.start();
  wall.steps(2500);
  ASSERT_GT(wall.watch->force_nn, 5) << "in contact, or this shows nothing";
}

void comes_back(PressedWall& wall, std::uint32_t epoch, int made = 2) {
  VirtualSession& s = *wall.session;
  EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
  ASSERT_EQ(s.client().state(), link::ClientState::kEstablished);
  EXPECT_NE(s.client().welcome().epoch, epoch) << "a new account";
  EXPECT_EQ(s.station().mode(), station::Mode::kEngaged);
  EXPECT_EQ(wall.watch->made, made);
  // The slave's new account, and none of the old one's.
  EXPECT_NEAR(s.client().slave_energy_aj().in(), wall.watch->energy_in_aj,
              0.02 * wall.watch->energy_in_aj + 0.1);
  // No new allowance: from both sessions together no more than the one.
  const Method method = s.station().method();
  if (promises(method)) {
    EXPECT_LE(wall.hand->account().most_extracted_j(), wall.config.station.allowance_j + 1e-9);
  }
}

TEST(Restart, KilledInContact) {
  for (const Method method : kMethods) {
    for (const int dead_ms : {0, 7, 60, 800}) {
      SCOPED_TRACE(std::string(control::method_name(method)) + " " + std::to_string(dead_ms));
      PressedWall wall(method);
      press(wall);
      const std::uint32_t epoch = wall.session->client().welcome().epoch;
      auto& link = wall.session->link();
      link.path_a_to_b().down = dead_ms > 0;  // nobody listens
      wall.steps(dead_ms);
      link.path_a_to_b().down = false;
      wall.session->restart_server();
      if (dead_ms > 120) {
        EXPECT_EQ(wall.last_force_n, 0);
      }
      wall.steps(4000);
      comes_back(wall, epoch);
    }
  }
}

TEST(Restart, ShutDownInContactWithdrawsAndTheStationHoldsAtOnce) {
  for (const Method method : kMethods) {
    SCOPED_TRACE(control::method_name(method));
    PressedWall wall(method);
    press(wall);
    const std::uint32_t epoch = wall.session->client().welcome().epoch;
    wall.session->stop_server(300);
    EXPECT_EQ(wall.watch->commanded_z_w_nm, 100) << "withdrawn";
    wall.steps(3);
    EXPECT_EQ(wall.session->client().state(), link::ClientState::kLost);
    EXPECT_FALSE(wall.session->client().has_session());
    EXPECT_EQ(wall.session->station().mode(), station::Mode::kHeld) << "at once, not after a time-out";
    wall.steps(100);
    EXPECT_EQ(wall.last_force_n, 0) << "within the 80 ms in which a force fades";
    const std::uint64_t hellos = wall.session->client().hellos_sent();
    wall.steps(3000);
    const std::uint64_t asked = wall.session->client().hellos_sent() - hellos;
    EXPECT_GE(asked, 2u);
    EXPECT_LE(asked, 8u) << "tries again, ever more slowly";
    wall.session->restart_server();
    wall.steps(5000);
    comes_back(wall, epoch);
  }
}

TEST(Restart, AnotherSceneIsALatchedStop) {
  PressedWall wall(Method::kKsClamp);
  press(wall);
  wall.session->set_scene_hash(0x77);
  wall.session->restart_server();
  wall.steps(1000);
  VirtualSession& s = *wall.session;
  EXPECT_EQ(s.client().state(), link::ClientState::kEstablished);
  EXPECT_EQ(s.station().mode(), station::Mode::kStopped);
  EXPECT_EQ(s.station().latched_faults(), station::kFaultOtherScene);
  EXPECT_STREQ(station::fault_name(station::kFaultOtherScene), "another scene than before");
  EXPECT_EQ(wall.last_force_n, 0);
  EXPECT_EQ(wall.watch->commanded_z_w_nm, 100) << "withdrawn by the stop";
  // A person has looked: this scene is the known one from now on.
  s.station().clear_stop();
  wall.steps(500);
  s.restart_server();
  wall.steps(1000);
  EXPECT_EQ(s.station().latched_faults(), 0u);
  EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
}

TEST(Restart, AtAServerWithSeveralScenesTheStationAsksForItsOwnAgain) {
  for (const Method method : {Method::kKsClamp, Method::kTank, Method::kModel}) {
    PressedWall wall(method);
    wall.config.scene_hash = 0x55;
    press(wall);
    VirtualSession& s = *wall.session;
    const std::uint32_t epoch = s.client().welcome().epoch;
    s.set_first_scene(0x77);
    s.restart_server();
    wall.watch->commanded_z_w_nm = s.client().welcome().start_pos_w_nm.z();  // the last slave's place is gone
    bool seen_first = false;
    for (int k = 0; k < 5000; ++k) {
      wall.steps(1);
      if (s.client().welcome().scene_hash != 0x77) continue;
      seen_first = true;
      ASSERT_NE(s.station().mode(), station::Mode::kEngaged) << "in the other scene nothing follows";
      ASSERT_GE(wall.watch->commanded_z_w_nm, s.client().welcome().start_pos_w_nm.z())
          << "its tip stands, or is withdrawn as the session leaves it";
    }
    EXPECT_TRUE(seen_first) << "the server begins there";
    EXPECT_EQ(s.client().welcome().scene_hash, 0x55u);
    EXPECT_EQ(s.server().counters().switched, 1u) << "asked once";
    EXPECT_EQ(s.station().latched_faults(), 0u);
    comes_back(wall, epoch, 3);
  }
}

TEST(Restart, AtAServerThatRefusesItsSceneTheStationStops) {
  PressedWall wall(Method::kKsClamp);
  wall.config.scene_hash = 0x55;
  press(wall);
  VirtualSession& s = *wall.session;
  s.set_first_scene(0x77);
  s.set_scene_hash(0x78);
  s.restart_server();
  wall.steps(1000);
  EXPECT_EQ(s.server().counters().switched, 0u);
  EXPECT_EQ(s.client().welcome().scene_hash, 0x77u);
  EXPECT_EQ(s.station().latched_faults(), station::kFaultOtherScene);
  EXPECT_EQ(wall.last_force_n, 0);
  EXPECT_EQ(wall.watch->commanded_z_w_nm, 100) << "withdrawn by the stop";
}

TEST(Restart, ARestartedStationIsNotCreditedWithWhatTheLastOneHadPutIn) {
  // The first station presses and is killed; the second one resumes by the token within the time-out, in
  // contact, and its tdpa must not take the sums that it finds for news.
  PressedWall first(Method::kTdpa);
  press(first);
  VirtualSession& a = *first.session;
  PressedWall second(Method::kTdpa, 2);
  second.config.server = a.shared_server();
  second.config.start_ns = a.now_ns();
  second.config.port = 4711;
  second.config.resume_token = a.client().resume_token();
  second.watch = first.watch;
  second.start();
  VirtualSession& b = *second.session;
  EXPECT_EQ(b.client().welcome().epoch, a.client().welcome().epoch);
  EXPECT_TRUE(b.client().resumed_unknown_account());
  EXPECT_EQ(first.watch->made, 1) << "the same slave";
  const double account_before = b.station().observer().energy_j();
  second.steps(20);
  EXPECT_EQ(b.station().mode(), station::Mode::kEngaged);
  EXPECT_GT(b.client().slave_energy_aj().in(), 50) << "the account goes on";
  EXPECT_LE(b.loop().trace().account_j, 1e-4) << "none of it is this one's";
  EXPECT_EQ(account_before, 0);
  second.steps(2000);
  EXPECT_LE(second.worst_rise_n, second.slew_limit_n());
}

}  // namespace
}  // namespace telenano::support
