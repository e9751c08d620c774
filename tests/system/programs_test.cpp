// The two programs as two processes over loopback UDP: sessions, and what happens when one of them is hurt.
#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/system/programs.h"
#include "tests/system/recorded.h"

namespace telenano::programs {
namespace {

using recording::RecordingReader;

constexpr double kHeld = 3;  // station::Mode
constexpr double kStopped = 4;

// A low slew limit, so that a force step would stand out: 0.05 N a tick, where a jump of the tip into contact
// alone asks for 0.7 N and more (41 nN times 2e7, less what the cantilever takes).
constexpr double kSlew_n_s = 50;
constexpr double kPeriod_s = 1e-3;
const char* const kStationFile = "[limits]\nslew_n_s = 50.0\n";

/// The columns that the tests look at, as the recording has them.
struct Rows {
  explicit Rows(const RecordingReader& reader)
      : time_s(reader.read("time_s")),
        contact(reader.read("contact_state")),
        mode(reader.read("station_mode")),
        age_ms(reader.read("reply_age_ms")),
        rtt_us(reader.read("rtt_us")),
        dropped(reader.read("dropped")),
        lost(reader.read("lost")),
        damper(reader.read("damper_n_s_m")),
        tip_z_nm(reader.read("tip_pos_w_nm", 2)),
        energy_j(reader.read("energy_j")) {
    for (std::size_t c = 0; c < 3; ++c) {
      force[c] = reader.read("hand_force_applied_h_n", c);
      scaled[c] = reader.read("hand_force_scaled_h_n", c);
    }
  }
  std::size_t size() const { return time_s.size(); }
  double force_n(std::size_t i) const { return std::hypot(force[0][i], force[1][i], force[2][i]); }
  double scaled_n(std::size_t i) const { return std::hypot(scaled[0][i], scaled[1][i], scaled[2][i]); }
  double largest_force_n() const {
    double largest = 0;
    for (std::size_t i = 0; i < size(); ++i) largest = std::max(largest, force_n(i));
    return largest;
  }
  double lowest_tip_nm() const {
    double lowest = 1e300;
    for (const double z : tip_z_nm) lowest = z == 0 ? lowest : std::min(lowest, z);  // 0: no reply yet
    return lowest;
  }

  std::vector<double> time_s, contact, mode, age_ms, rtt_us, dropped, lost, damper, tip_z_nm, energy_j;
  std::vector<double> force[3], scaled[3];
};

/// Rises and reversals of the applied force keep the slew limit; falls are free. A tick that the machine
/// delivered late stands for several, and one more is allowed, as the wake-up of the tick before may have
/// been late too.
void expect_no_force_step(const Rows& rows) {
  double worst_n = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double ticks = std::round((rows.time_s[i] - rows.time_s[i - 1]) / kPeriod_s) + 1;
    const double allowed_n = kSlew_n_s * kPeriod_s * ticks * (1 + 1e-9);
    double along = 0;
    for (const auto& f : rows.force) along += f[i] * f[i - 1];
    const double rise_n = along < 0 ? rows.force_n(i) : rows.force_n(i) - rows.force_n(i - 1);
    ASSERT_LE(rise_n, allowed_n) << "row " << i << " at " << rows.time_s[i] << " s";
    worst_n = std::max(worst_n, rise_n);
  }
  EXPECT_GT(worst_n, 0) << "no force at all: nothing was tested";
}

std::size_t lines_with(const std::string& text, const std::string& part) {
  const auto lines = lines_of(text);
  return static_cast<std::size_t>(std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
    return line.find(part) != std::string::npos;
  }));
}

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// A whole session that nothing has disturbed.
void expect_good_session(const Finished& run, const std::string& file, bool touches) {
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out, "");
  for (const char* word :
       {"summary", "at the hand", "energy", "controller", "round trip", "replies", "overruns"}) {
    EXPECT_NE(run.err.find(word), std::string::npos) << word << " is missing in:\n" << run.err;
  }
  const RecordingReader reader(file);
  EXPECT_TRUE(reader.closed());
  EXPECT_FALSE(reader.cut_short());
  EXPECT_EQ(reader.rows_dropped(), 0u);
  const Rows rows(reader);
  ASSERT_GT(rows.size(), 500u);  // 2 s at 1000 Hz, on a machine that may be busy
  const bool touched = std::count(rows.contact.begin(), rows.contact.end(), kContact) > 0;
  EXPECT_EQ(touched, touches);
  EXPECT_EQ(run.err.find("pull-off force") != std::string::npos, touches) << run.err;
  // Who is kept waiting asks again, and what is answered twice is dropped once.
  if (!has_event(reader, "server silent")) {
    EXPECT_EQ(rows.dropped.back(), 0);
  }
  EXPECT_LE(rows.lost.back(),
            0.01 * static_cast<double>(rows.size()));  // the loopback loses only what a stall overruns
  // Sane for a loopback on a shared machine: more than nothing, less than a few ticks.
  std::vector<double> rtt_us = rows.rtt_us;
  std::erase(rtt_us, 0.0);
  EXPECT_GT(median(rtt_us), 1);
  EXPECT_LT(median(rtt_us), 5000);
  // The ramp's first tick, of what attracts a tip that is far from the surface.
  EXPECT_LT(std::fabs(rows.force_n(0)), 1e-5);
}

TEST_F(ProgramsTest, ASessionOfEachKindEndsWellAndIsRecorded) {
  Server server(scene_path("flakes"));
  for (const bool touches : {false, true}) {
    const std::string task = touches ? "indent" : "position";
    SCOPED_TRACE(task);
    const std::string file = path(task + ".h5");
    const Finished run = run_program(station(server, {"--device", "sim", "--task", task, "--duration-s", "2",
                                                      "--rate", "1000", "--record", file}),
                                     {}, kLong);
    expect_good_session(run, file, touches);
    const RecordingReader reader(file);
    EXPECT_EQ(reader.configuration("task"), task);
    EXPECT_EQ(reader.configuration("scene_name"), "flakes");
    // Where nobody says which: the sample itself. Where this machine is so busy that the scene is not looked
    // at in time, by the round trip.
    const std::string method = reader.configuration("control.method");
    EXPECT_TRUE(method == "twin" || method == "tank" || method == "model") << method;
    EXPECT_NE(reader.configuration("command_line").find("--duration-s 2"), std::string::npos);
  }
  const std::string said = server.stop();
  EXPECT_NE(said.find("in 2 sessions"), std::string::npos) << said;
  EXPECT_NE(said.find("dropped: duplicate 4\n"), std::string::npos)
      << said;  // Bye is said three times a session
}

/// A station that is kept up while it gets ready, here by a terminal that takes no more text, stays in its
/// session: the server would withdraw the tip after 0.5 s, and the task would press on nothing.
TEST_F(ProgramsTest, WhatKeepsAStationFromBeginningKeepsItsTipWhereItWas) {
  for (const std::string method : {"auto", "model"}) {
    SCOPED_TRACE(method);
    Server server(scene_path("flat_silicon_oxide"));
    const std::string file = path(method + ".h5");
    // Nobody reads the pipe until the test looks at it: it is full, and the station's first line waits.
    const std::string script = "head -c 65536 /dev/zero >&2; exec " + kMaster + " run --server " +
                               server.address() + " --task contact --duration-s 2 --method " + method +
                               " --record " + file;
    ChildProcess run({"/bin/sh", "-c", script});
    ASSERT_TRUE(server.child().wait_for_err("opened 1  ", kLong)) << "told every 5 s";
    // Three times its time-out, and no more than a slow start of the station takes anyway.
    std::this_thread::sleep_for(Milliseconds(1500));
    ASSERT_FALSE(std::filesystem::exists(file) && RecordingReader(file).rows() > 0) << "nothing kept it up";
    ASSERT_TRUE(run.wait(kLong));
    EXPECT_EQ(run.exit_code(), 0) << run.err();
    server.stop();
    const RecordingReader reader(file);
    EXPECT_FALSE(has_event(reader, "session resumed"));
    const std::vector<double> contact = reader.read("contact_state");
    EXPECT_GT(std::count(contact.begin(), contact.end(), kContact), 0) << "never touched";
  }
}

TEST_F(ProgramsTest, TwoStationsAtOnceHaveAStateEach) {
  Server server(scene_path("flakes"));
  ChildProcess above(
      station(server, {"--task", "position", "--duration-s", "6", "--record", path("above.h5")}));
  ChildProcess below(
      station(server, {"--task", "indent", "--duration-s", "6", "--record", path("below.h5")}));
  ASSERT_TRUE(above.wait(kLong) && below.wait(kLong));
  expect_good_session({above.exit_code(), above.ended_by(), above.out(), above.err()}, path("above.h5"),
                      false);
  expect_good_session({below.exit_code(), below.ended_by(), below.out(), below.err()}, path("below.h5"),
                      true);
  const Rows high{RecordingReader(path("above.h5"))};
  const Rows low{RecordingReader(path("below.h5"))};
  // The two were in session together, and while one tip was in the sample the other was nanometres above it.
  EXPECT_GT(high.lowest_tip_nm() - low.lowest_tip_nm(), 5);
  EXPECT_GT(low.largest_force_n(), 0.5);   // 41 nN of adhesion alone are 0.8 N
  EXPECT_LT(high.largest_force_n(), 0.1);  // van der Waals at 10 nm: some 0.1 nN
  EXPECT_NE(server.stop().find("in 2 sessions"), std::string::npos);
}

TEST_F(ProgramsTest, AServerKilledInContactAndStartedAgainIsResumedWithoutAForceStep) {
  auto first = std::make_unique<Server>(scene_path("flakes"));
  const int port = first->port();
  const std::string file = path("resumed.h5");
  // Down, stay (here the server goes and comes back), down again: a resumed session begins above the surface,
  // as the new server has it, so that the second way down meets it once more. The stay is as long as a busy
  // machine needs for all that: who comes back on the way down, or after it, would meet nothing.
  const std::string script =
      write("twice.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,20\n1,0,0,-3\n12,0,0,-3\n13.5,0,0,-33\n30,0,0,-33\n");
  // A twin goes on for longer than the 100 ms that a force of the server's is shown.
  std::vector<std::string> command =
      station(*first, {"--task", "script", "--script", script, "--method", "model", "--record", file,
                       "--config", write("station.toml", kStationFile)});
  std::erase(command, "--quiet");
  ChildProcess run(command);
  ASSERT_TRUE(wait_for_contact(run, file, 300));
  first->child().signal(SIGKILL);
  ASSERT_TRUE(first->child().wait(kLong));
  EXPECT_EQ(first->child().ended_by(), SIGKILL);
  ASSERT_TRUE(wait_for_event(run, file, "server silent"));
  Server second(scene_path("flakes"), port);
  ASSERT_TRUE(wait_for_event(run, file, "session resumed in a new epoch"));
  ASSERT_TRUE(wait_for_contact(run, file, 150)) << "the resumed session was not felt";
  run.signal(SIGINT);
  ASSERT_TRUE(run.wait(kLong)) << run.err();
  EXPECT_EQ(run.exit_code(), 0) << run.err();
  EXPECT_NE(run.err().find("the server has lost the session, as after a restart: this is a new one"),
            std::string::npos)
      << run.err();
  EXPECT_NE(second.stop().find("in 1 sessions"), std::string::npos);

  const RecordingReader reader(file);
  const Rows rows(reader);
  expect_no_force_step(rows);
  EXPECT_GT(rows.largest_force_n(), 0.5);
  // Held from the kill until it was engaged again; a busy machine may have held it before, too.
  const auto events = reader.events();
  const auto resumed = std::find_if(events.begin(), events.end(), [](const recording::Event& event) {
    return std::string("session resumed in a new epoch") == event.text.data();
  });
  ASSERT_NE(resumed, events.end());
  std::size_t end = 0;
  while (end < rows.size() && (rows.time_s[end] < resumed->time_s || rows.mode[end] != kEngaged)) ++end;
  ASSERT_LT(end, rows.size()) << "never resumed";
  while (end > 0 && rows.mode[end - 1] == kEngaged) --end;
  std::size_t begin = end;
  while (begin > 0 && rows.mode[begin - 1] != kEngaged) --begin;
  ASSERT_GT(begin, 0u);
  EXPECT_EQ(rows.mode[begin], kHeld);
  EXPECT_EQ(rows.contact[begin - 1], kContact) << "the server was not killed in contact";
  for (std::size_t i = 0; i < end; ++i) {
    if (rows.age_ms[i] > 101) {
      ASSERT_EQ(rows.force_n(i), 0) << "a stale force at row " << i;
    }  // 100 ms and a tick
  }
  EXPECT_GT(std::count(rows.contact.begin() + static_cast<std::ptrdiff_t>(end), rows.contact.end(), kContact),
            100)
      << "the resumed session was not felt";
  // Bumpless: the force is ramped in over 0.2 s, from zero, the tick of the first force included. Two periods
  // for when the ticks really came.
  for (std::size_t i = end; i < rows.size() && rows.time_s[i] < rows.time_s[end] + 0.1; ++i) {
    if (rows.damper[i] > 0) break;
    const double ramp = std::min(1.0, (rows.time_s[i] - rows.time_s[end - 1] + 2 * kPeriod_s) / 0.2);
    ASSERT_LE(rows.force_n(i), ramp * rows.scaled_n(i) * (1 + 1e-9) + 1e-12) << "row " << i;
  }
  std::printf("held for %.2f s\n", rows.time_s[end] - rows.time_s[begin]);
}

TEST_F(ProgramsTest, AServerGoneForGoodIsGivenUp) {
  Server server(scene_path("flat_silicon_oxide"));
  const std::string file = path("gone.h5");
  ChildProcess run(
      station(server, {"--task", "indent", "--duration-s", "30", "--give-up-s", "1", "--record", file}));
  ASSERT_TRUE(run.running());
  std::this_thread::sleep_for(Milliseconds(1500));
  server.child().signal(SIGKILL);
  const auto killed = std::chrono::steady_clock::now();
  ASSERT_TRUE(run.wait(kLong));
  const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - killed).count();
  EXPECT_EQ(run.exit_code(), 1);
  EXPECT_EQ(lines_with(run.err(), "telenano-master: "), 1u) << run.err();
  EXPECT_NE(
      run.err().find("the server at " + server.address() + " has been silent for 1 s; the force is zero"),
      std::string::npos)
      << run.err();
  EXPECT_GT(took_s, 0.9);
  EXPECT_LT(took_s, 10);
  const RecordingReader reader(file);
  EXPECT_TRUE(reader.closed());
  EXPECT_EQ(Rows(reader).force_n(reader.rows() - 1), 0);
}

bool opens_plainly(const std::string& file) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (id >= 0) H5Fclose(id);
  return id >= 0;
}

TEST_F(ProgramsTest, AStationKilledInContactHarmsNeitherServerNorRecording) {
  Server server(scene_path("flakes"));
  const std::string file = path("killed.h5");
  {
    ChildProcess run(station(server, {"--task", "indent", "--duration-s", "10", "--record", file}));
    ASSERT_TRUE(wait_for_contact(run, file));
    run.signal(SIGKILL);
    ASSERT_TRUE(run.wait(kLong));
  }
  std::size_t rows = 0;
  {
    const RecordingReader reader(file);
    EXPECT_FALSE(reader.closed());
    EXPECT_TRUE(reader.cut_short());
    rows = reader.rows();
    EXPECT_GT(rows, 300u);
    EXPECT_EQ(Rows(reader).contact.back(), kContact);
  }
  EXPECT_FALSE(opens_plainly(file));
  const Finished recovered = run_program({kMaster, "recover", file});
  EXPECT_EQ(recovered.exit_code, 0) << recovered.err;
  const auto table = lines_of(recovered.out);
  ASSERT_EQ(table.size(), 2u);
  EXPECT_EQ(table[0], "file,rows,events,rows_cut,state");
  EXPECT_EQ(table[1].rfind(file + "," + std::to_string(rows) + ",", 0), 0u) << table[1];
  EXPECT_NE(table[1].find(",recovered"), std::string::npos) << table[1];
  EXPECT_TRUE(opens_plainly(file));
  EXPECT_EQ(RecordingReader(file).rows(), rows);

  const Finished next = run_program(
      station(server, {"--task", "indent", "--duration-s", "2", "--record", path("next.h5")}), {}, kLong);
  expect_good_session(next, path("next.h5"), true);
  EXPECT_NE(server.stop().find("in 2 sessions"), std::string::npos);
}

TEST_F(ProgramsTest, InterruptingTheStationLeavesTheHandFreeAndTheSessionEnded) {
  // One place, and a minute until a silent session would be forgotten: the second station gets in because of
  // Bye.
  Server server(scene_path("flakes"), 0, {"--max-sessions", "1", "--timeout-ms", "60000"});
  const std::string file = path("stopped.h5");
  ChildProcess run(station(server, {"--task", "indent", "--duration-s", "12", "--record", file}));
  ASSERT_TRUE(wait_for_contact(run, file));
  run.signal(SIGINT);
  ASSERT_TRUE(run.wait(kLong));
  EXPECT_EQ(run.exit_code(), 0) << run.err();
  EXPECT_EQ(lines_with(run.err(), "stopped by the operator"), 1u) << run.err();
  const RecordingReader reader(file);
  EXPECT_TRUE(reader.closed());
  EXPECT_FALSE(reader.cut_short());
  const Rows rows(reader);
  EXPECT_EQ(rows.mode.back(), kStopped);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows.mode[i] == kStopped) {
      ASSERT_EQ(rows.force_n(i), 0) << i;
    }
  }
  const Finished next = run_program(station(server, {"--task", "position", "--duration-s", "1"}), {}, kLong);
  EXPECT_EQ(next.exit_code, 0) << next.err;
}

TEST_F(ProgramsTest, AServerThatIsToldToEndTellsTheStation) {
  Server server(scene_path("flakes"));
  const std::string file = path("told.h5");
  ChildProcess run(station(server, {"--task", "indent", "--duration-s", "12", "--give-up-s", "1", "--record",
                                    file, "--config", write("station.toml", kStationFile)}));
  ASSERT_TRUE(wait_for_contact(run, file));
  server.stop();
  ASSERT_TRUE(run.wait(kLong));
  EXPECT_EQ(run.exit_code(), 1);
  EXPECT_EQ(lines_with(run.err(), "telenano-master: "), 1u) << run.err();
  const Rows rows{RecordingReader(file)};
  expect_no_force_step(rows);
  const auto held = std::find(rows.mode.begin(), rows.mode.end(), kHeld);
  ASSERT_NE(held, rows.mode.end());
  // Told, not found out: silence alone would hold the station after 100 ms.
  EXPECT_LT(rows.age_ms[static_cast<std::size_t>(held - rows.mode.begin())], 80);
}

TEST_F(ProgramsTest, RandomDatagramsDoNoHarmToASession) {
  Server server(scene_path("flakes"));
  const std::string file = path("bombarded.h5");
  ChildProcess run(station(server, {"--task", "indent", "--duration-s", "10", "--record", file, "--config",
                                    write("station.toml", kStationFile)}));
  const net::Address to = net::parse_address(server.address(), "server");
  net::Udp socket = net::Udp::open_for(to);
  Random random(7);
  constexpr int kDatagrams = 20'000;
  std::vector<std::uint8_t> bytes(600);
  int sent = 0;
  for (int i = 0; i < kDatagrams; ++i) {
    const std::size_t size = random.bits() % bytes.size();
    for (std::size_t k = 0; k < size; ++k) bytes[k] = static_cast<std::uint8_t>(random.bits());
    // Every other one with a good header, so that it gets as far as the decoder of a message.
    if (i % 2 == 0 && size >= 8) {
      const std::size_t payload = size - 8;
      const std::uint8_t header[8] = {'T',
                                      'L',
                                      'N',
                                      'O',
                                      1,
                                      static_cast<std::uint8_t>(1 + random.bits() % 7),
                                      static_cast<std::uint8_t>(payload & 0xff),
                                      static_cast<std::uint8_t>(payload >> 8)};
      std::copy(header, header + 8, bytes.begin());
    }
    while (socket.send({bytes.data(), size}, to) == net::SendStatus::kWouldBlock)
      socket.wait_readable(100'000);
    ++sent;
    if (i % 10 == 9)
      std::this_thread::sleep_for(Milliseconds(1));  // about 8000 a second: all arrive, none queue up
  }
  EXPECT_TRUE(run.running()) << "all of them came during the session";
  ASSERT_TRUE(run.wait(kLong));
  expect_good_session({run.exit_code(), run.ended_by(), run.out(), run.err()}, file, true);
  expect_no_force_step(Rows{RecordingReader(file)});
  const std::string said = server.stop();
  EXPECT_NE(said.find("in 1 sessions"), std::string::npos) << said;
  // Every one that arrived was counted under a cause.
  const auto at = said.rfind("dropped: ");
  ASSERT_NE(at, std::string::npos);
  long dropped = 0;
  const std::string line = said.substr(at, said.find('\n', at) - at);
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (std::isdigit(static_cast<unsigned char>(line[i])) == 0) continue;
    char* end = nullptr;
    dropped += std::strtol(line.c_str() + i, &end, 10);
    i = static_cast<std::size_t>(end - line.c_str());
  }
  EXPECT_GT(dropped, sent * 9 / 10) << said;
  EXPECT_LE(dropped, sent + 2) << said;  // the second and third Bye
  std::printf("%s", said.substr(at).c_str());
}

/// What a scene says about its sessions reaches the stations, unless a flag says otherwise.
TEST_F(ProgramsTest, TheServerPromisesTheTimeOutOfItsScene) {
  const auto promised_ms = [](const std::vector<std::string>& flags) {
    Server server(scene_path("flat_silicon_oxide"), 0, flags);
    const net::Address to = net::parse_address(server.address(), "server");
    net::Udp socket = net::Udp::open_for(to);
    link::ClientSession session{link::ClientConfig{}};
    const rt::SteadyClock clock;
    std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
    session.start(clock.now_ns());
    for (int i = 0; i < 1000 && session.state() != link::ClientState::kEstablished; ++i) {
      if (const std::size_t n = session.poll(clock.now_ns(), buffer)) socket.send({buffer.data(), n}, to);
      socket.wait_readable(10'000'000);
      net::Received received;
      while (socket.receive(buffer, received))
        session.on_datagram({buffer.data(), received.size}, clock.now_ns());
    }
    return session.welcome().timeout_ms;
  };
  EXPECT_EQ(promised_ms({}), 500u);  // [session] timeout_ms of the scene
  EXPECT_EQ(promised_ms({"--timeout-ms", "700"}), 700u);
}

}  // namespace
}  // namespace telenano::programs
