// Where twin and server part: an outage, a restart, a stop behind a gap, a server that steps beside the log
// or lies. The oracle is the server's slave, recorded at its own port, and the clock of the virtual session.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "tests/property/twin/logged_slave.h"
#include "tests/property/twin/parting_sessions.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;
using station::TwinState;

TEST(Parting, AnOutageEndsInTheServersStateAgain) {
  for (const char* const name : {"flat_silicon_oxide", "flakes", "particle"}) {
    VirtualSession session(pressing(deployed(name), 40));
    steps(session, 1500);
    ASSERT_TRUE(agrees(session)) << name;
    session.link().path_a_to_b().down = true;
    steps(session, 1500);  // beyond the scene's time-out: the slave has withdrawn by itself
    EXPECT_EQ(session.station().mode(), station::Mode::kHeld) << name;
    session.link().path_a_to_b().down = false;
    steps(session, 1500);
    const station::TwinRun& twin = *session.station().twin();
    EXPECT_TRUE(agrees(session)) << name << ": " << station::twin_state_name(twin.state());
    EXPECT_EQ(twin.partings(), 1u) << name;
    EXPECT_EQ(twin.snapshots(), 1u) << name;
    EXPECT_EQ(twin.reason(), static_cast<std::uint32_t>(link::kBreakSilence)) << name;
    EXPECT_LT(twin.behind(), 100u) << name;
    EXPECT_EQ(session.station().method(), Method::kTwin) << name;
  }
}

// What was stepped during an outage comes at its end, up to 4 s of it: all of it is executed soon, and
// nothing is left to be worked off at the little by which the server may be faster than the wall. Two outages
// one after the other, since the bucket of Σdt is filled only slowly after the first.
TEST(Parting, AfterAnOutageOfAnyLengthTheServerCatchesUp) {
  for (const int outage_ms : {1000, 2500, 3500, 4500, 8000}) {
    VirtualSessionConfig config = pressing(deployed("flat_silicon_oxide"), 40);
    VirtualSession session(config);
    steps(session, 1500);
    for (int time = 1; time <= 2; ++time) {
      session.link().path_a_to_b().down = true;
      steps(session, outage_ms);
      session.link().path_a_to_b().down = false;
      steps(session, 3500);
      const station::TwinRun& twin = *session.station().twin();
      EXPECT_LT(twin.behind(), 100u) << outage_ms << " ms, time " << time;
      EXPECT_TRUE(agrees(session)) << outage_ms << " ms, time " << time << ": "
                                   << station::twin_state_name(twin.state());
      EXPECT_EQ(session.station().mode(), station::Mode::kEngaged) << outage_ms << " ms, time " << time;
    }
  }
}

TEST(Parting, ARestartedServerHasATwinFromTheBeginning) {
  VirtualSession session(pressing(deployed("flat_pdms"), 20));
  steps(session, 1500);
  session.restart_server();
  steps(session, 2500);
  EXPECT_TRUE(agrees(session));
  EXPECT_EQ(session.station().method(), Method::kTwin);
  EXPECT_EQ(session.station().twin()->partings(), 0u) << "a new slave is known from its first step";
  EXPECT_LT(session.station().twin()->behind(), 60u);
}

// What a window draws: ploughed through an outage, so that the second twin is the one in use, then with a new
// server. The oracle is the surface of the server's own slave, which the view rounds to single precision.
TEST(Parting, TheHeightsToLookAtAreThoseOfTheServersSample) {
  const auto scene = deployed("lithography");
  const slave::NveSlave* servers = nullptr;
  VirtualSessionConfig config = pressing(scene, 40);
  config.script.resize(1);
  for (const device::IntendedMotion::Waypoint& to :
       {device::IntendedMotion::Waypoint{0.8, {0, 0, -8}}, {5, {30, 0, -8}}, {5.5, {30, 0, 10}}})
    config.script.push_back(to);
  config.make_slave = [&] {
    auto slave = std::make_unique<slave::NveSlave>(scene);
    servers = slave.get();
    return slave;
  };
  VirtualSession session(config);
  const station::TwinRun& twin = *session.station().twin();
  const auto furthest_nm = [&](double& lowest_nm) {
    lowest_nm = 0;
    double most = 0;
    const surface::HeightGrid own = servers->marked_surface()->heights();
    const surface::HeightGrid seen = twin.heights()->heights();
    EXPECT_EQ(seen.columns, own.columns);
    EXPECT_EQ(seen.dx_nm, own.dx_nm);
    EXPECT_EQ(seen.x_first_nm, own.x_first_nm);
    for (std::size_t i = 0; i < own.z_nm.size(); ++i) {
      most = std::max(most, std::abs(own.z_nm[i] - seen.z_nm.at(i)));
      lowest_nm = std::min(lowest_nm, own.z_nm[i]);
    }
    return most;
  };
  steps(session, 3000);
  session.link().path_a_to_b().down = true;
  steps(session, 1500);
  session.link().path_a_to_b().down = false;
  steps(session, 4000);
  ASSERT_TRUE(agrees(session));
  ASSERT_EQ(twin.snapshots(), 1u);
  double lowest_nm = 0;
  EXPECT_LT(furthest_nm(lowest_nm), 1e-6);
  EXPECT_LT(lowest_nm, -0.5) << "there is a groove";
  const std::uint64_t before = twin.heights()->version();
  session.restart_server();
  steps(session, 2000);
  ASSERT_TRUE(agrees(session));
  EXPECT_LT(furthest_nm(lowest_nm), 1e-6);
  EXPECT_EQ(lowest_nm, 0) << "a new sample";
  EXPECT_NE(twin.heights()->version(), before) << "who looks hears of it";
}

TEST(Parting, AStepBesideTheLogIsFoundAndMended) {
  const auto scene = deployed("flakes");
  VirtualSessionConfig config = pressing(scene, 60);
  config.make_slave = [scene] { return std::make_unique<StraySlave>(scene, std::vector<int>{1600}, false); };
  VirtualSession session(config);
  steps(session, 1500);
  ASSERT_TRUE(agrees(session));
  // α_F times half a nanometre's force is what the state leaps by; the hand must feel none of that at once:
  // 20 N/s, and its own motion's part.
  const double steepest = steepest_n(session, 1500);
  const station::TwinRun& twin = *session.station().twin();
  EXPECT_TRUE(agrees(session)) << station::twin_state_name(twin.state());
  EXPECT_EQ(twin.partings(), 1u);
  EXPECT_EQ(twin.snapshots(), 1u);
  EXPECT_EQ(twin.reason(), static_cast<std::uint32_t>(link::kBreakNone));
  EXPECT_LT(steepest, 0.02 * 1.5);
}

TEST(Parting, ThreeWithoutAReasonEndTheTwin) {
  const auto scene = deployed("flakes");
  VirtualSessionConfig config = pressing(scene, 20);
  config.make_slave = [scene] {
    return std::make_unique<StraySlave>(scene, std::vector<int>{1500, 2500, 3500}, false);
  };
  VirtualSession session(config);
  steps(session, 5000);
  EXPECT_EQ(session.station().twin()->state(), TwinState::kGivenUp);
  EXPECT_EQ(session.station().method(), Method::kModel);
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged) << "the session goes on";
  EXPECT_EQ(session.station().twin()->heights(), nullptr) << "nobody knows the sample any more";
}

TEST(Parting, AServerThatLiesAboutItsStateGetsNoTwinAndNoEnergy) {
  const auto scene = deployed("flat_pdms");
  VirtualSessionConfig config = pressing(scene, 20);
  config.make_slave = [scene] { return std::make_unique<StraySlave>(scene, std::vector<int>{}, true); };
  VirtualSession session(config);
  steps(session, 5000);
  EXPECT_EQ(session.station().twin()->state(), TwinState::kGivenUp);
  EXPECT_EQ(session.station().method(), Method::kModel);
  const station::StationTrace& t = session.loop().trace();
  EXPECT_LT(t.energy_out_j - t.energy_in_j, session.station().config().allowance_j + 1e-3);
}

TEST(Parting, AStopDoesNotWaitForStepsThatAreMissing) {
  const auto scene = deployed("flat_silicon_oxide");
  const auto log = std::make_shared<ExecutedLog>();
  VirtualSessionConfig config = pressing(scene, 0);
  config.make_slave = [scene, log] { return std::make_unique<LoggedSlave>(scene, log); };
  VirtualSession session(config);
  steps(session, 1500);
  session.link().path_a_to_b().down = true;
  steps(session, 60);  // far more than a datagram repeats
  session.link().path_a_to_b().down = false;
  const std::size_t before = log->size();
  session.loop().set_buttons(device::kButtonStop);
  steps(session, 2);
  ASSERT_GT(log->size(), before) << "the stop was executed with the datagram that brought it";
  EXPECT_TRUE(log->back().input.retract);
  EXPECT_LT(log->size(), before + 40) << "and not after all that was missing";
  steps(session, 500);
  EXPECT_TRUE(log->back().input.retract);
  EXPECT_EQ(session.client().reply().steps.break_reason, static_cast<std::uint32_t>(link::kBreakStop));
  session.loop().set_buttons(0);
}

// The scale is changed while the hand presses and the twin is 200 ms ahead: what is felt goes to the new scale
// without a leap, the log goes on, and the twin is confirmed throughout.
TEST(Parting, AScaleChangedWhilePressingFarAheadIsNoParting) {
  VirtualSession session(pressing(deployed("flakes"), 200));
  steps(session, 2500);
  ASSERT_TRUE(agrees(session));
  ASSERT_EQ(session.station().mode(), station::Mode::kEngaged);
  const double before_n = session.loop().trace().commanded_force_h_n.norm();
  ASSERT_GT(before_n, 0.05);
  const control::Scaling old = session.station().config().scaling;
  ASSERT_GT(session.station().twin()->behind(), 150u);
  for (const double times : {0.5, 1.0}) {
    ASSERT_TRUE(session.station().change_scaling({old.velocity, times * old.force}));
    // Less force may be less at once; more comes by the ramp.
    double steepest = 0;
    double last_n = session.loop().trace().commanded_force_h_n.norm();
    for (int i = 0; i < 1500; ++i) {
      session.step();
      const double now_n = session.loop().trace().commanded_force_h_n.norm();
      steepest = std::max(steepest, now_n - last_n);
      last_n = now_n;
    }
    EXPECT_LT(steepest, 0.05) << times;
    EXPECT_NEAR(last_n, times * before_n, 0.25 * before_n) << times;
    EXPECT_TRUE(agrees(session)) << station::twin_state_name(session.station().twin()->state());
  }
  EXPECT_EQ(session.station().twin()->partings(), 0u);
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged);
  EXPECT_EQ(session.station().method(), Method::kTwin);
}

TEST(Parting, TicksDoNotAllocate) {
  if (!AllocGuard::active()) GTEST_SKIP() << "a sanitizer has its own malloc";
  const auto scene = deployed("flakes");
  VirtualSessionConfig config = pressing(scene, 40);
  config.make_slave = [scene] { return std::make_unique<StraySlave>(scene, std::vector<int>{1600}, false); };
  config.to_server.loss = config.to_station.loss = 0.05;
  VirtualSession session(config);
  steps(session, 1500);
  const AllocGuard guard;
  steps(session, 1000);  // in contact, with losses, and a snapshot
  const auto allocations = guard.allocations();
  EXPECT_EQ(allocations, 0u);
  EXPECT_EQ(session.station().twin()->snapshots(), 1u);
}

}  // namespace
}  // namespace telenano::support
