// The real programs over a thin link: replies left out, what that saves and what it costs the force felt.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <regex>
#include <vector>

#include "telenano/common/recording/recording_reader.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

class ReplyDeadbandTest : public ProgramsTest {
 protected:
  struct Session {
    double sent = 0, left_out = 0, lost = 0, commands_lost = 0, seconds = 0;
    std::vector<double> time_s, force_n;
    std::string said, server_said;
  };

  /// The simulated hand's indentation over the relay, so many bits a second each way.
  Session run_over(const std::string& bit_s, const std::vector<std::string>& flags, bool records = true) {
    Server server(scene_path("flat_silicon_oxide"), 0, {"--no-scene-sharing"});
    ChildProcess relay({kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--delay-ms", "2",
                        "--rate-bit-s", bit_s, "--quiet"});
    const std::string before = "relay on 127.0.0.1:";
    EXPECT_TRUE(relay.wait_for_err(before, kLong) && relay.wait_for_err("\n", kLong)) << relay.err();
    const std::string address =
        "127.0.0.1:" +
        std::to_string(std::atoi(relay.err().c_str() + relay.err().find(before) + before.size()));
    const std::string file = path("thin.h5");
    std::vector<std::string> command{kMaster,  "run",      "--server", address,        "--task",
                                     "indent", "--method", "ks-clamp", "--duration-s", "8"};
    command.insert(command.end(), flags.begin(), flags.end());
    if (records) command.insert(command.end(), {"--record", file, "--overwrite"});
    const Finished run = run_program(command, {}, kLong);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    Session session;
    session.said = run.err;
    session.server_said = server.stop();
    if (!records || run.exit_code != 0) return session;
    const recording::RecordingReader reader(file);
    session.sent = reader.read("reply_sequence").back();
    session.left_out = reader.read("replies_left_out").back();
    session.lost = reader.read("lost").back();
    session.commands_lost = reader.read("commands_lost").back();
    session.time_s = reader.read("time_s");
    session.seconds = session.time_s.back();
    const auto z_n = reader.read("hand_force_commanded_h_n", 2);
    session.force_n.assign(z_n.begin(), z_n.end());
    return session;
  }

  /// Root of the mean square of the difference of two runs' forces at the same time of the task, over the range of the
  /// first; with the second one moved by the time that fits best, since tasks do not begin in the same tick.
  static double nrmse(const Session& a, const Session& b) {
    const auto range = std::minmax_element(a.force_n.begin(), a.force_n.end());
    double best = 1e300;
    for (double shift_s = -0.3; shift_s <= 0.3; shift_s += 0.002) {
      double sum = 0;
      std::size_t n = 0, k = 0;
      for (std::size_t i = 0; i < a.time_s.size(); ++i) {
        while (k + 1 < b.time_s.size() && b.time_s[k] < a.time_s[i] + shift_s) ++k;
        sum += (a.force_n[i] - b.force_n[k]) * (a.force_n[i] - b.force_n[k]);
        ++n;
      }
      best = std::min(best, sum / static_cast<double>(n));
    }
    return std::sqrt(best) / (*range.second - *range.first);
  }
};

TEST_F(ReplyDeadbandTest, AMegabitCarriesFewerRepliesAndTheForceIsTheSame) {
  const Session every = run_over("1e6", {"--reply-deadband", "0"});
  const Session some = run_over("1e6", {"--reply-deadband", "100"});
  ASSERT_GT(every.force_n.size(), 2000u);
  ASSERT_GT(some.force_n.size(), 2000u);
  const double apart = nrmse(every, some);
  std::printf("replies a second: %.0f, and %.0f with 10 %% (%.0f left out); NRMSE of the force felt %.4f\n",
              every.sent / every.seconds, some.sent / some.seconds, some.left_out / some.seconds, apart);
  EXPECT_EQ(every.left_out, 0);
  EXPECT_LT(some.sent / some.seconds, 0.7 * every.sent / every.seconds);
  EXPECT_GT(some.left_out, 0.5 * some.sent);
  // A queue on the way may drop a few; what is left out is not among them.
  EXPECT_LT(some.lost + some.commands_lost, 0.1 * some.left_out);
  EXPECT_LT(apart, 0.1);
  EXPECT_NE(
      some.said.find("note: with --reply-deadband the forces in the recording have steps of up to 10 %"),
      std::string::npos)
      << some.said;
  EXPECT_NE(some.said.find("replies left out"), std::string::npos) << some.said;
  EXPECT_EQ(every.said.find("replies left out"), std::string::npos) << every.said;
}

TEST_F(ReplyDeadbandTest, ALinkThatIsFullAsksForItByItselfAndARecordingDoesNot) {
  const Session full = run_over("3e5", {}, false);
  std::smatch match;
  ASSERT_TRUE(std::regex_search(full.said, match, std::regex("replies left out +(\\d+) of (\\d+)")))
      << full.said;
  EXPECT_GT(std::atof(match[1].str().c_str()), 0.05 * std::atof(match[2].str().c_str()));
  const Session recorded = run_over("3e5", {});
  EXPECT_EQ(recorded.left_out, 0);
  const Session wide = run_over("2e7", {}, false);
  EXPECT_EQ(wide.said.find("replies left out"), std::string::npos) << wide.said;
}

}  // namespace
}  // namespace telenano::programs
