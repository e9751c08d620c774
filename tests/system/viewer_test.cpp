// The station's picture with the real programs: without a display, in a window under Xvfb, and what is
// refused.
#include <algorithm>
#include <cmath>
#include <fstream>

#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/master/view_model/marked_ground.h"
#include "telenano/master/viewer/png.h"
#include "tests/source_dir.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

const std::string kScan = std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf";

// What a person at the window does, who waits until something is seen, and presses a key again where nothing
// is. Standard error goes to err.txt, whose newest line tells how far the session is.
const std::string kPerson = R"sh(
await() { for i in $(seq 900); do eval "$1" && return; sleep 0.1; done; echo "no: $1"; }
press_until() {
  for n in $(seq 24); do
    xdotool key $1
    for i in $(seq 50); do eval "$2" && return; sleep 0.1; done
  done
  echo "no: $2"
}
# The window's title says what has been drawn.
see() { xdotool search --sync --name "$1" >/dev/null; }
# The number after a word of the newest line that tells how far the session is.
told() { awk -v word="$1" '/ nN .* mJ /{for (i = 1; i < NF; ++i) if ($i == word) value = $(i + 1)} END {print value}' err.txt; }
time_told() { awk '/ nN .* mJ /{value = $1} END {print value + 0}' err.txt; }
above() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a != "" && a + 0 > b + 0) }'; }
below() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a != "" && a + 0 < b + 0) }'; }
# N moves of the pointer by so many pixels down, as fast as a hand goes.
drag() { xdotool $(for i in $(seq $1); do echo mousemove_relative -- 0 $2 sleep 0.03; done); }
# Drags by $3 pixels a move from height $2 until $1; $4: it is held already. A tip that its server has withdrawn (it
# had heard nothing for a while) is farther from the sample than the mouse leads it at once, and a hand whose window
# draws nothing for a while is let go: whoever gets no further lets go too, and drags again from there.
lead() {
  for n in 1 2 3; do
    [ "$4" = held ] && [ $n = 1 ] || { xdotool mousemove 760 $2 mousedown 1; echo click; }
    drag 165 $3
    end=$((SECONDS + 6)); while [ $SECONDS -lt $end ]; do eval "$1" && return; sleep 0.1; done
    xdotool mouseup 1; sleep 1.5
  done
  echo "no: $1"
}
)sh";

class ViewerPrograms : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_viewer_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  static std::vector<std::string> without_display(std::vector<std::string> command) {
    command.insert(command.begin(), {"/usr/bin/env", "-u", "DISPLAY", "-u", "WAYLAND_DISPLAY"});
    return command;
  }
  Finished refused(std::vector<std::string> flags) {
    std::vector<std::string> command = {kMaster, "run", "--server", "127.0.0.1:9"};
    command.insert(command.end(), flags.begin(), flags.end());
    return run_program(without_display(command));
  }
  std::filesystem::path folder_;
};

TEST_F(ViewerPrograms, AScreenshotNeedsNoDisplayAndDisturbsNoSession) {
  Server server(scene_path("flakes"));
  const Finished run =
      run_program(without_display({kMaster,         "run",         "--server",          server.address(),
                                   "--task",        "indent",      "--duration-s",      "3",
                                   "--rt-priority", "0",           "--surface",         kScan,
                                   "--screenshot",  path("a.png"), "--screenshot-size", "900x600",
                                   "--at",          "1.6",         "--record",          path("a.h5")}));
  if (run.err.find("no picture without a display") != std::string::npos) GTEST_SKIP() << run.err;
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const viewer::Picture picture = viewer::read_png(path("a.png"));
  ASSERT_EQ(picture.width_px, 900);
  ASSERT_EQ(picture.height_px, 600);
  // STOP is red at the upper right, SIM blue at the upper left, and the scan not one colour.
  const auto at = [&](int x, int y) { return &picture.rgb[static_cast<std::size_t>(3 * (y * 900 + x))]; };
  EXPECT_GT(at(870, 20)[0], 180);
  EXPECT_LT(at(870, 20)[1], 120);
  EXPECT_GT(at(14, 20)[2], 200);
  EXPECT_LT(at(14, 20)[0], 140);
  double sum = 0;
  double squares = 0;
  for (int y = 180; y < 400; ++y) {
    for (int x = 40; x < 380; ++x) {
      sum += at(x, y)[2];
      squares += 1.0 * at(x, y)[2] * at(x, y)[2];
    }
  }
  const double count = 220 * 340;
  EXPECT_GT(squares / count - sum / count * sum / count, 200);
  const recording::RecordingReader recording(path("a.h5"));
  EXPECT_TRUE(recording.closed());
  EXPECT_EQ(recording.rows_dropped(), 0u);
  EXPECT_GE(recording.read("time_s").back(), 3.0);
}

// What a particle's colour alone is: sand, neither the orange of the tip nor the scan's.
TEST_F(ViewerPrograms, AParticleIsShownWhereTheSceneHasOne) {
  const auto sandy_px = [&](const std::string& scene) {
    Server server(scene_path(scene));
    const Finished run = run_program(
        without_display({kMaster, "run", "--server", server.address(), "--task", "position", "--duration-s",
                         "1", "--rt-priority", "0", "--screenshot", path(scene + ".png"), "--screenshot-size",
                         "900x600", "--at", "0.8", "--record", path(scene + ".h5")}));
    if (run.err.find("no picture without a display") != std::string::npos) return -1;
    EXPECT_EQ(run.exit_code, 0) << run.err;
    // And in its recording.
    const Finished view =
        run_program(without_display({kMaster, "view", path(scene + ".h5"), "--screenshot", path("view.png"),
                                     "--screenshot-size", "900x600", "--at", "0.8"}));
    EXPECT_EQ(view.exit_code, 0) << view.err;
    const auto count = [](const viewer::Picture& picture) {
      int sandy = 0;
      for (int y = 180; y < 400; ++y) {
        for (int x = 10; x < 380; ++x) {
          const std::uint8_t* const c = &picture.rgb[static_cast<std::size_t>(3 * (y * 900 + x))];
          sandy +=
              c[0] > 60 && 4 * c[0] > 5 * c[2] && 10 * c[1] > 11 * c[2] && 100 * c[0] < 135 * c[1] ? 1 : 0;
        }
      }
      return sandy;
    };
    const int live = count(viewer::read_png(path(scene + ".png")));
    EXPECT_EQ(count(viewer::read_png(path("view.png"))) > 200, live > 200);
    return live;
  };
  const int with_one = sandy_px("particle");
  if (with_one < 0) GTEST_SKIP() << "no picture without a display";
  EXPECT_GT(with_one, 200);  // a ball of 30 px
  EXPECT_LT(sandy_px("flat_silicon_oxide"), 20);
}

TEST_F(ViewerPrograms, AWindowUnderXvfbLastsAsLongAsTheSession) {
  if (!std::filesystem::exists("/usr/bin/xvfb-run"))
    GTEST_SKIP() << "no xvfb-run: apt-get install xvfb xauth";
  Server server(scene_path("flakes"));
  const Finished run =
      run_program({"/usr/bin/xvfb-run", "-a", kMaster, "run", "--server", server.address(), "--task",
                   "contact", "--duration-s", "2", "--rt-priority", "0", "--view", "--surface", kScan});
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  EXPECT_NE(run.err.find("viewer: "), std::string::npos) << run.err;
  const Finished mouse = run_program({"/usr/bin/xvfb-run", "-a", kMaster, "run", "--server", server.address(),
                                      "--device", "mouse", "--duration-s", "2", "--rt-priority", "0"});
  ASSERT_EQ(mouse.exit_code, 0) << mouse.err << mouse.out;
  EXPECT_NE(mouse.err.find("viewer: "), std::string::npos) << mouse.err;
}

TEST_F(ViewerPrograms, ARecordingIsShownWithoutServerOrDisplay) {
  Server server(scene_path("flakes"));
  const Finished run =
      run_program({kMaster, "run", "--server", server.address(), "--task", "contact", "--duration-s", "2",
                   "--rt-priority", "0", "--quiet", "--record", path("a.h5")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  server.stop();
  const Finished view =
      run_program(without_display({kMaster, "view", path("a.h5"), "--surface", kScan, "--screenshot",
                                   path("v.png"), "--at", "1.2", "--screenshot-size", "800x500"}));
  if (view.err.find("no picture without a display") != std::string::npos) GTEST_SKIP() << view.err;
  ASSERT_EQ(view.exit_code, 0) << view.err;
  EXPECT_NE(view.err.find("1.200 s of the recording"), std::string::npos) << view.err;
  const viewer::Picture picture = viewer::read_png(path("v.png"));
  ASSERT_EQ(picture.width_px, 800);
  ASSERT_EQ(picture.height_px, 500);
  // Where a session has its red STOP there is none, and the banner's first pill is a recording's.
  const auto at = [&](int x, int y) { return &picture.rgb[static_cast<std::size_t>(3 * (y * 800 + x))]; };
  EXPECT_LT(at(700, 14)[0], 120);
  EXPECT_GT(at(14, 20)[0], 200);
  EXPECT_LT(at(14, 20)[2], 120);
  // A recording that is none, and one that is not there.
  std::ofstream(path("none.h5")) << "nothing";
  for (const char* name : {"none.h5", "away.h5"}) {
    const Finished refused =
        run_program(without_display({kMaster, "view", path(name), "--screenshot", path("w.png")}));
    EXPECT_EQ(refused.exit_code, 2) << refused.err;
    EXPECT_NE(refused.err.find(name), std::string::npos) << refused.err;
  }
  const Finished blind = run_program(without_display({kMaster, "view", path("a.h5")}));
  EXPECT_EQ(blind.exit_code, 2);
  EXPECT_NE(blind.err.find("there is no display"), std::string::npos) << blind.err;
  EXPECT_FALSE(std::filesystem::exists(path("w.png")));
}

// With the loop's own priority where this user may have it: else drawing gives way, on a busy machine for
// seconds. A new user's first minute: a window, a drag down until the tip touches, a picture, marks; by keys
// and mouse as a person would press them.
TEST_F(ViewerPrograms, ANewUserTouchesTheSampleWithTheMouse) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  // A drag down: the section is 0.8 gap + 8 nm to either side of its middle and 600 pixels high, so the tip
  // comes down from 40 nm as gap + 10 nm = 50 nm exp(-0.8 pixels / 300), and touches after 604 of these 740
  // pixels. The marks and the end of the session may come faster than pictures are drawn
  // (X takes a press 20 ms after a release for the keyboard's own repeat).
  std::ofstream(path("user.sh")) << "cd " << folder_.string() << kPerson << kMaster << " run --server "
                                 << server.address() << " --device mouse --record m.h5 --surface " << kScan
                                 << " 2>err.txt &\n"
                                    "master=$!\n"
                                    "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'\n"
                                    "xdotool mousemove 760 30 mousedown 1; drag 185 4\n"
                                    "await 'above \"$(told force)\" 1'\n"
                                    "press_until p '[ -s telenano-1.png ]'\n"
                                    "xdotool mouseup 1 key --delay 60 m m m m m ctrl+q\n"
                                    "await '! kill -0 $master 2>/dev/null'; wait $master\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out << file_text(path("err.txt"));
  EXPECT_EQ(user.out, "") << file_text(path("err.txt"));
  EXPECT_TRUE(std::filesystem::exists(path("telenano-1.png")));
  const recording::RecordingReader recording(path("m.h5"));
  double deepest = 0;
  for (const double state : recording.read("contact_state")) deepest = std::max(deepest, state);
  EXPECT_EQ(deepest, 3) << "contact; " << file_text(path("err.txt"));
  // No tap is lost, however slowly the window is drawn.
  int marks = 0;
  for (const recording::Event& event : recording.events())
    marks += std::string(event.text.data()) == "mark" ? 1 : 0;
  EXPECT_EQ(marks, 5);
}

TEST_F(ViewerPrograms, ATaskIsChosenInTheWindow) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  // While the tip presses on the sample; then until the hand has let go, gone back and begun.
  std::ofstream(path("user.sh")) << "cd " << folder_.string() << kPerson << kMaster << " run --server "
                                 << server.address() << " --view --record t.h5 --surface " << kScan
                                 << " 2>err.txt &\n"
                                    "master=$!\n"
                                    "see 'Telenano: flakes at'\n"
                                    "await 'above \"$(told force)\" 1'; before=$(time_told)\n"
                                    "xdotool key t\n"
                                    "await 'below $(time_told) $before'; await 'above $(time_told) 2'\n"
                                    "xdotool key ctrl+q; wait $master\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out << file_text(path("err.txt"));
  EXPECT_EQ(user.out, "") << file_text(path("err.txt"));
  const recording::RecordingReader recording(path("t.h5"));
  double chosen_s = 0;
  for (const recording::Event& event : recording.events())
    if (std::string(event.text.data()) == "task chosen") chosen_s = event.time_s;
  ASSERT_GT(chosen_s, 0) << "the key was not heard: " << file_text(path("err.txt"));
  // Over the change the force on the hand never steps: no more than the slew limit's 4 N in a tick of 1 ms at
  // any moment, and no stop.
  const auto mode = recording.read("station_mode");
  const auto force = recording.read("hand_force_applied_h_n", 2);
  const auto time_s = recording.read("time_s");
  double step_n = 0;
  for (std::size_t i = 1; i < mode.size(); ++i) {
    if (time_s[i] > chosen_s && time_s[i] < chosen_s + 6 && mode[i] != 4)
      step_n = std::max(step_n, std::abs(force[i]) - std::abs(force[i - 1]));
  }
  EXPECT_LT(step_n, 4);
  // The clutch was pressed, so the tip stood; then it was lifted to the start.
  const auto buttons = recording.read("buttons");
  EXPECT_NE(std::find(buttons.begin(), buttons.end(), 3.0), buttons.end()) << "deadman and clutch";
}

// A session that began without a recording gets one from the key on, whose marks are in it.
TEST_F(ViewerPrograms, ARecordingBeginsInTheWindow) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  std::ofstream(path("session.h5")) << "another's";
  std::ofstream(path("user.sh")) << "cd " << folder_.string() << kPerson << kMaster << " run --server "
                                 << server.address()
                                 << " --view 2>err.txt &\n"
                                    "master=$!\n"
                                    "see 'Telenano: flakes at'; await 'above \"$(time_told)\" 1'\n"
                                    "xdotool key ctrl+r; await '[ -s session-2.h5 ]'\n"
                                    "from=$(time_told); xdotool key m; await 'above \"$(time_told)\" $from'\n"
                                    "xdotool key ctrl+q; wait $master\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out << file_text(path("err.txt"));
  EXPECT_EQ(user.out, "") << file_text(path("err.txt"));
  EXPECT_EQ(file_text(path("session.h5")), "another's") << "no recording is replaced";
  const recording::RecordingReader recording(path("session-2.h5"));
  EXPECT_TRUE(recording.closed());
  EXPECT_EQ(recording.rows_dropped(), 0u);
  const auto time_s = recording.read("time_s");
  ASSERT_GT(time_s.size(), 500u);
  EXPECT_GT(time_s.front(), 1) << "from the key on";
  const auto tick = recording.read("tick");
  EXPECT_EQ(tick.back() - tick.front() + 1, static_cast<double>(tick.size())) << "and no tick is missing";
  int marks = 0;
  for (const recording::Event& event : recording.events())
    marks += std::string(event.text.data()) == "mark" ? 1 : 0;
  EXPECT_EQ(marks, 1);
}

// With nobody at the tip, so that the slave has never stepped; --observe so that nobody gets it.
TEST_F(ViewerPrograms, AnObserverSeesThatASimulationIsOne) {
  Server server(scene_path("flakes"), 0, {"--share", "one-tip"});
  const Finished run =
      run_program(without_display({kMaster, "run", "--server", server.address(), "--observe", "--duration-s",
                                   "2", "--rt-priority", "0", "--screenshot", path("o.png"),
                                   "--screenshot-size", "900x600", "--at", "1", "--record", path("o.h5")}));
  if (run.err.find("no picture without a display") != std::string::npos) GTEST_SKIP() << run.err;
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const viewer::Picture picture = viewer::read_png(path("o.png"));
  const std::uint8_t* const pill = &picture.rgb[static_cast<std::size_t>(3 * (20 * 900 + 14))];
  EXPECT_GT(pill[2], 200) << "SIM is blue, AFM red";
  EXPECT_LT(pill[0], 140);
  // Every tick from the first answer on says so, for the window and for who reads the file.
  const recording::RecordingReader recording(path("o.h5"));
  const auto flags = recording.read("limit_flags");
  const auto answered = recording.read("reply_sequence");
  int told = 0;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (answered[i] == 0) continue;
    ASSERT_NE(static_cast<unsigned>(flags[i]) & recording::kLimitObserves, 0u) << i;
    ++told;
  }
  EXPECT_GT(told, 500);
}

TEST_F(ViewerPrograms, AScanOfAnotherSampleIsNotDrawnInSilence) {
  Server server(scene_path("flakes"));
  const auto draw = [&](const std::string& surface) {
    return run_program(without_display({kMaster, "run", "--server", server.address(), "--task", "position",
                                        "--duration-s", "0.5", "--rt-priority", "0", "--quiet", "--surface",
                                        surface, "--screenshot", path("s.png")}));
  };
  const std::string data = std::string(TELENANO_SOURCE_DIR) + "/deploy/data/";
  const Finished own = draw(kScan);
  if (own.err.find("no picture without a display") != std::string::npos) GTEST_SKIP() << own.err;
  EXPECT_EQ(own.exit_code, 0) << own.err;
  EXPECT_EQ(own.err.find("note: --surface"), std::string::npos) << own.err;
  // By the name of the scene, as a server takes it.
  const Finished named = draw("flakes");
  EXPECT_EQ(named.exit_code, 0) << named.err;
  EXPECT_EQ(named.err.find("note: --surface"), std::string::npos) << named.err;
  std::filesystem::remove(path("s.png"));
  const Finished other = draw(data + "nanoscope_peakforce_1um.gsf");
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("is another scan than the session's: it is 1000 x 1000 nm, and that of the scene "
                           "'flakes' 600 x 600 nm"),
            std::string::npos)
      << other.err;
  EXPECT_EQ(lines_of(other.err).size(), 1u) << other.err;
  EXPECT_FALSE(std::filesystem::exists(path("s.png")));
  // The same size and other heights: the last one, the upper right corner's.
  std::string bytes = file_text(kScan);
  bytes[bytes.size() - 2] = static_cast<char>(bytes[bytes.size() - 2] ^ 0x40);
  std::ofstream(path("like.gsf"), std::ios::binary) << bytes;
  const Finished like = draw(path("like.gsf"));
  EXPECT_EQ(like.exit_code, 0) << like.err;
  EXPECT_NE(like.err.find("not the scan of 'flakes'"), std::string::npos) << like.err;
  server.stop();

  Server flat(scene_path("flat_silicon_oxide"));
  const Finished none = run_program(without_display({kMaster, "run", "--server", flat.address(), "--quiet",
                                                     "--surface", kScan, "--screenshot", path("s.png")}));
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_NE(none.err.find("'flat_silicon_oxide' has no scan"), std::string::npos) << none.err;
}

// A scene that is not here cannot be compared: what shows is a scan that is too small.
TEST_F(ViewerPrograms, AScanOfASceneThatIsNotHereIsComparedByItsReach) {
  std::string scene = file_text(scene_path("flat_silicon_oxide"));
  scene.replace(scene.find("\"flat_silicon_oxide\""), 20, "\"mine\"");
  std::ofstream(path("elsewhere.toml")) << scene;
  Server server(path("elsewhere.toml"));
  const Finished run = run_program(without_display({kMaster, "run", "--server", server.address(), "--quiet",
                                                    "--surface", kScan, "--screenshot", path("s.png")}));
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("it reaches from 0 to 600 nm along x"), std::string::npos) << run.err;
}

// The first second of silence is told in the picture; at the end the window stays, with the cause, until a
// person closes it.
TEST_F(ViewerPrograms, AWindowDoesNotVanishWithTheServer) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << kPerson << kMaster << " run --server " << server.address()
      << " --view --give-up-s 6 --record l.h5 --surface " << kScan
      << " 2>err.txt &\n"
         "master=$!\n"
         "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'\n"
         "kill -9 "
      << server.child().pid()
      << "\n"
         "await 'grep -q \"server silent for\" err.txt'; xdotool key p\n"
         "await 'grep -q \"the window stays\" err.txt'; see 'Telenano: the session has ended'\n"
         "kill -0 $master && echo stays\n"
         "await '[ -s telenano-1.png ]'; press_until p '[ -s telenano-2.png ]'\n"
         "xdotool key ctrl+q\n"
         "wait $master; echo ended with $?\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  EXPECT_NE(user.out.find("stays\nended with 1"), std::string::npos)
      << user.out << file_text(path("err.txt"));
  EXPECT_NE(file_text(path("err.txt")).find("has been silent for 6 s"), std::string::npos);
  EXPECT_TRUE(std::filesystem::exists(path("telenano-2.png")));
  if (const char* folder = std::getenv("TELENANO_LOOK"))
    for (const char* name : {"telenano-1.png", "telenano-2.png"})
      if (std::filesystem::exists(path(name)))
        std::filesystem::copy_file(path(name), std::string(folder) + "/lost_" + name,
                                   std::filesystem::copy_options::overwrite_existing);
  // Nobody need close what was told how long it takes.
  Server again(scene_path("flakes"));
  std::ofstream(path("timed.sh")) << "cd " << folder_.string() << kPerson << kMaster << " run --server "
                                  << again.address()
                                  << " --view --give-up-s 1 --duration-s 60 2>timed.txt &\n"
                                     "master=$!\n"
                                     "see 'Telenano: flakes at'; await 'grep -q ^loop: timed.txt'\n"
                                     "kill -9 "
                                  << again.child().pid() << "; wait $master; echo ended with $?\n";
  const Finished timed = run_program(
      {"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("timed.sh")}, {}, kLong);
  EXPECT_NE(timed.out.find("ended with 1"), std::string::npos) << timed.out << timed.err;
}

// A display that is named but does not answer, with a server that does not either: the display comes first.
// At a terminal the window stays with a summary when the task is done; Enter begins the same session again,
// with a recording of its own. `script` gives a terminal; without one nobody is there to close it.
TEST_F(ViewerPrograms, ADoneTaskLeavesItsSummaryAndBeginsAgain) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool", "/usr/bin/script"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool bsdutils";
  }
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << kPerson << "script -qefc '" << kMaster << " run --server "
      << server.address() << " --task contact --view --record c.h5' typed.txt >/dev/null </dev/null &\n"
      << "await 'grep -q \"summary of\" typed.txt'; see 'Telenano: the session has ended'\n"
      << "press_until p '[ -s telenano-1.png ]'\n"
      << "pgrep -f 'record c.h5' >/dev/null && echo stays\n"
      << "press_until Return '[ -e c-2.h5 ]'\n"
      << "await '[ $(grep -c \"summary of\" typed.txt) = 2 ]'; see 'Telenano: the session has ended'\n"
      << "[ -s c-2.h5 ] && echo again\n"
      << "xdotool key ctrl+q; wait $!; echo ended with $?\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  EXPECT_NE(user.out.find("stays\nagain\nended with 0"), std::string::npos)
      << user.out << user.err << file_text(path("typed.txt"));
  EXPECT_TRUE(recording::RecordingReader(path("c.h5")).closed());
  if (const char* folder = std::getenv("TELENANO_LOOK"))
    std::filesystem::copy_file(path("telenano-1.png"), std::string(folder) + "/done.png",
                               std::filesystem::copy_options::overwrite_existing);
}

// What the station draws and saves is what the server keeps: two programs, two files, one sample. Its own file
// is drawn where it was.
TEST_F(ViewerPrograms, MarksAreSeenAndSavedWhileTheSessionGoesOn) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("lithography"), 0, {"--save-surface", folder_.string()});
  std::ofstream(path("groove.csv"))
      << "t_s,x_nm,y_nm,z_nm\n0,0,0,10\n1,0,0,-4\n3,40,0,-4\n3.5,40,0,10\n120,40,0,10\n";
  // Once the tip is up again and what is drawn changes no more: two files of it are alike, and the sample is not
  // as it was. At the end the window's own picture.
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << kPerson << kMaster << " run --server " << server.address()
      << " --method twin --task script --script groove.csv --view --record groove.h5 2>err.txt &\n"
      << "master=$!\n"
      << "see 'Telenano: lithography at'; await 'above $(time_told) 4'; await '[ -s lithography-1.gsf ]'\n"
      << "for n in $(seq 30); do\n"
         "  rm -f telenano-1.gsf; press_until s '[ -s telenano-1.gsf ]'; cp telenano-1.gsf first.gsf; sleep "
         "0.5\n"
         "  rm -f telenano-1.gsf; press_until s '[ -s telenano-1.gsf ]'; cmp -s telenano-1.gsf first.gsf && "
         "break\n"
         "done\n"
      << "press_until p '[ -s telenano-1.png ]'; xdotool key ctrl+q; wait $master\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out;
  server.stop();
  const surface::Scan kept = surface::read_gsf(path("lithography-1.gsf"));
  const surface::Scan seen = surface::read_gsf(path("telenano-1.gsf"));
  EXPECT_EQ(seen.title, "lithography");
  const surface::HeightGrid own = surface::heights_in_frame_w(kept);
  const surface::HeightGrid drawn = surface::heights_in_frame_w(seen);
  EXPECT_LT(kept.lowest_before_shift_nm, -0.5) << "there is a groove";
  EXPECT_NEAR(drawn.x_first_nm, own.x_first_nm, 1e-9);
  EXPECT_LT(own.x_first_nm, -100) << "about the start, as the scene has it";
  ASSERT_EQ(drawn.z_nm.size(), own.z_nm.size());
  double most_nm = 0;
  for (std::size_t i = 0; i < own.z_nm.size(); ++i)
    most_nm = std::max(most_nm, std::abs(drawn.z_nm[i] - own.z_nm[i]));
  EXPECT_LT(most_nm, 1e-5) << "single precision, twice";
  // The recording has them too, and needs nothing else to show them.
  const recording::RecordingReader reader(path("groove.h5"));
  view_model::MarkedGround marked({}, reader.marks());
  marked.move_to(0.5);
  EXPECT_EQ(marked.heights(), nullptr) << "nothing has been touched yet";
  marked.move_to(1e9);
  ASSERT_NE(marked.heights(), nullptr);
  ASSERT_EQ(marked.heights()->z_nm.size(), own.z_nm.size());
  EXPECT_NEAR(marked.heights()->x_first_nm, own.x_first_nm, 1e-9);
  EXPECT_NEAR(marked.heights()->dy_nm, own.dy_nm, 1e-9);
  most_nm = 0;
  for (std::size_t i = 0; i < own.z_nm.size(); ++i)
    most_nm = std::max(most_nm, std::abs(marked.heights()->z_nm[i] - own.z_nm[i]));
  EXPECT_LT(most_nm, 1e-5);
  const Finished shown = run_program(
      {kMaster, "view", path("groove.h5"), "--screenshot", path("recorded.png"), "--at", "3.4"}, {}, kLong);
  EXPECT_EQ(shown.exit_code, 0) << shown.err;
  if (const char* folder = std::getenv("TELENANO_LOOK"))
    std::filesystem::copy_file(path("recorded.png"), std::string(folder) + "/recorded.png",
                               std::filesystem::copy_options::overwrite_existing);
  if (const char* folder = std::getenv("TELENANO_LOOK"))
    std::filesystem::copy_file(path("telenano-1.png"), std::string(folder) + "/groove.png",
                               std::filesystem::copy_options::overwrite_existing);
}

// 192 dots an inch, as a desktop says it: twice the pixels, and as large to the eye.
TEST_F(ViewerPrograms, AWindowOnADenseScreenHasTwiceThePixels) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool", "/usr/bin/xrdb"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool x11-xserver-utils";
  }
  Server server(scene_path("flakes"));
  const auto size_at = [&](int dpi, const std::string& screen) {
    const std::string folder = path(std::to_string(dpi) + screen.substr(0, 4));
    std::filesystem::create_directory(folder);
    std::ofstream(folder + "/user.sh")
        << "cd " << folder << kPerson << "echo 'Xft.dpi: " << dpi << "' | xrdb -merge -nocpp\n"
        << kMaster << " run --server " << server.address() << " --task contact --view --quiet &\n"
        << "see 'Telenano: flakes at'; press_until p '[ -s telenano-1.png ]'\n"
        << "xdotool key ctrl+q; wait $!\n";
    const Finished user =
        run_program({"/usr/bin/xvfb-run", "-a", "-s", "-noreset -screen 0 " + screen + "x24", "/bin/bash",
                     folder + "/user.sh"},
                    {}, 4 * kLong);
    const std::string png = file_text(folder + "/telenano-1.png");
    EXPECT_GT(png.size(), 24u) << user.out << user.err;
    if (const char* look = std::getenv("TELENANO_LOOK"))
      std::filesystem::copy_file(folder + "/telenano-1.png",
                                 std::string(look) + "/dpi" + std::to_string(dpi) + screen + ".png",
                                 std::filesystem::copy_options::overwrite_existing);
    // Width and height stand behind the first chunk's name (ISO/IEC 15948), most significant byte first.
    const auto number = [&](std::size_t at) {
      int value = 0;
      for (std::size_t i = at; i < at + 4 && i < png.size(); ++i)
        value = 256 * value + static_cast<unsigned char>(png[i]);
      return value;
    };
    return std::pair{number(16), number(20)};
  };
  EXPECT_EQ(size_at(96, "3840x2160"), (std::pair{1280, 800}));
  EXPECT_EQ(size_at(192, "3840x2160"), (std::pair{2560, 1600}));
  // And no larger than the screen.
  EXPECT_EQ(size_at(192, "1920x1080"), (std::pair{1920, 1080}));
}

TEST_F(ViewerPrograms, ABadDisplayIsSaidBeforeAServerIsAsked) {
  const std::vector<std::vector<std::string>> ways = {{"--view"}, {"--device", "mouse"}};
  for (const auto& flags : ways) {
    std::vector<std::string> command = {"/usr/bin/env", "-u",  "WAYLAND_DISPLAY", "DISPLAY=:977",
                                        kMaster,        "run", "--server",        "127.0.0.1:9"};
    command.insert(command.end(), flags.begin(), flags.end());
    const Finished run = run_program(command);
    EXPECT_EQ(run.exit_code, 2) << run.err;
    EXPECT_NE(run.err.find("no window can be opened"), std::string::npos) << run.err;
    EXPECT_NE(run.err.find(":977"), std::string::npos) << run.err;
    EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
  }
}

TEST_F(ViewerPrograms, WhatCannotBeShownIsSaidBeforeAServerIsAsked) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--view"}, "there is no display"},
      {{"--device", "mouse"}, "there is no display"},
      {{"--device", "mouse", "--screenshot", path("b.png")}, "needs the window"},
      {{"--screenshot", path("none/b.png")}, "is no folder"},
      {{"--screenshot", path("b.png"), "--screenshot-size", "big"}, "expected WIDTHxHEIGHT"},
      {{"--screenshot", path("b.png"), "--screenshot-size", "10x10"}, "expected WIDTHxHEIGHT"},
      {{"--screenshot", path("b.png"), "--surface", path("none.gsf")}, "none.gsf"},
      {{"--screenshot", path("b.png"), "--surface", "nothing"}, "no supplied scene or scan has this name"},
      {{"--screenshot", path("b.png"), "--surface", "flat_pdms"}, "this scene has no scan"},
      {{"--screenshot", path("b.png"), "--at", "nan"}, "finite"},
      {{"--screenshot", path("b.png"), "--tip-radius-nm", "0"}, "tip-radius-nm"},
      {{"--at", "3"}, "--screenshot"},
      {{"--view", "--screenshot", path("b.png")}, "--view"},
  };
  for (const auto& [flags, words] : cases) {
    const Finished run = refused(flags);
    EXPECT_EQ(run.exit_code, 2) << words << ": " << run.err;
    EXPECT_NE(run.err.find(words), std::string::npos) << run.err;
    EXPECT_EQ(run.out, "");
  }
  EXPECT_FALSE(std::filesystem::exists(path("b.png")));
}

// From the start screen into a session, out of it, and into the next one, by keyboard alone.
TEST_F(ViewerPrograms, ASessionIsChosenBegunAndBegunAgain) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_STATE_HOME=" << folder_.string() << "/state" << kPerson
      << kMaster << " start --server " << server.address()
      << " 2>err.txt &\n"
         "start=$!\n"
         "see 'Telenano: start, sim at .*, answered'\n"
         // From Start up to the recording's box.
         "xdotool key Up key space; see 'Telenano: start, sim, recording'; xdotool key Return\n"
         "see 'Telenano: flakes at'; await 'grep -q \" mJ \" err.txt'; press_until ctrl+q 'grep -q "
         "stopped.by.the.operator err.txt'\n"
         "see 'Telenano: start'; xdotool key Return\n"
         "see 'Telenano: flakes at'; await '[ -s session-2.h5 ]'; await '[ $(grep -c ^loop: err.txt) = 2 ]'\n"
         "told=$(grep -c ' mJ ' err.txt); await '[ $(grep -c \" mJ \" err.txt) -gt $told ]'\n"
         "kill $start; wait $start; echo ended with $?\n";
  const Finished user = run_program(
      {"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")}, {}, kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out;
  EXPECT_EQ(user.out, "ended with 0\n") << file_text(path("err.txt"));
  EXPECT_EQ(file_text(path("state/telenano/servers")), server.address() + "\t\tflakes\n");
  for (const char* name : {"session.h5", "session-2.h5"}) {
    const recording::RecordingReader recording(path(name));
    EXPECT_TRUE(recording.closed()) << name << " of a session that the end of start ends too";
    EXPECT_GT(recording.rows(), 100u) << name;
  }
}

// Another sample is another server: the list of those seen lately says which has which, and a choice of it and
// Enter begin the next session there.
TEST_F(ViewerPrograms, AnotherSceneIsChosenOnTheStartScreen) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server flakes(scene_path("flakes"));
  Server flat(scene_path("flat_silicon_oxide"));
  std::filesystem::create_directories(path("state/telenano"));
  std::ofstream(path("state/telenano/servers")) << flat.address() << "\t\tflat_silicon_oxide\n";
  // The list stands above the hands: the first row from the top that makes the server another one. A row in
  // small steps, since the summary of the session before stands over it.
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_STATE_HOME=" << folder_.string() << "/state" << kPerson
      << "choose() { for y in $(seq 60 6 500); do xdotool search --name \"start, .* at $1\" >/dev/null && "
         "return\n"
         "xdotool mousemove 420 $y click 1; sleep 0.2; done; echo \"no: $1\"; }\n"
      << kMaster << " start --server " << flakes.address() << " 2>err.txt &\n"
      << "start=$!\n"
         "see 'Telenano: start, sim at .*, answered'; xdotool key Return\n"
         "see 'Telenano: flakes at'; await 'grep -q \" mJ \" err.txt'; press_until ctrl+q 'grep -q "
         "stopped.by.the.operator err.txt'\n"
         "see 'Telenano: start'; choose "
      << flat.address()
      << "\n"
         "see 'Telenano: start, .*, answered'; xdotool key Return; see 'Telenano: flat_silicon_oxide at'\n"
         "await '[ $(grep -c ^loop: err.txt) = 2 ]'; kill $start; wait $start; echo ended with $?\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  EXPECT_EQ(user.out, "ended with 0\n") << user.err << file_text(path("err.txt"));
  // Newest first.
  EXPECT_EQ(file_text(path("state/telenano/servers")),
            flat.address() + "\t\tflat_silicon_oxide\n" + flakes.address() + "\t\tflakes\n");
}

// Over a round trip of 20 ms, where nothing was kept: the window is open and has the server's own surface
// before the twin of it is ready, which takes seconds. The bound in seconds is loose, for a busy machine.
TEST_F(ViewerPrograms, TheSampleIsSeenBeforeItsTwinIsReady) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  ChildProcess relay(
      {kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--delay-ms", "10"});
  const std::string before_port = "relay on 127.0.0.1:";
  ASSERT_TRUE(relay.wait_for_err(before_port, kLong) && relay.wait_for_err("\n", kLong)) << relay.err();
  const std::string said = relay.err();
  const int relayed = std::atoi(said.c_str() + said.find(before_port) + before_port.size());
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_CACHE_HOME=" << folder_.string() << "/cache" << kPerson
      << kMaster << " run --server 127.0.0.1:" << relayed << " --method twin --view 2>err.txt &\n"
      << "master=$!\n"
         "see 'Telenano: getting ready, the sample is drawn'; grep -c ^loop: err.txt\n"
         "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'; press_until ctrl+q '! kill -0 $master "
         "2>/dev/null'\n"
         "wait $master; echo ended with $?\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  const std::string told = file_text(path("err.txt"));
  EXPECT_EQ(user.out, "0\nended with 0\n") << user.err << told;
  const std::string before = "the sample seen after ";
  const auto at = told.find(before);
  ASSERT_NE(at, std::string::npos) << told;
  EXPECT_LT(std::strtod(told.c_str() + at + before.size(), nullptr), 10) << told;
  relay.signal(SIGTERM);
}

// While it gets ready, as later.
TEST_F(ViewerPrograms, AWindowThatGetsReadyCanBeLeft) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_CACHE_HOME=" << folder_.string() << "/cache" << kPerson
      << kMaster << " run --server " << server.address() << " --method twin --view 2>err.txt &\n"
      << "master=$!\n"
         "see 'Telenano: getting ready'; press_until ctrl+q '! kill -0 $master 2>/dev/null'\n"
         "wait $master; echo ended with $?\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  EXPECT_EQ(user.out, "ended with 0\n") << user.err << file_text(path("err.txt"));
  EXPECT_NE(file_text(path("err.txt")).find("stopped by the operator"), std::string::npos);
}

// Who has never been here: the window opens, two clicks choose and begin (the server answers by itself), and
// one drag down and up ends with a pull-off. Eight clicks are allowed: where the machine is so busy that the server
// has withdrawn the tip before the session began, the mouse takes hold more than once, as the window says.
TEST_F(ViewerPrograms, FromTheOpenedWindowToAPullOffInFewClicks) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool"}) {
    if (!std::filesystem::exists(program))
      GTEST_SKIP() << "no " << program << ": apt-get install xvfb xauth xdotool";
  }
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_STATE_HOME=" << folder_.string() << "/state" << kPerson
      << "click() { xdotool mousemove $1 $2 click 1; echo click; }\n"
      << kMaster << " start --server " << server.address()
      << " 2>err.txt &\n"
         "start=$!\n"
         "see 'Telenano: start, sim at .*, answered'\n"
         // A recording to look into, by key, since where its box stands depends on the devices that are here.
         "xdotool key Up key space; see 'Telenano: start, sim, recording'\n"
         // The mouse as hand; Start.
         "click 323 170; see 'Telenano: start, mouse'\n"
         // As a person does: again, where nothing has come of it for a quarter of a minute.
         "for n in 1 2 3; do click 300 764; for i in $(seq 60); do\n"
         "xdotool search --name 'Telenano: start' >/dev/null || break 2; sleep 0.25; done; done\n"
         "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'\n"
         "lead 'above \"$(told force)\" 1' 150 4\n"
         "press_until p '[ -s telenano-1.png ]'\n"
         "lead 'above \"$(told tip)\" 5 || ! drag 5 -4' 580 -4 held\n"
         "press_until p '[ -s telenano-2.png ]'\n"
         "xdotool mouseup 1 key n; see 'Telenano: .*, writing a note'\n"
         "xdotool type --delay 60 'it held on; lets go'; xdotool key Return\n"
         "press_until ctrl+q 'grep -q stopped.by.the.operator err.txt'\n"
         "kill $start; wait $start; echo ended with $?\n";
  const Finished user =
      run_program({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")},
                  {}, 4 * kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out << file_text(path("err.txt"));
  const std::vector<std::string> lines = lines_of(user.out);
  const auto clicks = std::count(lines.begin(), lines.end(), "click");
  EXPECT_GE(clicks, 3);
  EXPECT_LE(clicks, 8) << user.out << file_text(path("err.txt"));
  ASSERT_EQ(lines.size(), static_cast<std::size_t>(clicks) + 1) << user.out << file_text(path("err.txt"));
  EXPECT_EQ(lines.back(), "ended with 0") << file_text(path("err.txt"));
  // By the summary the tip was in contact and held on; by the rows it then came free.
  const std::string told = file_text(path("err.txt"));
  EXPECT_EQ(told.find("pull-off force                       0.00"), std::string::npos) << told;
  const recording::RecordingReader recording(path("session.h5"));
  std::string notes;
  for (const recording::Event& event : recording.events()) {
    const std::string text(event.text.data());
    if (text.starts_with("note: ")) notes += text + "|";
  }
  EXPECT_EQ(notes, "note: it held on; lets go|");
  const auto contact = recording.read("contact_state");
  const auto force = recording.read("force_w_nn", 2);
  const auto touched = std::find(contact.rbegin(), contact.rend(), 3.0);
  ASSERT_NE(touched, contact.rend()) << "no contact";
  const auto left = static_cast<std::size_t>(touched.base() - contact.begin());
  EXPECT_LT(left, contact.size()) << "never let go";
  EXPECT_LT(*std::min_element(force.begin(), force.begin() + static_cast<std::ptrdiff_t>(left)), -5);
  if (const char* look = std::getenv("TELENANO_LOOK")) {
    for (const char* name : {"telenano-1.png", "telenano-2.png"})
      std::filesystem::copy_file(path(name), std::string(look) + "/" + name,
                                 std::filesystem::copy_options::overwrite_existing);
  }
}

TEST_F(ViewerPrograms, AStartWithoutADisplayIsRefused) {
  const Finished refused = run_program(without_display({kMaster, "start"}));
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("there is no display"), std::string::npos) << refused.err;
  EXPECT_EQ(lines_of(refused.err).size(), 1u) << refused.err;
}

}  // namespace
}  // namespace telenano::programs
