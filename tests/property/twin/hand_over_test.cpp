// A server that dies, or leaves its sessions to another one, and a twin: the next server makes the steps of the log
// that came after the checkpoint again, so that twin and slave never part. Both ends compare hashes of all that
// the slave's state is; the oracle besides is a slave that makes the whole log without a checkpoint.
#include <gtest/gtest.h>

#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

/// In a tick the hand goes 0.06 nm along, and 0.2 down; in the time since the checkpoint 40.
constexpr double kTargetStep_nm = 0.5;

class HandOverTwin : public ::testing::TestWithParam<std::string> {};

void goes_on(const std::string& name, bool killed) {
  const auto scene = deployed(name);
  VirtualSessionConfig config = session_config(scene, Link{40, 0, 0, 0}, nullptr);
  config.make_slave = nullptr;
  const slave::NveSlave probe(scene);
  config.checkpoints = std::make_shared<CheckpointBox>(server::kCheckpointBytes + probe.snapshot_bytes_max());
  VirtualSession session(config);
  for (int i = 0; i < 1700; ++i) session.step();  // pressed, and on its way along
  const std::uint32_t epoch = session.client().welcome().epoch;
  const std::uint64_t executed = session.client().reply().steps.executed;
  EXPECT_GT(session.client().reply().force_w_nn.norm(), 1);
  killed ? session.kill_server() : session.hand_out_server();
  // The target is a function of the hand's motion alone: no step where the session goes on, and nothing that is lost
  // with the second since the checkpoint. The force goes by the ramp, which is the hand's own.
  Vec3 last = session.loop().trace().tip_target_pos_w_nm;
  double step_nm = 0;
  const auto look = [&] {
    session.step();
    const Vec3 now = session.loop().trace().tip_target_pos_w_nm;
    step_nm = std::max(step_nm, (now - last).norm());
    last = now;
  };
  for (int i = 0; i < 20; ++i) look();
  session.restart_server();
  for (int i = 0; i < 4500; ++i) look();
  EXPECT_LT(step_nm, kTargetStep_nm);
  const station::TwinRun& twin = *session.station().twin();
  EXPECT_EQ(session.client().welcome().epoch, epoch);
  EXPECT_EQ(session.server().counters().taken_up, 1u);
  EXPECT_EQ(twin.partings(), 0u);
  EXPECT_EQ(twin.snapshots(), 0u);
  EXPECT_GT(twin.confirmed(), executed + 1000)
      << "the server makes the log's steps, and says the twin's hashes";
  EXPECT_LT(twin.behind(), 100u);
  EXPECT_EQ(session.client().reply().steps.breaks, 0u);
}

TEST_P(HandOverTwin, KilledItMakesTheLogFromTheCheckpointOn) {
  goes_on(GetParam(), true);
}

TEST_P(HandOverTwin, HandedOutItGoesOnWithTheNextStep) {
  goes_on(GetParam(), false);
}

INSTANTIATE_TEST_SUITE_P(Scenes, HandOverTwin,
                         ::testing::Values("flat_silicon_oxide", "flakes", "lithography"),
                         [](const auto& one) { return one.param; });

}  // namespace
}  // namespace telenano::support
