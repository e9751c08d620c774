// Where twin and server part: an outage, a restart, a stop behind a gap, a server that steps beside the log
// or lies. The oracle is the server's slave, recorded at its own port, and the clock of the virtual session.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "tests/property/twin/logged_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;
using station::TwinState;

std::shared_ptr<const scene::Scene> deployed(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

VirtualSessionConfig pressing(const std::shared_ptr<const scene::Scene>& scene, double rtt_ms) {
  VirtualSessionConfig config;
  config.scene = scene;
  config.station.method = Method::kTwin;
  config.twin = true;
  config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e6 * rtt_ms);
  const double z0 = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {{0, {0, 0, z0}}, {0.8, {0, 0, -5}}, {20, {30, 0, -5}}};
  return config;
}

bool agrees(const VirtualSession& session) {
  const TwinState state = const_cast<VirtualSession&>(session).station().twin()->state();
  return state == TwinState::kBehind || state == TwinState::kConfirmed;
}

void steps(VirtualSession& session, int ticks) {
  for (int i = 0; i < ticks; ++i) session.step();
}

/// The hand's force never changes faster than the slew limit; where a state is taken up, 20 N/s, besides what
/// the hand's own motion does.
double steepest_n(VirtualSession& session, int ticks) {
  double steepest = 0;
  Vec3 last = session.loop().trace().commanded_force_h_n;
  for (int i = 0; i < ticks; ++i) {
    session.step();
    const Vec3 now = session.loop().trace().commanded_force_h_n;
    steepest = std::max(steepest, (now - last).norm());
    last = now;
  }
  return steepest;
}

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

/// The server's slave with a step of its own beside the log now and then: a bug, or a lie.
class StraySlave final : public slave::Slave {
 public:
  StraySlave(std::shared_ptr<const scene::Scene> scene, std::vector<int> strays, bool lies)
      : slave_(std::move(scene)), strays_(std::move(strays)), lies_(lies) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    slave_.step(input, dt_s, output);
    if (std::find(strays_.begin(), strays_.end(), ++count_) == strays_.end()) return;
    slave::SlaveInput stray = input;
    stray.follow = true;
    stray.tip_target_pos_w_nm = output.commanded_pos_w_nm + Vec3(0.5, 0, 0.5);
    slave_.step(stray, dt_s, output);
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_.limits(); }
  std::uint64_t state_hash() const noexcept override { return slave_.state_hash() + (lies_ ? 1 : 0); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_.save(out); }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_.snapshot_bytes_max(); }

 private:
  slave::NveSlave slave_;
  std::vector<int> strays_;
  bool lies_;
  int count_ = 0;
};

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
