// The real programs over a bad link: telenano-lab relay between a station and its server.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "telenano/common/recording/recording_reader.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

/// A cell of the relay's summary by the names of its row and column.
double summary(const std::string& out, const std::string& row, const std::string& column) {
  const auto lines = lines_of(out);
  const auto split = [](const std::string& line) {
    std::vector<std::string> cells;
    std::istringstream stream(line);
    for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
    return cells;
  };
  if (lines.size() != 3) return std::nan("");
  const auto names = split(lines[0]);
  for (std::size_t i = 1; i < 3; ++i) {
    const auto cells = split(lines[i]);
    if (cells.size() != names.size() || cells[0] != row) continue;
    for (std::size_t k = 0; k < names.size(); ++k) {
      if (names[k] == column) return std::strtod(cells[k].c_str(), nullptr);
    }
  }
  return std::nan("");
}

/// Where a relay listens, once it does.
std::string address_of(ChildProcess& relay) {
  const std::string before = "relay on 127.0.0.1:";
  EXPECT_TRUE(relay.wait_for_err(before, kLong)) << relay.err();
  EXPECT_TRUE(relay.wait_for_err("\n", kLong));
  const std::string said = relay.err();
  return "127.0.0.1:" + std::to_string(std::atoi(said.c_str() + said.find(before) + before.size()));
}

// The relay's model inside the station: the same session, on a link that is worse by what was asked for.
TEST_F(ProgramsTest, APracticeLinkIsAsBadAsAskedFor) {
  Server server(scene_path("flat_silicon_oxide"));
  const Finished run =
      run_program({kMaster, "run", "--server", server.address(), "--task", "contact", "--duration-s", "4",
                   "--practice-link", "rtt=100,loss=5", "--record", path("practice.h5")},
                  {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("practice link: +100 ms, 5 % lost"), std::string::npos) << run.err;
  const recording::RecordingReader reader(path("practice.h5"));
  std::vector<double> rtt_us = reader.read("rtt_us");
  std::sort(rtt_us.begin(), rtt_us.end());
  EXPECT_GT(rtt_us[rtt_us.size() / 2], 100e3);
  EXPECT_LT(rtt_us[rtt_us.size() / 2], 130e3);
  EXPECT_GT(reader.read("lost").back(), 0);
}

TEST_F(ProgramsTest, ASessionOverDelayLossAndDuplicatesEndsWell) {
  // Commands and replies alone are counted here: a recording would fetch a scene that no session before has.
  Server server(scene_path("flakes"), 0, {"--no-scene-sharing"});
  ChildProcess relay({kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--delay-ms", "20",
                      "--loss", "0.05", "--duplicate", "0.1", "--seed", "7"});
  const std::string address = address_of(relay);

  const std::string file = path("relayed.h5");
  const Finished run = run_program({kMaster, "run", "--quiet", "--server", address, "--task", "indent",
                                    "--duration-s", "6", "--rate", "1000", "--record", file},
                                   {}, kLong);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  // The last Byes are still on their way: three of them, with 20 ms each; half a second is far more.
  ::usleep(500'000);
  relay.signal(SIGTERM);
  ASSERT_TRUE(relay.wait(kLong));
  EXPECT_EQ(relay.exit_code(), 0) << relay.err();
  EXPECT_NE(relay.err().find("1 clients came, 0 left idle"), std::string::npos) << relay.err();
  const std::string out = relay.out();

  const recording::RecordingReader reader(file);
  EXPECT_TRUE(reader.closed());
  const auto contact = reader.read("contact_state");
  EXPECT_GT(std::count(contact.begin(), contact.end(), 3.0), 0) << "never touched";
  // A round trip is twice the delay at least, by the station's own measure; and on a shared machine, where
  // both may be late, at least half of them within 10 ms of it.
  std::vector<double> rtt_us = reader.read("rtt_us");
  std::erase(rtt_us, 0.0);
  ASSERT_GT(rtt_us.size(), 500u);
  std::sort(rtt_us.begin(), rtt_us.end());
  EXPECT_GE(rtt_us.front(), 40'000);
  EXPECT_LT(rtt_us[rtt_us.size() / 2], 50'000);

  for (const char* row : {"to_server", "to_client"}) {
    SCOPED_TRACE(row);
    const double sent = summary(out, row, "sent");
    const double lost = summary(out, row, "lost_chance");
    const double twice = summary(out, row, "duplicated");
    ASSERT_GT(sent, 1000) << out;
    // Five deviations of the binomial counts.
    EXPECT_NEAR(lost, 0.05 * sent, 5 * std::sqrt(sent * 0.05 * 0.95));
    EXPECT_NEAR(twice, 0.1 * (sent - lost), 5 * std::sqrt(sent * 0.1 * 0.9));
    EXPECT_EQ(summary(out, row, "delivered"), sent - lost + twice) << out;
    EXPECT_EQ(summary(out, row, "not_sent"), 0);
  }
  // The server counted the duplicates that the relay made, and at most 6 more: Byes that came again.
  const std::string server_said = server.stop();
  const std::string word = "duplicate ";
  const auto at = server_said.find(word);
  ASSERT_NE(at, std::string::npos) << server_said;
  const double seen = std::atof(server_said.c_str() + at + word.size());
  const double made = summary(out, "to_server", "duplicated");
  EXPECT_GE(seen, made - 6) << server_said;
  EXPECT_LE(seen, made + 6) << server_said;
  // What the relay was sent by the server is what the server answered: a reply to every new command.
  EXPECT_NEAR(summary(out, "to_client", "sent"),
              summary(out, "to_server", "sent") - summary(out, "to_server", "lost_chance"), 10);
}

// The link's delay grows within the session, by 60 ms each way and half second, so that it is never taken for
// a silence: at 602 ms there and back a reflected force (0.4 s at most) is no longer shown, and comes back by
// itself. What is waited for is what the station says; that the whole takes longer than the trace is the
// bound.
TEST_F(ProgramsTest, AForceThatGrowsTooOldFadesAndComesBackByItself) {
  std::string trace = "time_s,delay_ms,lost\n0,1,0\n3,1,0\n";
  for (int k = 1; k <= 5; ++k)
    trace += std::to_string(3 + 0.5 * k) + "," + std::to_string(60 * k + 1) + ",0\n";
  trace += "7,301,0\n7.5,150,0\n8,1,0\n600,1,0\n";
  Server server(scene_path("flat_pdms"));
  ChildProcess relay({kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--trace",
                      write("trace.csv", trace), "--quiet"});
  const std::string address = address_of(relay);
  const Finished run = run_program(
      {kMaster, "run", "--server", address, "--method", "ks", "--allow-unsafe-scaling", "--duration-s", "12"},
      {}, kLong);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto gone = run.err.find("the round trip is too long for this method");
  ASSERT_NE(gone, std::string::npos) << run.err;
  const auto held = run.err.find("held", gone);
  const auto back = run.err.find("the round trip is short enough again", gone);
  ASSERT_NE(back, std::string::npos) << run.err;
  EXPECT_LT(held, back) << run.err;
  EXPECT_NE(run.err.find("engaged", back), std::string::npos) << run.err;
}

// What netem does: each datagram has a delay of its own, and some are lost. The measurement of the link waited for answers
// that never came until the server had ended the session, and what was overtaken was taken for lost, down to 50 Hz.
TEST_F(ProgramsTest, AJitteryLinkKeepsItsSessionAndItsRate) {
  std::string why;
  for (int attempt = 0; attempt < 3; ++attempt) {  // a machine that stands still can end a session
    Server server(scene_path("flat_silicon_oxide"));
    ChildProcess relay({kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--delay-ms",
                        "50", "--jitter-ms", "20", "--jitter", "half-normal", "--any-order", "--loss", "0.02",
                        "--quiet", "--seed", std::to_string(attempt + 1)});
    const std::string file = path("jittery.h5");
    const Finished run =
        run_program({kMaster, "run", "--quiet", "--server", address_of(relay), "--method", "tank", "--task",
                     "indent", "--duration-s", "8", "--record", file, "--overwrite"},
                    {}, kLong);
    ASSERT_EQ(run.exit_code, 0) << run.err;
    relay.signal(SIGTERM);
    ASSERT_TRUE(relay.wait(kLong));
    const std::string said = server.stop();
    const recording::RecordingReader reader(file);
    const double sent = reader.read("commands_sent").back();
    double push_nn = 0;
    for (const double force_nn : reader.read("force_w_nn", 2)) push_nn = std::max(push_nn, force_nn);
    if (said.find("(0 resumed)") != std::string::npos && sent > 2500 && push_nn > 10) return;
    why += said + "commands sent: " + std::to_string(sent) + ", push: " + std::to_string(push_nn) + " nN\n";
  }
  FAIL() << why;
}

TEST_F(ProgramsTest, ARelayWithNothingToDoEndsByItsTimeWithASummary) {
  const Finished run = run_program({kLab, "relay", "--listen", "127.0.0.1:0", "--to", "127.0.0.1:9",
                                    "--outage", "0:1", "--duration-s", "1.2", "--rate-bit-s", "1e6"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("1 s: 0 clients"), std::string::npos) << run.err;
  EXPECT_EQ(summary(run.out, "to_server", "sent"), 0) << run.out;
  EXPECT_EQ(summary(run.out, "to_client", "late_max_us"), 0) << run.out;
}

}  // namespace
}  // namespace telenano::programs
