// Recorded sessions of the real programs, run again in virtual time by `telenano-lab replay`.
#include <cstdlib>

#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

class ReplayTest : public ProgramsTest {
 protected:
  /// Records a session through a relay of this kind; empty: straight to the server.
  std::string record(const std::string& scene, const std::vector<std::string>& relay_flags,
                     const std::vector<std::string>& station_flags) {
    Server server(scene_path(scene));
    std::string address = server.address();
    std::unique_ptr<ChildProcess> relay;
    if (!relay_flags.empty()) {
      std::vector<std::string> command{kLab, "relay", "--listen", "127.0.0.1:0", "--to", address};
      command.insert(command.end(), relay_flags.begin(), relay_flags.end());
      relay = std::make_unique<ChildProcess>(command);
      const std::string before = "relay on 127.0.0.1:";
      EXPECT_TRUE(relay->wait_for_err(before, kLong) && relay->wait_for_err("\n", kLong)) << relay->err();
      const std::string said = relay->err();
      address = "127.0.0.1:" + std::to_string(std::atoi(said.c_str() + said.find(before) + before.size()));
    }
    const std::string file = path("session.h5");
    std::vector<std::string> command{kMaster,    "run",   "--quiet",  "--overwrite",
                                     "--server", address, "--record", file};
    command.insert(command.end(), station_flags.begin(), station_flags.end());
    const Finished run = run_program(command, {}, kLong);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return file;
  }
};

constexpr const char* kHeader =
    "file,recorded_ticks,replayed_ticks,equal_ticks,slave_steps,largest_force_error_n,exact";

TEST_F(ReplayTest, EveryForceComesOutAsRecorded) {
  for (const char* method : {"model", "ks-clamp"}) {
    const std::string file =
        record("flakes", {}, {"--task", "indent", "--duration-s", "3", "--rate", "1000", "--method", method});
    const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
    EXPECT_EQ(replay.exit_code, 0) << replay.err;
    const auto lines = lines_of(replay.out);
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_EQ(lines[0], kHeader);
    EXPECT_NE(lines[1].find(",0,yes"), std::string::npos) << lines[1];
    EXPECT_EQ(replay.err, "");
  }
}

TEST_F(ReplayTest, WhateverTheNetworkDid) {
  const std::string file =
      record("flat_silicon_oxide",
             {"--delay-ms", "10", "--jitter-ms", "4", "--loss", "0.2", "--duplicate", "0.1", "--seed", "3"},
             {"--task", "indent", "--duration-s", "3", "--rate", "1000"});
  const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
  EXPECT_EQ(replay.exit_code, 0) << replay.err << replay.out;
  EXPECT_NE(replay.out.find(",0,yes"), std::string::npos) << replay.out;
}

TEST_F(ReplayTest, AnotherSceneOrAnotherFileIsRefusedInOneLine) {
  const std::string file =
      record("flat_pdms", {}, {"--task", "position", "--duration-s", "1", "--rate", "500"});
  const Finished other = run_program({kLab, "replay", file, "--scene", scene_path("flakes")}, {}, kLong);
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("was recorded on another scene"), std::string::npos) << other.err;
  EXPECT_EQ(lines_of(other.err).size(), 1u);
  const Finished none = run_program({kLab, "replay", scene_path("flakes")}, {}, kLong);
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_EQ(lines_of(none.err).size(), 1u) << none.err;
}

}  // namespace
}  // namespace telenano::programs
