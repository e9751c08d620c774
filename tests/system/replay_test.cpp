// Recorded sessions of the real programs, run again in virtual time by `telenano-lab replay`.
#include <cstdlib>
#include <filesystem>

#include "telenano/common/control/method.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/master/station/station.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

/// A machine that stood still for longer than the slave's time-out between the Welcome and the first tick lets the
/// session be lost: there is a recording, without a session at its beginning, of which `replay` says so.
bool begins_without_session(const std::string& file) {
  const recording::RecordingReader reader(file);
  std::vector<recording::Sample> first(1);
  reader.read_samples(0, first);
  return first[0].station_mode == static_cast<std::uint32_t>(station::Mode::kIdle);
}
constexpr int kAttempts = 5;

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
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const Finished run = run_program(command, {}, kLong);
      EXPECT_EQ(run.exit_code, 0) << run.err;
      if (run.exit_code != 0 || !begins_without_session(file)) break;
    }
    return file;
  }
};

constexpr const char* kHeader =
    "file,recorded_ticks,replayed_ticks,equal_ticks,slave_steps,largest_force_error_n,told_ticks,exact";

TEST_F(ReplayTest, EveryForceComesOutAsRecorded) {
  for (const char* method : {"model", "ks-clamp"}) {
    const std::string file =
        record("flakes", {}, {"--task", "indent", "--duration-s", "3", "--rate", "1000", "--method", method});
    const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
    EXPECT_EQ(replay.exit_code, 0) << replay.err;
    const auto lines = lines_of(replay.out);
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_EQ(lines[0], kHeader);
    EXPECT_NE(lines[1].find(",0,0,yes"), std::string::npos) << lines[1];
    EXPECT_EQ(replay.err, "");
  }
}

// Which replies the server leaves out follows from the commands alone: the replay leaves out the same.
TEST_F(ReplayTest, RepliesThatWereLeftOutAreLeftOutAgain) {
  const std::vector<std::vector<std::string>> links = {{},
                                                       {"--delay-ms", "5", "--loss", "0.05", "--seed", "3"}};
  for (const std::vector<std::string>& link : links) {
    const std::string file = record("flakes", link,
                                    {"--task", "indent", "--duration-s", "3", "--rate", "1000", "--method",
                                     "ks-clamp", "--reply-deadband", "100"});
    const recording::RecordingReader reader(file);
    EXPECT_GT(reader.read("replies_left_out").back(), 500);
    const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
    EXPECT_EQ(replay.exit_code, 0) << replay.err;
    const auto lines = lines_of(replay.out);
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_NE(lines[1].find(",0,0,yes"), std::string::npos) << lines[1] << replay.err;
  }
}

// The twin runs in the replay too, beside a server that is made anew: what is felt, which steps the slave had
// made by each reply, and its state after them must all come out as recorded.
TEST_F(ReplayTest, ATwinComesOutAsRecorded) {
  const std::vector<std::vector<std::string>> links = {
      {},
      {"--delay-ms", "40", "--jitter-ms", "4", "--loss", "0.1", "--duplicate", "0.05", "--seed", "5"},
      {"--delay-ms", "20", "--jitter-ms", "4", "--loss", "0.25", "--seed", "6"}};
  for (const std::vector<std::string>& link : links) {
    for (const char* scene : {"flakes", "particle"}) {
      const std::string file =
          record(scene, link,
                 {"--task", "indent", "--duration-s", "3", "--rate", "1000", "--scene", scene_path(scene)});
      const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
      EXPECT_EQ(replay.exit_code, 0) << replay.err << replay.out;
      const auto lines = lines_of(replay.out);
      ASSERT_EQ(lines.size(), 2u);
      EXPECT_NE(lines[1].find(",0,0,yes"), std::string::npos) << lines[1];
      // To its end, whatever was lost.
      std::vector<double> ticks;
      for (std::size_t at = lines[1].find(".h5,") + 4; ticks.size() < 3; at = lines[1].find(',', at) + 1)
        ticks.push_back(std::atof(lines[1].c_str() + at));
      EXPECT_GT(ticks[0], 1000) << lines[1];  // of 3200, where a busy machine lets none be missed
      EXPECT_EQ(ticks[1], ticks[0]) << lines[1] << replay.err;
      EXPECT_EQ(replay.err, "");
      const recording::RecordingReader reader(file);
      std::vector<recording::Sample> rows(reader.rows());
      reader.read_samples(0, rows);
      EXPECT_EQ(rows[rows.size() / 2].method, static_cast<std::uint32_t>(control::Method::kTwin));
    }
  }
}

/// Numbers of a row of the replay's table.
struct ReplayRow {
  double recorded = 0, replayed = 0, equal = 0, told = 0;
};
ReplayRow row_of(const std::string& line) {
  std::vector<double> numbers;
  for (std::size_t at = line.find(".h5,") + 4; numbers.size() < 6; at = line.find(',', at) + 1)
    numbers.push_back(std::atof(line.c_str() + at));
  return {numbers[0], numbers[1], numbers[2], numbers[5]};
}

/// Ticks of the recording's events with this text.
std::size_t events_with(const recording::RecordingReader& reader, const std::string& text) {
  std::size_t count = 0;
  for (const recording::Event& event : reader.events())
    count += std::string(event.text.data()).find(text) != std::string::npos ? 1 : 0;
  return count;
}

// What ends a log of steps: an outage beyond the slave's time-out, so that the tip is withdrawn by the server's
// own clock and the session resumed; a server that stands still; one that is killed and started again. The
// recording holds the state that the twin took up, and the replay goes on from there to the recording's end.
class OutageReplayTest : public ReplayTest {
 protected:
  enum class Act { kRelayStandsStill, kServerStandsStill, kServerIsKilled };
  void records_and_replays(Act act, const std::string& scene, int attempts = kAttempts) {
    auto server = std::make_unique<Server>(scene_path(scene));
    ChildProcess relay({kLab, "relay", "--listen", "127.0.0.1:0", "--to", server->address(), "--delay-ms",
                        "10", "--loss", "0.02", "--seed", "5"});
    const std::string before = "relay on 127.0.0.1:";
    ASSERT_TRUE(relay.wait_for_err(before, kLong) && relay.wait_for_err("\n", kLong)) << relay.err();
    const std::string said = relay.err();
    const int relay_port = std::atoi(said.c_str() + said.find(before) + before.size());
    const std::string file = path("outage.h5");
    ChildProcess run({kMaster, "run", "--server", "127.0.0.1:" + std::to_string(relay_port), "--record", file,
                      "--task", "indent", "--duration-s", "4", "--rate", "1000", "--scene",
                      scene_path(scene)});
    ASSERT_TRUE(run.wait_for_err("loop: ", kLong)) << run.err();
    ::usleep(1'500'000);
    switch (act) {
      case Act::kRelayStandsStill:
        relay.signal(SIGSTOP);
        ::usleep(900'000);
        relay.signal(SIGCONT);
        break;
      case Act::kServerStandsStill:
        server->child().signal(SIGSTOP);
        ::usleep(900'000);
        server->child().signal(SIGCONT);
        break;
      case Act::kServerIsKilled: {
        const std::string address = server->address();
        server->child().signal(SIGKILL);
        ASSERT_TRUE(server->child().wait(kLong));
        server =
            std::make_unique<Server>(scene_path(scene), std::atoi(address.c_str() + address.rfind(':') + 1));
        break;
      }
    }
    ASSERT_TRUE(run.wait(kLong)) << run.err();
    EXPECT_EQ(run.exit_code(), 0) << run.err();
    if (attempts > 1 && begins_without_session(file)) {
      std::filesystem::remove(file);
      records_and_replays(act, scene, attempts - 1);
      return;
    }
    const recording::RecordingReader reader(file);
    if (act != Act::kServerStandsStill) {  // which answers what waits before it looks at its clock
      EXPECT_GE(events_with(reader, "session resumed"), 1u);
    }
    if (act == Act::kRelayStandsStill) {
      EXPECT_FALSE(reader.state_pieces().empty());
    }
    const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
    const auto lines = lines_of(replay.out);
    ASSERT_EQ(lines.size(), 2u) << replay.err;
    const ReplayRow row = row_of(lines[1]);
    EXPECT_EQ(replay.exit_code, 0) << replay.err << replay.out;
    EXPECT_EQ(replay.err, "");
    EXPECT_NE(lines[1].find(",0," + std::to_string(static_cast<int>(row.told)) + ",yes"), std::string::npos)
        << lines[1];
    EXPECT_GT(row.recorded, 1000) << lines[1];
    EXPECT_EQ(row.replayed, row.recorded) << lines[1];
    EXPECT_EQ(row.equal, row.recorded) << lines[1];
    if (act == Act::kRelayStandsStill) {
      EXPECT_GT(row.told, 0) << lines[1];
    }
    EXPECT_LT(row.told, 0.5 * row.recorded) << lines[1];
    std::printf("%s: %s; %zu pieces of states\n", scene.c_str(), lines[1].c_str(),
                reader.state_pieces().size());
  }
};

TEST_F(OutageReplayTest, AnOutageInWhichTheTipWasWithdrawn) {
  records_and_replays(Act::kRelayStandsStill, "lithography");
}

TEST_F(OutageReplayTest, AServerThatStoodStill) {
  records_and_replays(Act::kServerStandsStill, "flakes");
}

TEST_F(OutageReplayTest, AServerThatWasKilledAndStartedAgain) {
  records_and_replays(Act::kServerIsKilled, "flakes");
}

TEST_F(ReplayTest, WhateverTheNetworkDid) {
  const std::string file =
      record("flat_silicon_oxide",
             {"--delay-ms", "10", "--jitter-ms", "4", "--loss", "0.2", "--duplicate", "0.1", "--seed", "3"},
             {"--task", "indent", "--duration-s", "3", "--rate", "1000", "--method", "model"});
  const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
  EXPECT_EQ(replay.exit_code, 0) << replay.err << replay.out;
  EXPECT_NE(replay.out.find(",0,0,yes"), std::string::npos) << replay.out;
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

// A recording holds its station file in full, and its scene where the station has it: the one of the wire's
// hash, be it among those that came with the programs or in the folder in which the station was started.
TEST_F(ReplayTest, ARecordingExplainsItself) {
  const std::string station = "rate_hz = 500\n# a remark\n[task]\nduration_s = 1\n";
  const std::string file =
      record("flakes", {}, {"--task", "position", "--station", write("station.toml", station)});
  const recording::RecordingReader reader(file);
  EXPECT_EQ(reader.configuration("scene_text"), file_text(scene_path("flakes")));
  EXPECT_EQ(reader.configuration("surface.force"), "potential");  // what the file leaves out
  EXPECT_EQ(reader.configuration("station_text"), station);
}

TEST_F(ReplayTest, AUsersOwnSceneIsFoundOrAskedFor) {
  std::string scene = file_text(scene_path("flat_silicon_oxide"));
  scene.replace(scene.find("\"flat_silicon_oxide\""), 20, "\"mine\"");
  const std::string own = write("mine.toml", scene);
  Server server(own), secretive(own, 0, {"--no-scene-sharing"});
  const auto run_in = [&](const std::filesystem::path& folder, const std::string& name, const Server& with) {
    ChildOptions options;
    options.folder = folder;
    const Finished run = run_program(
        station(with, {"--task", "indent", "--duration-s", "1", "--rate", "500", "--record", path(name)}),
        options, kLong);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return path(name);
  };
  const std::string knows = run_in(folder_, "knows.h5", server);
  const std::string does_not = run_in("/", "does_not.h5", server);
  const std::string has_nothing = run_in("/", "has_nothing.h5", secretive);
  EXPECT_EQ(recording::RecordingReader(knows).configuration("scene_text"), scene);
  EXPECT_EQ(recording::RecordingReader(does_not).configuration("scene_text"), "");
  EXPECT_EQ(recording::RecordingReader(knows).configuration("surface.force"), "law");
  EXPECT_EQ(recording::RecordingReader(does_not).configuration("surface.force"), "unknown");
  // Where the station had it; by name in this folder; by file.
  ChildOptions here;
  here.folder = folder_;
  EXPECT_EQ(run_program({kLab, "replay", knows}, {}, kLong).exit_code, 0);
  EXPECT_EQ(run_program({kLab, "replay", does_not}, here, kLong).exit_code, 0);
  EXPECT_EQ(run_program({kLab, "replay", does_not, "--scene", own}, {}, kLong).exit_code, 0);
  // Gone: the recording holds it, as text or as the bundle that the server gave.
  std::filesystem::rename(own, path("away.toml"));
  EXPECT_EQ(run_program({kLab, "replay", knows}, {}, kLong).exit_code, 0);
  EXPECT_EQ(run_program({kLab, "replay", does_not}, {}, kLong).exit_code, 0);
  const Finished lost = run_program({kLab, "replay", has_nothing}, {}, kLong);
  EXPECT_EQ(lost.exit_code, 2);
  EXPECT_NE(lost.err.find("was recorded on the scene 'mine'"), std::string::npos) << lost.err;
  EXPECT_NE(lost.err.find("name its file by --scene FILE"), std::string::npos) << lost.err;
  EXPECT_EQ(lines_of(lost.err).size(), 1u) << lost.err;
}

}  // namespace
}  // namespace telenano::programs
