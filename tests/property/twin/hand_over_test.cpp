// A server that dies, or leaves its sessions to another one, and a twin: the next server makes the steps of the log
// that came after the checkpoint again, so that twin and slave never part. Both ends compare hashes of all that
// the slave's state is; the oracle besides is a slave that makes the whole log without a checkpoint.
#include <gtest/gtest.h>

#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

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
  for (int i = 0; i < 20; ++i) session.step();
  session.restart_server();
  for (int i = 0; i < 4500; ++i) session.step();
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
