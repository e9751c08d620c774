// What the programs tell a monitor: real scrapes over HTTP, and what is said where there is nothing to
// scrape.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <atomic>
#include <chrono>
#include <map>
#include <regex>
#include <thread>

#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

/// GET /metrics from 127.0.0.1, over a plain socket. "" if nobody answers.
std::string scrape(int port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(static_cast<std::uint16_t>(port));
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0) {
    const std::string get = "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    EXPECT_EQ(::send(fd, get.data(), get.size(), MSG_NOSIGNAL), static_cast<ssize_t>(get.size()));
    char buffer[4096];
    for (ssize_t n; (n = ::recv(fd, buffer, sizeof buffer, 0)) > 0;)
      answer.append(buffer, static_cast<std::size_t>(n));
  }
  ::close(fd);
  return answer;
}

/// "name{labels}" → value, of the text format.
std::map<std::string, double> values_of(const std::string& answer) {
  std::map<std::string, double> values;
  for (const std::string& line : lines_of(answer)) {
    const auto space = line.rfind(' ');
    if (!line.starts_with("telenano_") || space == std::string::npos) continue;
    values[line.substr(0, space)] = std::strtod(line.c_str() + space, nullptr);
  }
  return values;
}

int port_in(const std::string& said) {
  std::smatch match;
  return std::regex_search(said, match, std::regex("metrics at http://127\\.0\\.0\\.1:(\\d+)/metrics"))
             ? std::stoi(match[1])
             : 0;
}

class MetricsTest : public ProgramsTest {
 protected:
  void SetUp() override {
    if (!TELENANO_WITH_METRICS) GTEST_SKIP() << "a build without metrics";
    ProgramsTest::SetUp();
  }
};

TEST_F(MetricsTest, ServerAndStationAnswerScrapesWhileTheyWork) {
  Server server(scene_path("flat_silicon_oxide"), 0, {"--metrics", "127.0.0.1:0"});
  ASSERT_TRUE(server.child().wait_for_err("metrics at", kLong)) << server.child().err();
  ASSERT_TRUE(server.child().wait_for_err("/metrics", kLong));
  const int server_port = port_in(server.child().err());
  ASSERT_GT(server_port, 0) << server.child().err();
  auto idle = values_of(scrape(server_port));
  EXPECT_EQ(idle["telenano_exchanges_total"], 0);
  EXPECT_EQ(idle["telenano_sessions{state=\"active\"}"], 0);
  EXPECT_TRUE(idle.contains("telenano_drops_total{cause=\"bad_magic\"}"));

  ChildProcess station({kMaster, "run", "--server", server.address(), "--task", "contact", "--duration-s",
                        "6", "--metrics", "127.0.0.1:0", "--redundancy", "2", "--method", "model"});
  ASSERT_TRUE(station.wait_for_err("/metrics\n", kLong)) << station.err();
  const int station_port = port_in(station.err());
  ASSERT_GT(station_port, 0) << station.err();
  std::this_thread::sleep_for(Milliseconds(2500));
  const std::string page = scrape(server_port);
  EXPECT_NE(page.find("200 OK"), std::string::npos);
  EXPECT_NE(page.find("# TYPE telenano_service_seconds histogram"), std::string::npos);
  auto served = values_of(page);
  EXPECT_EQ(served["telenano_sessions{state=\"active\"}"], 1);
  EXPECT_EQ(served["telenano_sessions_opened_total"], 1);
  EXPECT_GT(served["telenano_exchanges_total"], 500);
  EXPECT_EQ(served["telenano_service_seconds_count"], served["telenano_exchanges_total"])
      << "one snapshot, and every exchange is in its histogram";
  EXPECT_EQ(served["telenano_service_seconds_bucket{le=\"+Inf\"}"], served["telenano_service_seconds_count"]);
  EXPECT_GT(served["telenano_service_seconds_sum"], 0);
  EXPECT_EQ(served["telenano_session_rate_hz{slot=\"0\"}"], 1000);
  EXPECT_GT(served["telenano_session_rtt_seconds{slot=\"0\"}"], 0);
  EXPECT_LT(served["telenano_session_rtt_seconds{slot=\"0\"}"], 0.5);
  EXPECT_LT(served["telenano_session_silent_seconds{slot=\"0\"}"], 1);
  EXPECT_GT(served["telenano_session_commands_total{slot=\"0\"}"], 500);

  auto felt = values_of(scrape(station_port));
  EXPECT_GT(felt["telenano_ticks_total"], 500);
  EXPECT_GT(felt["telenano_link_rtt_seconds"], 0);
  EXPECT_LT(felt["telenano_link_rtt_seconds"], 0.5);
  EXPECT_LE(felt["telenano_link_rtt_min_seconds"], felt["telenano_link_rtt_seconds"]);
  EXPECT_GT(felt["telenano_link_force_age_seconds"], 0);
  EXPECT_GT(felt["telenano_link_replies_total"], 500);
  // One clock: no drift, but for the noise of a busy machine; the error says how much that is.
  EXPECT_LT(std::abs(felt["telenano_link_clock_drift_ppm"]),
            50 + 10 * felt["telenano_link_clock_drift_error_ppm"]);
  EXPECT_EQ(felt["telenano_station_mode{mode=\"engaged\"}"] + felt["telenano_station_mode{mode=\"held\"}"] +
                felt["telenano_station_mode{mode=\"ready\"}"],
            1);

  // Scrapes as fast as they come do not hurt the session: it ends as it should.
  int scrapes = 0;
  while (station.running()) {
    if (scrape(server_port).find("200 OK") != std::string::npos) ++scrapes;
  }
  EXPECT_GT(scrapes, 20);
  EXPECT_EQ(station.exit_code(), 0) << station.err();
  // Its status line tells of the link.
  for (const char* word : {"RTT", "jitter", "lost", "age", "clock"})
    EXPECT_NE(station.err().find(word), std::string::npos) << word;
  std::this_thread::sleep_for(Milliseconds(300));
  auto after = values_of(scrape(server_port));
  EXPECT_EQ(after["telenano_sessions_ended_total"], 1);
  EXPECT_FALSE(after.contains("telenano_session_rtt_seconds{slot=\"0\"}"))
      << "no series for those that are gone";
  EXPECT_EQ(scrape(station_port), "");
  server.stop();
}

TEST_F(MetricsTest, MistakesAreOneLine) {
  Server server(scene_path("flat_silicon_oxide"), 0, {"--metrics", "127.0.0.1:0"});
  ASSERT_TRUE(server.child().wait_for_err("/metrics", kLong));
  const std::string taken = "127.0.0.1:" + std::to_string(port_in(server.child().err()));
  const std::vector<std::string> serve = {
      kNve, "serve", "--scene", scene_path("flat_silicon_oxide"), "--listen", "127.0.0.1:0"};
  const std::vector<std::string> run = {kMaster,          "run",          "--quiet", "--server",
                                        server.address(), "--duration-s", "0.5"};
  const auto with = [](std::vector<std::string> command, std::initializer_list<std::string> more) {
    command.insert(command.end(), more);
    return command;
  };
  const auto expect_error = [](const std::vector<std::string>& command,
                               const std::vector<std::string>& words) {
    const Finished done = run_program(command, {}, kLong);
    EXPECT_EQ(done.exit_code, 2) << done.err;
    std::size_t about = 0;
    for (const std::string& line : lines_of(done.err))
      about += line.find(words[0]) != std::string::npos ? 1 : 0;
    EXPECT_EQ(about, 1u) << done.err;
    for (const std::string& word : words)
      EXPECT_NE(done.err.find(word), std::string::npos) << word << "\n" << done.err;
  };
  for (const auto& command : {serve, run}) {
    expect_error(with(command, {"--metrics", taken}),
                 {"--metrics " + taken, "another program", "choose another port"});
    expect_error(with(command, {"--metrics", "0.0.0.0:0"}), {"--metrics 0.0.0.0:0", "--metrics-public"});
    expect_error(with(command, {"--metrics", "nonsense"}), {"--metrics", "expected HOST:PORT"});
    expect_error(with(command, {"--dscp", "best"}), {"--dscp 'best'", "0 to 63"});
    expect_error(with(command, {"--dscp", "64"}), {"--dscp '64'", "0 to 63"});
  }
  server.stop();
}

/// A connection to the metrics' port that says `first` and nothing more.
int hang_on(int port, const std::string& first) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(static_cast<std::uint16_t>(port));
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at), 0);
  EXPECT_EQ(::send(fd, first.data(), first.size(), MSG_NOSIGNAL), static_cast<ssize_t>(first.size()));
  return fd;
}

TEST_F(MetricsTest, WhoConnectsAndSaysNothingDoesNotKeepOthersOut) {
  Server server(scene_path("flat_silicon_oxide"), 0, {"--metrics", "127.0.0.1:0"});
  ASSERT_TRUE(server.child().wait_for_err("/metrics", kLong));
  const int port = port_in(server.child().err());
  // Also half a request, one whose lines never end, and more of all than there are threads.
  const std::vector<std::string> firsts = {"", "GET /metrics HTTP/1.1\r\n", "GET"};
  std::vector<int> idle;
  for (int i = 0; i < 3; ++i) idle.push_back(hang_on(port, ""));
  // It takes some 2 s; with one thread and the library's 30 s for each connection three alone take 90 s.
  const auto answered_soon = [&] {
    const auto begin = std::chrono::steady_clock::now();
    const bool answered = scrape(port).find("200 OK") != std::string::npos;
    return answered && std::chrono::steady_clock::now() - begin < Seconds(20);
  };
  EXPECT_TRUE(answered_soon()) << "beside three that are silent";
  for (int i = 0; i < 30; ++i) idle.push_back(hang_on(port, firsts[static_cast<std::size_t>(i) % 3]));
  // Some say a letter now and then: the time is that of the whole request, not from letter to letter.
  std::atomic<bool> over{false};
  std::thread slow([&] {
    while (!over) {
      for (const int fd : idle) (void)!::send(fd, "x", 1, MSG_NOSIGNAL);
      std::this_thread::sleep_for(Milliseconds(100));
    }
  });
  EXPECT_TRUE(answered_soon()) << "beside 33, some of them slow";
  over = true;
  slow.join();
  for (const int fd : idle) ::close(fd);
  server.stop();
}

TEST_F(MetricsTest, OffLoopbackOnlyWhenAsked) {
  Server server(scene_path("flat_silicon_oxide"), 0, {"--metrics", "0.0.0.0:0", "--metrics-public"});
  ASSERT_TRUE(server.child().wait_for_err("metrics at", kLong)) << server.child().err();
  server.stop();
}

TEST_F(ProgramsTest, StationFilesMayAskForLinkOptions) {
  Server server(scene_path("flat_silicon_oxide"));
  const std::string file = write("link.toml",
                                 "[link]\nplayout = \"constant\"\nplayout_delay_ms = 8.0\nredundancy = 3\n"
                                 "deadband_nm = 0.02\ndeadband_n = 0.05\nheartbeat_ms = 5.0\n");
  const Finished done =
      run_program(station(server, {"--station", file, "--task", "contact", "--duration-s", "2"}), {}, kLong);
  EXPECT_EQ(done.exit_code, 0) << done.err;
  for (const auto& [text, word] : std::map<std::string, std::string>{
           {"[link]\nplayout = \"late\"\n", "adaptive"},
           {"[link]\nredundancy = 5\n", "redundancy"},
           {"[link]\nheartbeat_ms = 11.0\n", "heartbeat_ms"},
           {"[limits]\nstale_hold_s = 0.004\n[link]\ndeadband_nm = 0.1\n", "stale_hold_s"},
           {"[link]\ndelay = 3\n", "delay"}}) {
    const Finished bad = run_program(station(server, {"--station", write("bad.toml", text)}), {}, kLong);
    EXPECT_EQ(bad.exit_code, 2) << text;
    EXPECT_NE(bad.err.find(word), std::string::npos) << bad.err;
  }
  server.stop();
}

}  // namespace
}  // namespace telenano::programs
