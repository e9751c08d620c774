// What a program prints can be lost, to a full disk or because its reader has gone. Sessions go on; of a result that is
// lost the exit code tells.
#include "telenano/common/recording/recording_reader.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

class PrintingTest : public ProgramsTest {
 protected:
  /// Not --quiet: it prints while its loop runs.
  static std::vector<std::string> telling_station(const Server& server, const std::string& file) {
    return {kMaster,  "run",          "--server", server.address(), "--device", "sim",      "--task",
            "indent", "--duration-s", "3",        "--rate",         "1000",     "--record", file};
  }
  static void expect_whole(const std::string& file) {
    const recording::RecordingReader reader(file);
    EXPECT_TRUE(reader.closed());
    EXPECT_FALSE(reader.cut_short());
    EXPECT_EQ(reader.rows_dropped(), 0u);
    EXPECT_GT(reader.rows(), 1000u);  // 3 s at 1000 Hz, on a machine that may be busy
  }
  static std::vector<std::string> by_shell(const std::string& line, const std::vector<std::string>& command) {
    std::vector<std::string> words{"/bin/sh", "-c", line, "sh"};
    words.insert(words.end(), command.begin(), command.end());
    return words;
  }
};

TEST_F(PrintingTest, ASessionGoesOnWithoutItsText) {
  Server server(scene_path("flat_silicon_oxide"));
  const Finished full = run_program(
      by_shell("exec \"$@\" >/dev/full 2>&1", telling_station(server, path("full.h5"))), {}, kLong);
  EXPECT_EQ(full.ended_by, 0);
  EXPECT_EQ(full.exit_code, 0);
  expect_whole(path("full.h5"));

  // Whether or not its parent has it ignore broken pipes.
  for (const char* const before : {"", "trap '' PIPE; "}) {
    ChildProcess unread(
        by_shell(std::string(before) + "exec \"$@\"", telling_station(server, path("unread.h5"))));
    ASSERT_TRUE(unread.wait_for_err("loop: ", kLong)) << unread.err();
    unread.hang_up(STDERR_FILENO);
    ASSERT_TRUE(unread.wait(kLong));
    EXPECT_EQ(unread.ended_by(), 0);
    EXPECT_EQ(unread.exit_code(), 0);
    expect_whole(path("unread.h5"));
    std::filesystem::remove(path("unread.h5"));
  }

  ChildOptions no_room;
  no_room.out_file = "/dev/full";
  const Finished lost = run_program({kMaster, "export", path("full.h5")}, no_room);
  EXPECT_EQ(lost.exit_code, 1);
  EXPECT_EQ(lost.err, "telenano-master: cannot write to standard output\n");
}

// The disk that is full of the log has no room for the recording either: the thread that writes it warns, in vain.
TEST_F(PrintingTest, ASessionGoesOnWithoutItsTextAndItsRecording) {
  Server server(scene_path("flat_silicon_oxide"));
  const auto begin = std::chrono::steady_clock::now();
  std::vector<std::string> command = telling_station(server, path("no_room.h5"));
  command.push_back("--quiet");
  const Finished run =
      run_program(by_shell("ulimit -f 200; exec \"$@\" >/dev/full 2>&1", command), {}, kLong);
  EXPECT_EQ(run.ended_by, 0);
  EXPECT_EQ(run.exit_code, 1);  // the recording is incomplete
  EXPECT_GE(std::chrono::steady_clock::now() - begin, Seconds(3));
}

// As of `serve 2>&1 | head -1`.
TEST_F(PrintingTest, AServerGoesOnWithoutItsReader) {
  Server server(scene_path("flat_silicon_oxide"));
  server.child().hang_up(STDERR_FILENO);
  server.child().signal(SIGHUP);  // of which it tells
  const Finished run = run_program(telling_station(server, path("session.h5")), {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  expect_whole(path("session.h5"));
  server.child().signal(SIGTERM);
  ASSERT_TRUE(server.child().wait(kLong));
  EXPECT_EQ(server.child().ended_by(), 0);
  EXPECT_EQ(server.child().exit_code(), 0);
}

TEST_F(PrintingTest, WhoWantsNoMoreLinesIsToldNothing) {
  const std::vector<std::string> curve{kNve, "curve", "--scene", scene_path("flat_silicon_oxide")};
  std::vector<std::string> long_curve = curve;
  long_curve.insert(long_curve.end(), {"--step-nm", "2.6e-6"});
  for (const auto& command :
       {by_shell("ulimit -t 3; exec \"$@\"", long_curve),  // 20 s, if it went on
        std::vector<std::string>{kNve, "check", "--scene", scene_path("flat_silicon_oxide")},
        std::vector<std::string>{kLab, "contact", "--lambda", "1", "--delta", "0"}}) {
    ChildProcess child(command);
    child.hang_up(STDOUT_FILENO);
    ASSERT_TRUE(child.wait(kLong)) << command[1];
    EXPECT_EQ(child.exit_code(), 1) << command[1];
    EXPECT_EQ(child.err(), "") << command[1];
  }
  const Finished head = run_program(by_shell("\"$@\" | head -1", curve));
  EXPECT_EQ(lines_of(head.out).size(), 1u);
  EXPECT_EQ(head.err, "");
}

// A write to a pipe that nobody reads ends no program of ours; another's decides for itself.
TEST_F(PrintingTest, GnuplotHearsOfABrokenPipe) {
  const std::string limits = path("limits.toml");
  ASSERT_EQ(
      run_program({kNve, "check", "--scene", scene_path("flat_silicon_oxide"), "--limits", limits}).exit_code,
      0);
  const std::string gnuplot =
      write("gnuplot", "#!/bin/sh\ngrep SigIgn /proc/self/status >'" + path("ignored") + "'\n");
  std::filesystem::permissions(gnuplot, std::filesystem::perms::owner_all);
  run_program({"/usr/bin/env", "PATH=" + folder_.string() + ":/usr/bin:/bin", kMaster, "plan", "--limits",
               limits, "--plot", path("plan.svg")});
  const std::string ignored = file_text(path("ignored"));
  ASSERT_TRUE(ignored.starts_with("SigIgn:")) << ignored;
  EXPECT_EQ(std::strtoull(ignored.c_str() + 7, nullptr, 16) >> (SIGPIPE - 1) & 1, 0u) << ignored;
}

}  // namespace
}  // namespace telenano::programs
