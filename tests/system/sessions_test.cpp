// Sessions of the real programs: a shared tip, the server's end and return, keys read again, a station that
// was killed.
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <memory>
#include <thread>

#include "telenano/common/recording/recording_reader.h"
#include "tests/system/felt_force.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

using recording::RecordingReader;

class SessionsTest : public ProgramsTest {
 protected:
  /// telenano-master run with all that it says.
  static std::vector<std::string> talking(const Server& server, const std::vector<std::string>& more) {
    std::vector<std::string> command{kMaster, "run", "--server", server.address(), "--rt-priority", "0"};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
  /// telenano-lab relay before a server.
  struct Relay {
    Relay(const Server& server, const std::vector<std::string>& more) {
      std::vector<std::string> command{kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address()};
      command.insert(command.end(), more.begin(), more.end());
      child = std::make_unique<ChildProcess>(command);
      EXPECT_TRUE(child->wait_for_err("relay on 127.0.0.1:", kLong) && child->wait_for_err("\n", kLong));
    }
    std::string address() const {
      const std::string said = child->err(), before = "relay on ";
      const std::size_t at = said.find(before) + before.size();
      return said.substr(at, said.find_first_of(" \n", at) - at);
    }
    std::unique_ptr<ChildProcess> child;
  };
  static bool says(const std::string& text, const std::string& words) {
    return text.find(words) != std::string::npos;
  }
};

TEST_F(SessionsTest, OneHoldsTheTipOthersLookOnAndTakeItByRight) {
  Server server(scene_path("flat_pdms"), 0, {"--share", "one-tip", "--local-rights", "administer"});
  ChildProcess first(talking(server, {"--task", "contact", "--duration-s", "60"}));
  ASSERT_TRUE(first.wait_for_err("taking it if it is free", kLong)) << first.err();
  ASSERT_TRUE(first.wait_for_err("engaged", kLong)) << first.err();

  const std::string file = path("observer.h5");
  ChildProcess second(
      talking(server, {"--task", "contact", "--duration-s", "1", "--observe", "--record", file}));
  ASSERT_TRUE(second.wait(kLong)) << second.err();
  EXPECT_EQ(second.exit_code(), 0) << second.err();
  EXPECT_TRUE(says(second.err(), "this server's tip is shared: observing it")) << second.err();
  EXPECT_TRUE(says(second.err(), "observing, the force is zero")) << second.err();
  const RecordingReader observed(file);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double force_n : observed.read("hand_force_applied_h_n", axis)) ASSERT_EQ(force_n, 0);
  }
  for (const double mode : observed.read("station_mode")) ASSERT_NE(mode, 2) << "engaged";

  // Who comes later and does not ask looks on too.
  ChildProcess third(talking(server, {"--task", "contact", "--duration-s", "1"}));
  ASSERT_TRUE(third.wait(kLong)) << third.err();
  EXPECT_EQ(third.exit_code(), 0) << third.err();
  EXPECT_TRUE(says(third.err(), "observing, the force is zero")) << third.err();

  // Who administers, as here everybody on loopback, takes it.
  ChildProcess fourth(talking(server, {"--task", "contact", "--duration-s", "2", "--take-over"}));
  ASSERT_TRUE(first.wait_for_err("observing, the force is zero", kLong)) << first.err();
  ASSERT_TRUE(fourth.wait(kLong)) << fourth.err();
  EXPECT_EQ(fourth.exit_code(), 0) << fourth.err();
  EXPECT_TRUE(says(fourth.err(), "asking for it")) << fourth.err();
  first.signal(SIGINT);
  ASSERT_TRUE(first.wait(kLong));
  EXPECT_EQ(first.exit_code(), 0) << first.err();
  const std::string said = server.stop();
  EXPECT_TRUE(says(said, ", one tip for all")) << said;
  EXPECT_TRUE(says(said, "in 4 sessions")) << said;
}

/// Heights of the nodes that a recording says are marked, by column and row, at its end.
std::map<std::pair<std::uint32_t, std::uint32_t>, double> marked_nodes(const std::string& file) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> nodes;
  for (const recording::MarkRow& row : RecordingReader(file).marks())
    if (row.column != recording::MarkRow::kPlace) nodes[{row.column, row.row}] = row.value;
  return nodes;
}

// One ploughs, another only looks on: its recording has the groove, in the places and as deep as the one who
// makes it has it, from while it is made.
TEST_F(SessionsTest, WhoLooksOnRecordsTheMarksOfAnother) {
  Server server(scene_path("lithography"), 0, {"--share", "one-tip"});
  const std::string script = write("down.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,30\n1.5,0,0,-8\n11,30,0,-8\n");
  const std::string made = path("made.h5"), seen = path("seen.h5");
  ChildProcess first(
      talking(server, {"--task", "script", "--script", script, "--method", "twin", "--record", made}));
  ASSERT_TRUE(first.wait_for_err("engaged", kLong)) << first.err();
  ChildProcess second(talking(server, {"--observe", "--duration-s", "9", "--record", seen}));
  ASSERT_TRUE(second.wait(kLong)) << second.err();
  EXPECT_EQ(second.exit_code(), 0) << second.err();
  ASSERT_TRUE(first.wait(kLong)) << first.err();
  EXPECT_EQ(first.exit_code(), 0) << first.err();
  const auto own = marked_nodes(made), looked = marked_nodes(seen);
  EXPECT_GT(own.size(), 20u);
  EXPECT_GT(looked.size(), 20u);
  double deepest = 0;
  for (const auto& [node, height] : looked) {
    ASSERT_TRUE(own.contains(node)) << node.first << ' ' << node.second;
    deepest = std::min(deepest, height);
  }
  EXPECT_LT(deepest, -1) << "nm";
  const std::vector<recording::MarkRow> rows = RecordingReader(seen).marks();
  ASSERT_FALSE(rows.empty());
  EXPECT_GT(rows.back().time_s - rows.front().time_s, 1) << "as it grows, not once";
  const RecordingReader reader(seen);
  for (int axis = 0; axis < 3; ++axis)
    for (const double force_n : reader.read("hand_force_applied_h_n", axis)) ASSERT_EQ(force_n, 0);
}

/// Of `telenano-lab replay`'s row: all ticks were replayed and equal; how many were told.
struct Replayed {
  bool whole = false;
  double told = 0;
  std::string said;
};
Replayed replayed(const std::string& file) {
  const Finished replay = run_program({kLab, "replay", file}, {}, kLong);
  Replayed result;
  result.said = replay.out + replay.err;
  const auto lines = lines_of(replay.out);
  if (replay.exit_code != 0 || lines.size() != 2) return result;
  std::vector<double> numbers;
  for (std::size_t at = lines[1].find(".h5,") + 4; numbers.size() < 6; at = lines[1].find(',', at) + 1)
    numbers.push_back(std::atof(lines[1].c_str() + at));
  result.whole = numbers[0] > 1000 && numbers[1] == numbers[0] && numbers[2] == numbers[0];
  result.told = numbers[5];
  return result;
}

// At a shared tip the last groove is taken back: by who has made it, and by nobody else with the same right. Who looks
// on records the sample without it, and the session is replayed to its end with the same bits. A state takes its
// time on a busy machine.
TEST_F(SessionsTest, MarksAreTakenBackAtASharedTipByWhoMadeThem) {
  const std::string script =
      write("groove.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,30\n1,0,0,-8\n2,15,0,-8\n2.5,15,0,30\n18,15,0,30\n");
  for (const char* method : {"twin", "ks-clamp"}) {
    Server server(scene_path("lithography"), 0, {"--share", "one-tip", "--local-rights", "administer"});
    const std::string made = path(std::string(method) + "_made.h5"),
                      seen = path(std::string(method) + "_seen.h5");
    ChildProcess first(talking(server, {"--task", "script", "--script", script, "--method", method,
                                        "--record", made, "--undo-marks-at", "10"}));
    ASSERT_TRUE(first.wait_for_err("engaged", kLong)) << first.err();
    ChildProcess second(talking(server, {"--observe", "--duration-s", "19", "--record", seen}));
    ASSERT_TRUE(second.wait(kLong)) << second.err();
    EXPECT_EQ(second.exit_code(), 0) << second.err();
    ASSERT_TRUE(first.wait(kLong)) << first.err();
    EXPECT_EQ(first.exit_code(), 0) << first.err();
    EXPECT_TRUE(says(first.out(), "last stroke of marks taken back")) << first.out() << first.err();
    for (const std::string& file : {made, seen}) {
      if (file == made && std::string(method) != "twin")
        continue;  // who has no twin has no picture of the sample
      double deepest = 0;
      for (const recording::MarkRow& row : RecordingReader(file).marks())
        if (row.column != recording::MarkRow::kPlace) deepest = std::min(deepest, 1.0 * row.value);
      EXPECT_LT(deepest, -1) << "nm: it was there, in " << file;
      const auto nodes = marked_nodes(file);
      EXPECT_GT(nodes.size(), 20u) << file;
      for (const auto& [node, height] : nodes)
        ASSERT_NEAR(height, 0, 1e-6) << "nm: and is not any more, in " << file;
    }
    const Replayed replay = replayed(made);
    // Without a log of steps the slave's are known only where none waited for a later one.
    const bool known = std::string(method) == "twin" || !says(server.stop(), "waited for later ones");
    EXPECT_TRUE(replay.whole || !known) << replay.said;
    EXPECT_EQ(replay.told > 0, std::string(method) == "twin") << replay.said;
    const Replayed looked = replayed(seen);
    EXPECT_TRUE(looked.whole) << looked.said;
    std::printf("%s: %s%s%s", method, replay.said.c_str(), known ? "" : "(not known)\n", looked.said.c_str());
  }
}

// Who administers takes the tip and takes back what another has made. What that one recorded is replayed to its end,
// over the time in which it only observed.
TEST_F(SessionsTest, AnAdministratorTakesBackAnothersMarksAndTheReplayGoesOnOverThat) {
  const std::string script =
      write("groove.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,30\n1,0,0,-8\n2,15,0,-8\n2.5,15,0,30\n12,15,0,30\n");
  const std::string up = write("up.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,30\n3,0,0,30\n");
  Server server(scene_path("lithography"), 0, {"--share", "one-tip", "--local-rights", "administer"});
  const std::string made = path("made.h5");
  ChildProcess first(
      talking(server, {"--task", "script", "--script", script, "--method", "twin", "--record", made}));
  ASSERT_TRUE(first.wait_for_err("engaged", kLong)) << first.err();
  ::usleep(6'000'000);
  ChildProcess second(
      talking(server, {"--task", "script", "--script", up, "--take-over", "--undo-marks-at", "2.5"}));
  ASSERT_TRUE(second.wait(kLong)) << second.err();
  first.signal(SIGINT);
  ASSERT_TRUE(first.wait(kLong)) << first.err();
  EXPECT_TRUE(says(second.out(), "last stroke of marks taken back")) << second.out() << second.err();
  const auto nodes = marked_nodes(made);
  EXPECT_GT(nodes.size(), 20u);
  for (const auto& [node, height] : nodes) ASSERT_NEAR(height, 0, 1e-6) << "nm: seen by who observes by now";
  const Replayed replay = replayed(made);
  EXPECT_TRUE(replay.whole) << replay.said;
  EXPECT_GT(replay.told, 100) << replay.said;
}

// The user's cache can hold nothing (no such place, no room), or two stations that start at once fill it: each
// has its twin all the same.
TEST_F(SessionsTest, ACacheThatHoldsNothingOrIsSharedKeepsNobodyFromATwin) {
  Server server(scene_path("flakes"));
  const auto with_cache = [&](const std::string& folder) {
    std::vector<std::string> command{"/usr/bin/env", "XDG_CACHE_HOME=" + folder};
    for (const std::string& word :
         talking(server, {"--task", "contact", "--duration-s", "3", "--method", "twin"}))
      command.push_back(word);
    return command;
  };
  const Finished nowhere = run_program(with_cache("/proc/self"), {}, kLong);
  EXPECT_EQ(nowhere.exit_code, 0) << nowhere.err;
  EXPECT_TRUE(says(nowhere.err, "the scene is not kept")) << nowhere.err;
  EXPECT_FALSE(says(nowhere.err, "no twin")) << nowhere.err;
  ChildOptions full;
  full.file_bytes_max = 0;
  const std::string no_room = path("no_room");
  const Finished none = run_program(with_cache(no_room), full, kLong);
  EXPECT_EQ(none.exit_code, 0) << none.err;
  EXPECT_TRUE(says(none.err, "the scene is not kept")) << none.err;
  EXPECT_FALSE(says(none.err, "no twin")) << none.err;
  // Nothing half written is left, which a later station would have to judge.
  for (const auto& entry : std::filesystem::recursive_directory_iterator(no_room))
    EXPECT_FALSE(entry.is_regular_file() && entry.path().extension() == ".scene") << entry.path();

  const std::string together = path("together");
  std::vector<std::unique_ptr<ChildProcess>> stations;
  for (int i = 0; i < 2; ++i) stations.push_back(std::make_unique<ChildProcess>(with_cache(together)));
  for (const auto& one : stations) {
    ASSERT_TRUE(one->wait(kLong)) << one->err();
    EXPECT_EQ(one->exit_code(), 0) << one->err();
    EXPECT_FALSE(says(one->err(), "no twin")) << one->err();
    EXPECT_FALSE(says(one->err(), "the scene is not kept")) << one->err();
  }
  std::size_t kept = 0;
  // Beside them the fields that a server's program keeps (fields-*.bin).
  for (const auto& entry : std::filesystem::recursive_directory_iterator(together + "/telenano/scenes")) {
    if (!entry.is_regular_file()) continue;
    EXPECT_EQ(entry.path().extension(), ".scene") << "left over: " << entry.path();
    ++kept;
  }
  EXPECT_GE(kept, 1u);
  // And the next one believes what they have kept.
  const Finished next = run_program(with_cache(together), {}, kLong);
  EXPECT_EQ(next.exit_code, 0) << next.err;
  EXPECT_FALSE(says(next.err, "no twin")) << next.err;
}

// Its task would be too wide for the device at this scale; it has none.
TEST_F(SessionsTest, WhoOnlyLooksOnIsNotRefusedForATask) {
  Server server(scene_path("flat_pdms"), 0, {"--share", "one-tip"});
  const std::string config = write("station.toml", "[scaling]\nvelocity = 4e-9\nforce = 1e6\n");
  const std::vector<std::string> words = {"--task",   "indent", "--duration-s",          "1",
                                          "--config", config,   "--allow-unsafe-scaling"};
  ChildProcess refused(talking(server, words));
  ASSERT_TRUE(refused.wait(kLong)) << refused.err();
  EXPECT_EQ(refused.exit_code(), 2);
  EXPECT_TRUE(says(refused.err(), "outside the device's")) << refused.err();
  std::vector<std::string> observing = words;
  observing.push_back("--observe");
  ChildProcess observer(talking(server, observing));
  ASSERT_TRUE(observer.wait(kLong)) << observer.err();
  EXPECT_EQ(observer.exit_code(), 0) << observer.err();
}

TEST_F(SessionsTest, WhoOnlyLooksOnDoesSoUntilStopped) {
  Server server(scene_path("flat_pdms"), 0, {"--share", "one-tip"});
  // A task of a second would be over after one.
  const std::string config = write("station.toml", "[task]\nduration_s = 1\n");
  ChildProcess observer(talking(server, {"--observe", "--config", config}));
  ASSERT_TRUE(observer.wait_for_err("observing it, until you stop this with Ctrl-C", kLong))
      << observer.err();
  ASSERT_TRUE(observer.wait_for_err("observing, the force is zero", kLong)) << observer.err();
  EXPECT_FALSE(observer.wait(std::chrono::milliseconds(2500))) << observer.err();
  observer.signal(SIGINT);
  ASSERT_TRUE(observer.wait(kLong));
  EXPECT_EQ(observer.exit_code(), 0) << observer.err();
}

TEST_F(SessionsTest, WhatDoesNotGoTogetherWithSharingIsToldInOneLine) {
  Server server(scene_path("flat_pdms"));
  const Finished none = run_program(station(server, {"--observe"}), {}, kLong);
  EXPECT_EQ(none.exit_code, 1);
  EXPECT_EQ(lines_of(none.err).size(), 1u) << none.err;
  EXPECT_TRUE(says(none.err, "--share one-tip")) << none.err;
  const Finished both = run_program(station(server, {"--observe", "--take-over"}), {}, kLong);
  EXPECT_EQ(both.exit_code, 2);
  EXPECT_EQ(lines_of(both.err).size(), 1u) << both.err;
  const Finished share = run_program(
      {kNve, "serve", "--scene", scene_path("flat_pdms"), "--listen", "127.0.0.1:0", "--share", "all"});
  EXPECT_EQ(share.exit_code, 2);
  EXPECT_TRUE(says(share.err, "--share")) << share.err;
}

TEST_F(SessionsTest, AServerShutDownInContactWithdrawsAndItsStationWaitsForTheNext) {
  auto first = std::make_unique<Server>(scene_path("flat_pdms"));
  const int port = first->port();
  const std::string file = path("restart.h5");
  ChildProcess run(talking(*first, {"--task", "contact", "--duration-s", "6", "--record", file}));
  ASSERT_TRUE(run.wait_for_err("engaged", kLong)) << run.err();
  std::this_thread::sleep_for(Milliseconds(2500));
  const auto asked = std::chrono::steady_clock::now();
  EXPECT_TRUE(says(first->stop(), "stopped: "));
  const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - asked).count();
  EXPECT_LT(took_s, 5) << "a second at most, and what a busy machine adds";
  ASSERT_TRUE(run.wait_for_err("the server is shutting down: the force is zero", kLong)) << run.err();
  Server second(scene_path("flat_pdms"), port);
  ASSERT_TRUE(run.wait(kLong)) << run.err();
  EXPECT_EQ(run.exit_code(), 0) << run.err();
  EXPECT_TRUE(says(second.stop(), "in 1 sessions"));

  // No step: the force rises by at most 4000 N/s.
  const FeltForce felt = felt_force(file);
  EXPECT_LE(felt.most_rise_n, 4 * (1 + 1e-9));
  EXPECT_GT(felt.most_n, 0.1) << "felt";
}

TEST_F(SessionsTest, AServerShutDownForGoodIsToldAsSuch) {
  Server server(scene_path("flat_pdms"));
  ChildProcess run(station(server, {"--duration-s", "30", "--give-up-s", "1"}));
  std::this_thread::sleep_for(Milliseconds(1500));
  server.stop();
  ASSERT_TRUE(run.wait(kLong)) << run.err();
  EXPECT_EQ(run.exit_code(), 1);
  EXPECT_TRUE(says(run.err(), "shut down and did not come back within 1 s; the force is zero")) << run.err();
}

TEST_F(SessionsTest, AnotherSceneAtTheSamePortIsALatchedStop) {
  auto first = std::make_unique<Server>(scene_path("flat_pdms"));
  const int port = first->port();
  ChildProcess run(talking(*first, {"--task", "contact", "--duration-s", "20"}));
  ASSERT_TRUE(run.wait_for_err("engaged", kLong)) << run.err();
  first->child().signal(SIGKILL);
  ASSERT_TRUE(first->child().wait(kLong));
  Server second(scene_path("flat_polystyrene"), port);
  ASSERT_TRUE(run.wait(kLong)) << run.err();
  EXPECT_EQ(run.exit_code(), 1) << run.err();
  EXPECT_TRUE(says(run.err(), "the station stopped itself: ")) << run.err();
}

TEST_F(SessionsTest, AHangUpReadsTheKeysAgainAndSaysWhatItDoesNot) {
  Server plain(scene_path("flat_pdms"));
  plain.child().signal(SIGHUP);
  EXPECT_TRUE(plain.child().wait_for_err("restart to serve another one", kLong)) << plain.child().err();
  EXPECT_TRUE(plain.child().running());
  plain.stop();
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without TELENANO_DTLS";
  const std::string keys = path("keys.toml");
  const auto make = [&](const std::string& name) {
    return run_program({kNve, "keys", "new", name, "--keys", keys, "--out", path(name + ".key")}).exit_code;
  };
  ASSERT_EQ(make("one"), 0);
  Server server(scene_path("flat_pdms"), 0, {"--keys", keys});
  ASSERT_EQ(make("two"), 0);
  server.child().signal(SIGHUP);
  ASSERT_TRUE(server.child().wait_for_err("keys read again: 2 entries", kLong)) << server.child().err();
  EXPECT_EQ(
      run_program(station(server, {"--duration-s", "0.5", "--key", path("two.key")}), {}, kLong).exit_code,
      0);
  EXPECT_TRUE(says(server.stop(), "SIGHUP: reading the list of keys"));
}

// Method twin: the scene comes from the server, its slave runs at the station, and each reply's hash says
// whether the two are still the same. A server that shares no scene leaves the station with the plane.
TEST_F(SessionsTest, TheStationFetchesTheSceneAndFeelsItsTwin) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without OpenSSL, whose SHA-256 names scenes";
  Server server(scene_path("flat_silicon_oxide"));
  const std::vector<std::string> press{"--task", "indent", "--duration-s", "2", "--method", "twin"};
  const Finished done = run_program(talking(server, press), {}, kLong);
  EXPECT_EQ(done.exit_code, 0) << done.err;
  EXPECT_TRUE(says(done.err, "method twin")) << done.err;
  EXPECT_TRUE(says(done.err, "steps ahead")) << done.err;
  EXPECT_FALSE(says(done.err, "no twin")) << done.err;
  EXPECT_FALSE(says(done.err, "given up")) << done.err;
  EXPECT_FALSE(says(done.err, "apart")) << done.err;

  Server secretive(scene_path("flat_silicon_oxide"), 0, {"--no-scene-sharing"});
  const Finished plain = run_program(talking(secretive, press), {}, kLong);
  EXPECT_EQ(plain.exit_code, 0) << plain.err;
  EXPECT_TRUE(says(plain.err, "no twin, method model instead")) << plain.err;
}

// At a shared tip who holds it has a twin, from the state in which the last one left it.
TEST_F(SessionsTest, WhoHoldsASharedTipFeelsItsTwin) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without OpenSSL, whose SHA-256 names scenes";
  Server shared(scene_path("flakes"), 0, {"--share", "one-tip", "--local-rights", "administer"});
  ChildProcess first(talking(shared, {"--task", "contact", "--duration-s", "60", "--method", "twin"}));
  ASSERT_TRUE(first.wait_for_err("engaged", kLong)) << first.err();
  ASSERT_TRUE(first.wait_for_err("steps ahead", kLong)) << first.err();
  const std::string file = path("taken.h5");
  ChildProcess second(talking(shared, {"--task", "indent", "--duration-s", "3", "--method", "twin",
                                       "--take-over", "--record", file}));
  ASSERT_TRUE(first.wait_for_err("observing, the force is zero", kLong)) << first.err();
  ASSERT_TRUE(second.wait(kLong)) << second.err();
  EXPECT_EQ(second.exit_code(), 0) << second.err();
  EXPECT_TRUE(says(second.err(), "steps ahead")) << second.err();
  first.signal(SIGINT);
  ASSERT_TRUE(first.wait(kLong));
  for (const std::string& said : {first.err(), second.err()}) {
    EXPECT_FALSE(says(said, "no twin")) << said;
    EXPECT_FALSE(says(said, "given up")) << said;
    EXPECT_FALSE(says(said, "apart")) << said;
  }
  const RecordingReader taken(file);
  const auto method = taken.read("method"), mode = taken.read("station_mode");
  EXPECT_EQ(method.back(), 7) << "twin";
  EXPECT_NE(std::find(mode.begin(), mode.end(), 2), mode.end()) << "engaged";
  EXPECT_TRUE(says(shared.stop(), "in 2 sessions (0 resumed)"));
}

// Where nobody says which: the twin, in the one session that is opened, and where there can be none one line
// says why and the round trip decides, of the same slave.
TEST_F(SessionsTest, WhereNobodySaysWhichTheSampleItselfIsFelt) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without OpenSSL, whose SHA-256 names scenes";
  const std::vector<std::string> press{"--task", "indent", "--duration-s", "1"};
  Server server(scene_path("flat_silicon_oxide"));
  const Finished done = run_program(talking(server, press), {}, kLong);
  EXPECT_EQ(done.exit_code, 0) << done.err;
  EXPECT_TRUE(says(done.err, "method twin (the server's scene runs here too)")) << done.err;
  EXPECT_FALSE(says(done.err, "no twin")) << done.err;
  EXPECT_TRUE(says(server.stop(), "in 1 sessions (0 resumed)"));

  const auto by_round_trip = [&](const Server& from, const std::vector<std::string>& more, const char* why) {
    std::vector<std::string> command = talking(from, press);
    command.insert(command.end(), more.begin(), more.end());
    const Finished plain = run_program(command, {}, kLong);
    EXPECT_EQ(plain.exit_code, 0) << plain.err;
    EXPECT_TRUE(says(plain.err, std::string("note: no twin, another method instead: ") + why)) << plain.err;
    EXPECT_TRUE(says(plain.err, "(by the round trip)")) << plain.err;
  };
  Server secretive(scene_path("flat_silicon_oxide"), 0, {"--no-scene-sharing"});
  by_round_trip(secretive, {}, "this server does not share its scene");
  EXPECT_TRUE(says(secretive.stop(), "in 1 sessions (1 resumed)"));
  // Who only looks on feels nothing: nothing is fetched for that, and nothing said.
  Server watched(scene_path("flat_silicon_oxide"), 0, {"--share", "one-tip"});
  std::vector<std::string> looks = talking(watched, press);
  looks.push_back("--observe");
  const Finished on_looker = run_program(looks, {}, kLong);
  EXPECT_EQ(on_looker.exit_code, 0) << on_looker.err;
  EXPECT_FALSE(says(on_looker.err, "no twin")) << on_looker.err;
}

// No round trip is too long for a twin: its force waits for no answer.
TEST_F(SessionsTest, ALongWayIsATwins) {
  if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without OpenSSL, whose SHA-256 names scenes";
  Server server(scene_path("flat_silicon_oxide"));
  const Relay relay(server, {"--delay-ms", "310"});
  const std::string file = path("far.h5");
  const Finished run = run_program({kMaster, "run", "--server", relay.address(), "--rt-priority", "0",
                                    "--task", "indent", "--duration-s", "2", "--record", file},
                                   {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_TRUE(says(run.err, "method twin (the server's scene runs here too)")) << run.err;
  const RecordingReader reader(file);
  EXPECT_EQ(reader.read("method").back(), 7) << "twin";
  EXPECT_GT(felt_force(file).most_n, 0.5);
}

// A method that shows no force at this round trip does not engage. It is said before, the session ends when the task would
// be over, and says it again.
TEST_F(SessionsTest, AHandThatCannotEngageIsGivenUpAfterItsTasksTime) {
  Server server(scene_path("flat_silicon_oxide"));
  const Relay relay(server, {"--delay-ms", "500"});
  const auto began = std::chrono::steady_clock::now();
  const Finished run = run_program({kMaster, "run", "--server", relay.address(), "--rt-priority", "0",
                                    "--task", "indent", "--method", "model", "--duration-s", "2"},
                                   {}, kLong);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(15));
  EXPECT_EQ(run.exit_code, 1) << run.err;
  EXPECT_TRUE(says(run.err, "note: the hand will not engage: the round trip is 100")) << run.err;
  EXPECT_TRUE(says(run.err, "the hand was not engaged for as long as its task lasts: the round trip is 100"))
      << run.err;
  EXPECT_TRUE(says(run.err, "ms, and method model shows forces up to 800 ms; give --method twin")) << run.err;
}

// The same where the way becomes long while the task goes on: its motion stands still with the tip.
TEST_F(SessionsTest, AHandThatIsHeldIsGivenUpAfterItsTasksTime) {
  Server server(scene_path("flat_silicon_oxide"));
  const Relay relay(server,
                    {"--trace", write("grows.csv", "time_s,delay_ms,lost\n0,10,0\n2,500,0\n1000,500,0\n")});
  const Finished run = run_program({kMaster, "run", "--server", relay.address(), "--rt-priority", "0",
                                    "--task", "indent", "--method", "model", "--duration-s", "3"},
                                   {}, std::chrono::seconds(30));
  EXPECT_EQ(run.exit_code, 1) << run.err;
  EXPECT_TRUE(says(run.err, "held ")) << run.err;
  EXPECT_TRUE(says(run.err, "the hand was not engaged for as long as its task lasts: the round trip is 100"))
      << run.err;
}

}  // namespace
}  // namespace telenano::programs
