// The real programs with an AFM: telenano-afm-sim, telenano-nve serve --slave nanonis, telenano-master run.
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>
#include <vector>

#include "telenano/common/control/method.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/link/codec.h"
#include "telenano/common/link/step_log.h"
#include "telenano/common/net/tcp.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/source_dir.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

const std::string kSim = TELENANO_AFM_SIM;

std::string afm_file() {
  return std::string(TELENANO_SOURCE_DIR) + "/deploy/afm.toml";
}

/// telenano-afm-sim on free ports.
class Simulator {
 public:
  explicit Simulator(std::vector<std::string> flags = {}) {
    std::vector<std::string> command{kSim, "--ports", "0,0,0,0"};
    command.insert(command.end(), flags.begin(), flags.end());
    child_ = std::make_unique<ChildProcess>(command);
    EXPECT_TRUE(child_->wait_for_err("\n", kLong)) << child_->err();
    const std::string text = child_->err();
    for (std::size_t at = text.find("127.0.0.1:"); at != std::string::npos;
         at = text.find("127.0.0.1:", at + 1))
      ports_.push_back(std::atoi(text.c_str() + at + 10));
    EXPECT_EQ(ports_.size(), 4u) << text;
    ports_.resize(4);
  }
  // A guard goes on until its controller has said that the tip is up, so for ever once that is gone.
  ~Simulator() {
    if (ports_.size() != 4) return;
    const std::string emergency = "127.0.0.1:" + std::to_string(ports_[3]);
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator("/proc", error)) {
      std::ifstream file(entry.path() / "cmdline");
      const std::string line{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
      if (line.find("afm-guard") != std::string::npos && line.find(emergency) != std::string::npos)
        ::kill(std::atoi(entry.path().filename().c_str()), SIGKILL);
    }
  }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  std::string ports(const std::vector<int>& order = {0, 1, 2, 3}) const {
    std::string text;
    for (const int i : order) {
      if (!text.empty()) text += ',';
      text += std::to_string(ports_[static_cast<std::size_t>(i)]);
    }
    return text;
  }
  /// True as soon as it has.
  bool says(const std::string& text) { return child_->wait_for_err(text, kLong); }
  /// True as soon as the tip has been out and is up again so many times.
  bool withdrawn(int times) {
    for (int i = 0; i < 100 * kLong.count(); ++i) {
      if (static_cast<int>(peaks_nn().size()) >= times) return true;
      ::usleep(10'000);
    }
    return false;
  }
  /// The tip's greatest force, each time that it was out.
  std::vector<double> peaks_nn() {
    std::vector<double> peaks;
    const std::string before = "its greatest force was ", text = child_->err();
    for (auto at = text.find(before); at != std::string::npos; at = text.find(before, at + 1))
      peaks.push_back(std::atof(text.c_str() + at + before.size()));
    return peaks;
  }
  /// What it says at the end: whether the tip is up, the greatest force, how often SafeTip acted.
  std::string stop() {
    child_->signal(SIGTERM);
    EXPECT_TRUE(child_->wait(kLong));
    return child_->err();
  }

 private:
  std::unique_ptr<ChildProcess> child_;
  std::vector<int> ports_;
};

std::vector<std::string> serve(const std::string& ports, const std::string& afm, int port = 0) {
  return {kNve, "serve", "--listen", "127.0.0.1:" + std::to_string(port), "--slave", "nanonis",
          "--controller", "127.0.0.1", "--ports", ports, "--afm", afm, "--without-deadman",
          // Beside the rig's file, which is a test's own.
          "--afm-state", afm.substr(0, afm.rfind('/'))};
}

int port_of(ChildProcess& child) {
  const std::string before = " on 127.0.0.1:";
  EXPECT_TRUE(child.wait_for_err(before, kLong)) << child.err();
  const std::string text = child.err();
  const auto at = text.find(before);
  return at == std::string::npos ? 0 : std::atoi(text.c_str() + at + before.size());
}

/// The guard of a server that runs: its only child. 0: none.
pid_t guard_of(const ChildProcess& server) {
  const std::string pid = std::to_string(server.pid());
  std::ifstream children("/proc/" + pid + "/task/" + pid + "/children");
  pid_t guard = 0;
  children >> guard;
  return guard;
}

bool alive(pid_t pid) {
  std::string line;
  std::getline(std::ifstream("/proc/" + std::to_string(pid) + "/stat"), line);
  const auto name_end = line.rfind(") ");
  return name_end != std::string::npos && line[name_end + 2] != 'Z';
}

/// The guard goes on until the controller has said that the tip is up.
bool ends(pid_t guard) {
  for (int i = 0; i < 100 * kLong.count() && alive(guard); ++i) ::usleep(10'000);
  return !alive(guard);
}

class AfmProgramsTest : public ProgramsTest {
 protected:
  /// deploy/afm.toml with the patience that a machine with many programs needs: no real-time promise here.
  static std::string patient() {
    std::string text = file_text(afm_file());
    for (const auto& [from, to] :
         {std::pair{"link_loss_ms = 100.0", "link_loss_ms = 3000.0"},
          std::pair{"reply_timeout_ms = 100.0", "stale_force_ms = 3000.0\nreply_timeout_ms = 3000.0"}}) {
      const auto at = text.find(from);
      EXPECT_NE(at, std::string::npos) << from;
      text.replace(at, std::string(from).size(), to);
    }
    return text;
  }
  std::string afm() const { return write("patient.toml", patient()); }
  /// The same with one value changed.
  std::string changed(const std::string& key, const std::string& value) const {
    std::string text = patient();
    const auto at = text.find("\n" + key + " = ");
    EXPECT_NE(at, std::string::npos) << key;
    const auto from = at + key.size() + 4, to = text.find_first_of(" \n", from);
    text.replace(from, to - from, value);
    return write("afm.toml", text);
  }
};

TEST_F(AfmProgramsTest, ATaskThroughStationServerAndController) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), afm()));
  const int port = port_of(server);
  ASSERT_GT(port, 0);
  const Finished run =
      run_program({kMaster, "run", "--quiet", "--server", "127.0.0.1:" + std::to_string(port), "--task",
                   "indent", "--duration-s", "5"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const pid_t guard = guard_of(server);
  ASSERT_GT(guard, 0);
  server.signal(SIGTERM);
  ASSERT_TRUE(server.wait(kLong));
  EXPECT_EQ(server.exit_code(), 0) << server.err();
  EXPECT_TRUE(ends(guard));
  EXPECT_NE(server.err().find("withdrawn"), std::string::npos) << server.err();
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
  EXPECT_NE(end.find("SafeTip 0 times"), std::string::npos) << end;
}

// An AFM's sessions never have a log of steps, so that they may have a deadband for replies; what it measures is noisy.
TEST_F(AfmProgramsTest, RepliesWithinADeadbandAreLeftOut) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), afm()));
  const int port = port_of(server);
  ASSERT_GT(port, 0);
  const std::string file = path("afm.h5");
  const Finished run =
      run_program({kMaster, "run", "--server", "127.0.0.1:" + std::to_string(port), "--task", "indent",
                   "--duration-s", "5", "--method", "ks-clamp", "--reply-deadband", "100", "--record", file},
                  {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const recording::RecordingReader reader(file);
  const double left_out = reader.read("replies_left_out").back(), sent = reader.read("reply_sequence").back();
  std::printf("an AFM's replies: %.0f sent, %.0f left out\n", sent, left_out);
  EXPECT_GT(left_out, sent);
  EXPECT_LT(reader.read("commands_lost").back() + reader.read("lost").back(), 0.02 * sent);
  server.signal(SIGTERM);
  ASSERT_TRUE(server.wait(kLong));
  EXPECT_NE(simulator.stop().find("tip withdrawn"), std::string::npos);
}

// A log of steps is for slaves whose state it makes: catching up on a real tip would be a plunge. A station that
// asks for the twin gets none from an AFM, and says why; its recording knows of no logged step. Somebody who
// sends steps all the same is not answered, and nothing follows them.
TEST_F(AfmProgramsTest, AnAfmNeverGetsALogOfSteps) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), afm()));
  const int port = port_of(server);
  ASSERT_GT(port, 0);
  const std::string at = "127.0.0.1:" + std::to_string(port);
  const std::string file = path("afm.h5");
  const Finished run = run_program({kMaster, "run", "--server", at, "--task", "position", "--duration-s", "2",
                                    "--method", "twin", "--record", file},
                                   {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("no twin, method model instead: this server keeps no log of steps (a real AFM"),
            std::string::npos)
      << run.err;
  const recording::RecordingReader reader(file);
  const std::uint64_t agreed = std::strtoull(reader.configuration("features").c_str(), nullptr, 16);
  EXPECT_NE(agreed, 0u);
  EXPECT_EQ(agreed & (link::kFeatureStepLog | link::kFeatureSharedLog), 0u);
  EXPECT_FALSE(reader.datagrams().empty());
  for (const recording::DatagramRow& row : reader.datagrams()) {
    ASSERT_EQ(row.executed, 0u);
    ASSERT_EQ(row.newest, 0u);
    ASSERT_EQ(row.state_hash, 0u);
  }
  for (const double method : reader.read("method"))
    ASSERT_NE(method, static_cast<double>(control::Method::kTwin));
  EXPECT_TRUE(reader.state_pieces().empty());

  // Steps in the commands of a session without a log, straight down.
  const rt::SteadyClock clock;
  const net::Address address = net::parse_address(at, "test");
  net::Udp socket = net::Udp::listen(net::parse_address("127.0.0.1:0", "test"));
  link::ClientConfig config;
  config.step_ring = 1000;
  link::ClientSession client(config);
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer{};
  std::uint64_t replies = 0;
  const auto receive = [&] {
    net::Received received;
    while (socket.receive(buffer, received)) {
      replies +=
          client.on_datagram({buffer.data(), received.size}, clock.now_ns()) == link::ClientEvent::kReply;
    }
  };
  client.start(clock.now_ns());
  for (int i = 0; i < 30'000 && client.state() != link::ClientState::kEstablished; ++i) {
    if (const std::size_t n = client.poll(clock.now_ns(), buffer)) socket.send({buffer.data(), n}, address);
    socket.wait_readable(1'000'000);
    receive();
  }
  ASSERT_EQ(client.state(), link::ClientState::kEstablished);
  EXPECT_FALSE(client.logs_steps()) << "asked for, and not granted";
  link::Codec codec;
  const auto send = [&](bool with_steps, std::uint64_t sequence) {
    link::Command command;
    command.session_id = client.welcome().session_id;
    command.epoch = client.welcome().epoch;
    command.sequence = sequence;
    command.send_time_ns = static_cast<std::uint64_t>(clock.now_ns());
    command.flags = link::kFlagClutch | link::kFlagDeadman;
    command.tip_pos_w_nm = client.welcome().start_pos_w_nm;
    std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
    link::StepWriter writer(bytes, 50 * sequence);
    const Vec3 down = command.tip_pos_w_nm - Vec3(0, 0, 500);
    while (with_steps && writer.count() < 50 && writer.add(link::logged_step(down, command.flags, 1e-3))) {
    }
    const std::size_t n =
        codec.encode(command, std::span(bytes).first(with_steps ? writer.size() : 0), buffer);
    ASSERT_GT(n, 0u);
    socket.send({buffer.data(), n}, address);
  };
  constexpr std::uint64_t kSent = 200;
  for (std::uint64_t i = 1; i <= kSent; ++i) {
    send(true, i);
    socket.wait_readable(2'000'000);
    receive();
  }
  EXPECT_EQ(replies, 0u) << "none of them was taken for a command";
  server.signal(SIGTERM);
  ASSERT_TRUE(server.wait(kLong));
  const std::string dropped = std::string(link::name(link::DropCause::kUnexpected)) + " ";
  const auto told = server.err().find(dropped, server.err().find("dropped: "));
  ASSERT_NE(told, std::string::npos) << server.err();
  EXPECT_GE(std::atoi(server.err().c_str() + told + dropped.size()), static_cast<int>(kSent) / 2)
      << server.err();
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("SafeTip 0 times"), std::string::npos) << end;
}

TEST_F(AfmProgramsTest, AServerThatIsKilledLeavesTheTipWithdrawn) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), afm()));
  ASSERT_GT(port_of(server), 0);
  const pid_t guard = guard_of(server);
  ASSERT_GT(guard, 0);
  server.signal(SIGKILL);
  ASSERT_TRUE(server.wait(kLong));
  EXPECT_TRUE(ends(guard));
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
}

// A server that hangs keeps its end of the guard's stream open: only the missing heart beat tells. The
// guard's patience is four reply times: here 8 s, since less would be too little for the checks under a
// sanitizer, or for a machine that keeps the simulator waiting.
TEST_F(AfmProgramsTest, AServerThatHangsWhileAStationPressesLeavesTheTipWithdrawn) {
  struct Pressed {
    Simulator simulator;
    ChildProcess server, run;
    explicit Pressed(const std::string& afm)
        : server(serve(simulator.ports(), afm)),
          run({kMaster, "run", "--server", "127.0.0.1:" + std::to_string(port_of(server)), "--task", "indent",
               "--duration-s", "60"}) {}
  };
  const std::string afm = changed("reply_timeout_ms", "2000.0");
  Pressed soon(afm), late(afm);
  for (Pressed* one : {&soon, &late}) ASSERT_TRUE(one->run.wait_for_err("engaged", kLong)) << one->run.err();
  ::usleep(500'000);
  for (Pressed* one : {&soon, &late}) one->server.signal(SIGSTOP);
  const std::string before = soon.simulator.stop();
  EXPECT_NE(before.find("tip out"), std::string::npos) << before;

  ::usleep(9'500'000);
  const std::string after = late.simulator.stop();
  EXPECT_NE(after.find("tip withdrawn"), std::string::npos) << after;
  // Without a controller these guards would go on for ever.
  for (Pressed* one : {&soon, &late}) {
    const pid_t guard = guard_of(one->server);
    ASSERT_GT(guard, 0);
    ::kill(guard, SIGKILL);
  }
}

/// How long the machine kept this thread from running beyond what it had asked for, at most.
class Pauses {
 public:
  Pauses() : thread_([this] { watch(); }) {}
  ~Pauses() {
    stop_ = true;
    thread_.join();
  }
  /// Since the last call.
  double longest_ms() { return 1e-3 * static_cast<double>(longest_us_.exchange(0)); }

 private:
  void watch() {
    using Clock = std::chrono::steady_clock;
    for (auto last = Clock::now(); !stop_;) {
      ::usleep(1000);
      const auto now = Clock::now();
      const long us = std::chrono::duration_cast<std::chrono::microseconds>(now - last).count();
      long most = longest_us_;
      while (us > most && !longest_us_.compare_exchange_weak(most, us)) {
      }
      last = now;
    }
  }
  std::atomic<bool> stop_{false};
  std::atomic<long> longest_us_{0};
  std::thread thread_;
};

// What each session on one server presses with, beside the first one, as the station tells: the rig's own peak has the touches of the
// approach in it (62.6 nN in the first one). The hand is the
// same, in real time. Where the machine stood still in one of two sessions, the hand's way was uneven, and 5 %
// are not to be had; a session that takes up the tip where its hand has gone to presses twice as hard.
// TELENANO_AFM_SESSIONS: how many.
TEST_F(AfmProgramsTest, ALaterSessionOnARunningServerPressesNoHarder) {
  const char* const given = std::getenv("TELENANO_AFM_SESSIONS");
  const int sessions = given != nullptr ? std::atoi(given) : 2;
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), afm()));
  const std::string address = "127.0.0.1:" + std::to_string(port_of(server));
  Pauses pauses;
  std::vector<double> peaks_nn, paused_ms;
  for (int i = 0; i < sessions; ++i) {
    pauses.longest_ms();
    const Finished run =
        run_program({kMaster, "run", "--server", address, "--task", "indent", "--duration-s", "4"});
    EXPECT_EQ(run.exit_code, 0) << run.err;
    paused_ms.push_back(pauses.longest_ms());
    ASSERT_TRUE(simulator.withdrawn(i + 1));
    EXPECT_LT(simulator.peaks_nn().back(), 80) << "the true force of its approach and its session";
    const std::string said = run.out + run.err;
    const auto at = said.find("largest push");
    ASSERT_NE(at, std::string::npos) << said;
    peaks_nn.push_back(std::stod(said.substr(at + std::strlen("largest push"))));
  }
  const pid_t guard = guard_of(server);
  server.signal(SIGTERM);
  EXPECT_TRUE(server.wait(kLong));
  EXPECT_TRUE(guard > 0 && ends(guard));
  ASSERT_EQ(peaks_nn.size(), static_cast<std::size_t>(sessions));
  EXPECT_GT(peaks_nn[0], 40);
  for (std::size_t i = 1; i < peaks_nn.size(); ++i) {
    constexpr double kStoodStillMs = 10;
    const bool quiet = std::max(paused_ms[0], paused_ms[i]) < kStoodStillMs;
    EXPECT_LE(peaks_nn[i], (quiet ? 1.05 : 1.6) * peaks_nn[0]) << "session " << i + 1;
    std::printf("session %zu: %.1f nN, the first %.1f nN; the machine stood still for %.1f and %.1f ms\n",
                i + 1, peaks_nn[i], peaks_nn[0], paused_ms[i], paused_ms[0]);
  }
}

TEST_F(AfmProgramsTest, AStationWhoseTipStaysWithdrawnSaysSoAndFails) {
  const std::string control = path("faults.txt");
  Simulator simulator({"--control", control});
  ChildProcess server(serve(simulator.ports(), afm()));
  const std::string address = "127.0.0.1:" + std::to_string(port_of(server));
  const auto run = [&](const char* seconds) {
    return run_program({kMaster, "run", "--quiet", "--server", address, "--task", "position", "--duration-s",
                        seconds, "--give-up-s", "2"});
  };
  EXPECT_EQ(run("1").exit_code, 0);
  // Each answer later than the server's patience of 3 s: the next approach cannot begin.
  write("faults.txt", "slow 120s 4000ms\n");
  ASSERT_TRUE(simulator.says("slow 120s"));
  const Finished again = run("3");
  EXPECT_EQ(again.exit_code, 1) << again.err;
  EXPECT_NE(again.err.find("kept the tip withdrawn"), std::string::npos) << again.err;
  const pid_t guard = guard_of(server);
  server.signal(SIGKILL);
  EXPECT_TRUE(server.wait(kLong));
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
  ::kill(guard, SIGKILL);  // the controller is gone
}

// The guard has no limit of time: it stays until the controller has answered, and the next server waits for
// it. That server has the first one's port, as after a restart by systemd: the guard must not hold it.
TEST_F(AfmProgramsTest, AControllerThatIsSilentWhileTheServerDiesEndsWithdrawn) {
  const std::string control = path("faults.txt");
  Simulator simulator({"--control", control});
  const std::string file = afm();
  ChildProcess server(serve(simulator.ports(), file));
  const int port = port_of(server);
  ASSERT_GT(port, 0);
  const pid_t guard = guard_of(server);
  ASSERT_GT(guard, 0);
  write("faults.txt", "silent 3600s\n");
  ASSERT_TRUE(simulator.says("silent 3600s"));
  server.signal(SIGKILL);
  ASSERT_TRUE(server.wait(kLong));
  ChildProcess next(serve(simulator.ports(), file, port));
  EXPECT_TRUE(next.wait_for_err("waiting for the guard of the last run", kLong)) << next.err();
  ::usleep(300'000);
  EXPECT_TRUE(alive(guard)) << "the controller is still silent";
  write("faults.txt", "silent 0s\n");
  ASSERT_GT(port_of(next), 0) << next.err();
  EXPECT_FALSE(alive(guard));
  EXPECT_NE(next.err().find("did not end with the tip withdrawn"), std::string::npos) << next.err();
  const pid_t last = guard_of(next);
  next.signal(SIGTERM);
  EXPECT_TRUE(next.wait(kLong));
  EXPECT_TRUE(last > 0 && ends(last));
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
}

// What the rig has felt is all that a server without a station may do: it is not to approach by itself,
// however often it is started.
TEST_F(AfmProgramsTest, AServerThatWasKilledApproachesAgainOnlyOnAnOperatorsWord) {
  Simulator simulator;
  const std::string file = afm(), folder = file.substr(0, file.rfind('/'));
  const auto killed = [&](ChildProcess& server) {
    ASSERT_GT(port_of(server), 0) << server.err();
    const pid_t guard = guard_of(server);
    server.signal(SIGKILL);
    EXPECT_TRUE(server.wait(kLong));
    EXPECT_TRUE(guard > 0 && ends(guard));
  };
  const std::vector<std::string> approve{kNve, "afm", "approve", "--afm-state", folder};
  const Finished early = run_program(approve);
  EXPECT_EQ(early.exit_code, 2);
  EXPECT_NE(early.err.find("nothing to approve"), std::string::npos) << early.err;

  ChildProcess first(serve(simulator.ports(), file));
  killed(first);
  EXPECT_NE(first.err().find("approaching"), std::string::npos);
  for (int i = 0; i < 2; ++i) {
    ChildProcess next(serve(simulator.ports(), file));
    killed(next);
    EXPECT_NE(next.err().find("did not end with the tip withdrawn"), std::string::npos) << next.err();
    EXPECT_EQ(next.err().find("approaching"), std::string::npos) << next.err();
  }
  // Used once, by a server that waits.
  ChildProcess waits(serve(simulator.ports(), file));
  ASSERT_GT(port_of(waits), 0);
  const Finished approved = run_program(approve);
  EXPECT_EQ(approved.exit_code, 0) << approved.err;
  EXPECT_TRUE(waits.wait_for_err("surface found", kLong)) << waits.err();
  killed(waits);
  ChildProcess again(serve(simulator.ports(), file));
  ASSERT_GT(port_of(again), 0);
  EXPECT_EQ(again.err().find("approaching"), std::string::npos) << again.err();
  // Or by one that comes later; it ends as it should, and the next one needs no word.
  EXPECT_EQ(run_program(approve).exit_code, 0);
  EXPECT_TRUE(again.wait_for_err("surface found", kLong)) << again.err();
  const pid_t guard = guard_of(again);
  again.signal(SIGTERM);
  EXPECT_TRUE(again.wait(kLong));
  EXPECT_TRUE(guard > 0 && ends(guard));
  ChildProcess last(serve(simulator.ports(), file));
  EXPECT_TRUE(last.wait_for_err("surface found", kLong)) << last.err();
  const pid_t last_guard = guard_of(last);
  last.signal(SIGTERM);
  EXPECT_TRUE(last.wait(kLong));
  EXPECT_TRUE(last_guard > 0 && ends(last_guard));
  EXPECT_NE(simulator.stop().find("tip withdrawn"), std::string::npos);
}

// A command that a killed server has sent may be read after its guard has gone.
TEST_F(AfmProgramsTest, ACommandThatComesAfterTheGuardHasGoneMovesNothing) {
  for (const char* const sign : {"1", "-1"}) {
    Simulator simulator({"--z-sign", sign});
    ChildProcess server(serve(simulator.ports(), changed("z_sign", sign)));
    ASSERT_GT(port_of(server), 0) << server.err();
    const pid_t guard = guard_of(server);
    server.signal(SIGKILL);
    ASSERT_TRUE(server.wait(kLong));
    ASSERT_TRUE(guard > 0 && ends(guard));
    // ZCtrl.ZPosSet of 0, the middle of the range, as the protocol's document has it; then its error's reply.
    std::string frame = "ZCtrl.ZPosSet";
    frame.resize(32, '\0');
    for (const int byte : {0, 0, 0, 4, 0, 1, 0, 0, 0, 0, 0, 0}) frame += static_cast<char>(byte);
    net::TcpStream late = net::TcpStream::connect(
        net::parse_address("127.0.0.1:" + simulator.ports({0}), "test"), 2'000'000'000);
    std::size_t n = 0;
    ASSERT_EQ(late.write({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()}, n),
              net::TcpStream::Status::kOk);
    std::array<std::uint8_t, 256> reply{};
    for (int i = 0; i < 1000 && late.read(reply, n) == net::TcpStream::Status::kWouldBlock; ++i)
      ::usleep(10'000);
    const std::string end = simulator.stop();
    EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
    // A clean state for the other sign.
    for (const auto& entry : std::filesystem::directory_iterator(path("")))
      if (entry.path().extension() == ".out") std::filesystem::remove(entry.path());
  }
}

// The answers of the controller are in the server's sockets when it goes on. It stands still for twice the
// time-out of a reply, half of what the guard waits for.
TEST_F(AfmProgramsTest, AServerThatStoodStillItselfDoesNotFindTheControllerSilent) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), changed("reply_timeout_ms", "2000.0")));
  ASSERT_GT(port_of(server), 0);
  server.signal(SIGSTOP);
  ::usleep(4'000'000);
  server.signal(SIGCONT);
  server.signal(SIGTERM);
  ASSERT_TRUE(server.wait(kLong));
  EXPECT_EQ(server.exit_code(), 0);
  EXPECT_EQ(server.err().find("does not answer"), std::string::npos) << server.err();
  EXPECT_NE(server.err().find("withdrawn: exit"), std::string::npos) << server.err();
}

TEST_F(AfmProgramsTest, WhatDoesNotFitIsRefusedInOneLineAndNothingMoves) {
  struct Case {
    std::vector<std::string> sim;
    std::string key, value, expected;
    std::vector<int> order{0, 1, 2, 3};
  };
  const std::vector<Case> cases = {
      {{}, "sensitivity_nm_v", "-50.0", "sensitivity_nm_v"},
      {{"--z-sign", "-1"}, "step_nm", "1.0", "z_sign"},
      {{}, "deflection", "40", "there is no signal 40"},
      {{}, "half_width_nm", "6000.0", "beyond the piezo's range"},
      {{"--range-z-nm", "80"}, "step_nm", "1.0", "beyond the piezo's range"},
      {{"--restrict-roles"}, "step_nm", "1.0", "port for that role", {1, 0, 2, 3}},
      {{"--restrict-roles"}, "step_nm", "1.0", "port for that role", {0, 1, 3, 2}},
      {{}, "z_sign", "0", "z_sign"},
      {{}, "step_nm", "6.0", "step_nm"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.key + " = " + c.value + " " + c.expected);
    Simulator simulator(c.sim);
    const Finished done = run_program(serve(simulator.ports(c.order), changed(c.key, c.value)));
    EXPECT_EQ(done.exit_code, 2);
    EXPECT_NE(done.err.find(c.expected), std::string::npos) << done.err;
    EXPECT_EQ(lines_of(done.err).size(), 1u) << done.err;
    ::usleep(200'000);
    const std::string end = simulator.stop();
    EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
    EXPECT_NE(end.find("; 0 calls that move"), std::string::npos) << end;
  }
}

TEST_F(AfmProgramsTest, AControllerInUseAndNoneAtAllAreRefused) {
  Simulator simulator;
  {
    ChildProcess first(serve(simulator.ports(), afm()));
    ASSERT_GT(port_of(first), 0);
    const Finished second = run_program(serve(simulator.ports(), afm()));
    EXPECT_EQ(second.exit_code, 2);
    EXPECT_NE(second.err.find("in use by another client"), std::string::npos) << second.err;
    EXPECT_EQ(lines_of(second.err).size(), 1u) << second.err;
    EXPECT_TRUE(first.running()) << "and the first one goes on";
    const pid_t guard = guard_of(first);
    first.signal(SIGTERM);
    EXPECT_TRUE(first.wait(kLong));
    EXPECT_TRUE(guard > 0 && ends(guard));
  }
  simulator.stop();
  const Finished none = run_program(serve(simulator.ports(), afm()));
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_NE(none.err.find("cannot connect"), std::string::npos) << none.err;
  const Finished twice = run_program(serve("6501,6501,6502,6503", afm()));
  EXPECT_EQ(twice.exit_code, 2);
  EXPECT_NE(twice.err.find("two roles"), std::string::npos) << twice.err;
}

TEST_F(AfmProgramsTest, FlagsThatDoNotGoTogether) {
  for (const auto& [flags, expected] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{}, "--scene is missing"},
           {{"--slave", "nanonis"}, "--controller is missing"},
           {{"--slave", "nanonis", "--controller", "127.0.0.1"}, "--afm is missing"},
           {{"--slave", "nanonis", "--scene", "x.toml"}, "--scene belongs to"},
           {{"--slave", "nanonis", "--controller", "127.0.0.1", "--afm", afm_file()},
            "without a deadman beside the controller the tip stays on the sample"},
           {{"--scene", "x.toml", "--afm", "y.toml"}, "belong to --slave nanonis"},
           {{"--scene", "x.toml", "--without-deadman"}, "belong to --slave nanonis"}}) {
    std::vector<std::string> command{kNve, "serve", "--listen", "127.0.0.1:0"};
    command.insert(command.end(), flags.begin(), flags.end());
    const Finished done = run_program(command);
    EXPECT_EQ(done.exit_code, 2);
    EXPECT_NE(done.err.find(expected), std::string::npos) << done.err;
  }
}

}  // namespace
}  // namespace telenano::programs
