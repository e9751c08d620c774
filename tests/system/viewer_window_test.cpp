// A person at the window of a session, under Xvfb: mouse, keys, tasks, recordings, marks, the end.
#include "telenano/common/surface/gsf.h"
#include "telenano/master/view_model/marked_ground.h"
#include "tests/system/viewer_programs.h"

namespace telenano::programs {
namespace {

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

// With the loop's own priority where this user may have it: else drawing gives way, on a busy machine for
// seconds. A new user's first minute: a window, a drag down until the tip touches, a picture, marks; by keys
// and mouse as a person would press them.
TEST_F(ViewerPrograms, ANewUserTouchesTheSampleWithTheMouse) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
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
  const Finished user = before_a_screen(4 * kLong);
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
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
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
  const Finished user = before_a_screen(4 * kLong);
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

// A click in the list of the server's samples, while the tip presses: the session goes on at the other one, in the same
// program and window, with the energy account as it was; and back by a second click.
TEST_F(ViewerPrograms, AnotherSampleIsChosenInTheListAndTheSessionGoesOnThere) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"), 0,
                {"--scene", scene_path("flat_pdms"), "--scene", scene_path("flat_silicon_oxide")});
  // The list is the row above the buttons at the panel's foot; it opens upwards, a line of what it does and then its
  // names in the server's order, without the one that is here.
  std::ofstream(path("user.sh")) << "cd " << folder_.string() << kPerson << R"sh(
# In the loop of this number, of one sample each, the tip has pressed.
touches() {
  awk -v n=$1 '/^loop:/{++k} k == n && / nN .* mJ /{for (i = 1; i < NF; ++i) if ($i == "force" && $(i + 1) > 1) found = 1}
               END {exit !found}' err.txt
}
)sh" << kMaster << " run --server "
                                 << server.address()
                                 << " --view --record s.h5 2>err.txt &\n"
                                    "master=$!\n"
                                    "see 'Telenano: flakes at'; await 'touches 1'\n"
                                    "xdotool mousemove 1115 732 click 1; sleep 2\n"
                                    "xdotool mousemove 1050 705 click 1\n"
                                    "see 'Telenano: flat_silicon_oxide at'; await 'touches 2'\n"
                                    "xdotool mousemove 1115 732 click 1; sleep 2\n"
                                    "xdotool mousemove 1050 685 click 1\n"
                                    "see 'Telenano: flakes at'; await 'touches 3'\n"
                                    "kill -0 $master && xdotool key ctrl+q; wait $master\n";
  const Finished user = before_a_screen(4 * kLong);
  const std::string said = file_text(path("err.txt"));
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out << said;
  EXPECT_EQ(user.out, "") << said;
  EXPECT_NE(said.find("sample 'flat_silicon_oxide'\nsummary of"), std::string::npos) << said;
  // A recording is of one sample; each goes on with the energies of the one before.
  double in_j = 0;
  double out_j = 0;
  for (const std::string name : {"s.h5", "s-2.h5", "s-3.h5"}) {
    SCOPED_TRACE(name);
    const recording::RecordingReader recording(path(name));
    EXPECT_TRUE(recording.closed());
    EXPECT_EQ(recording.configuration("scene_name"), name == "s-2.h5" ? "flat_silicon_oxide" : "flakes");
    const auto in = recording.read("energy_in_j");
    const auto out = recording.read("energy_out_j");
    const auto force = recording.read("hand_force_applied_h_n", 2);
    ASSERT_GT(in.size(), 500u);
    EXPECT_DOUBLE_EQ(in.front(), in_j) << "not begun anew";
    EXPECT_DOUBLE_EQ(out.front(), out_j);
    EXPECT_LT(std::abs(force.front()), 0.01) << "by the ramp";
    EXPECT_EQ(force.back(), 0) << "let go before";
    in_j = in.back();
    out_j = out.back();
    EXPECT_GT(in_j, 0) << "something was felt, or this shows nothing";
    double step_n = 0;
    for (std::size_t i = 1; i < force.size(); ++i)
      step_n = std::max(step_n, std::abs(force[i]) - std::abs(force[i - 1]));
    EXPECT_LT(step_n, 4) << "the slew limit";
    constexpr std::uint32_t kVelocityTrip = 2, kLeap = 4, kOtherScene = 1024;
    std::uint32_t faults = 0;
    for (const double now : recording.read("station_faults")) faults |= static_cast<std::uint32_t>(now);
    EXPECT_EQ(faults & (kVelocityTrip | kLeap | kOtherScene), 0u);
  }
  const Finished replay = run_program({kLab, "replay", path("s-2.h5")});
  EXPECT_EQ(replay.exit_code, 2) << replay.err;
  EXPECT_NE(replay.err.find("the sample 'flakes' before"), std::string::npos) << replay.err;
}

// A session that began without a recording gets one from the key on, whose marks are in it.
TEST_F(ViewerPrograms, ARecordingBeginsInTheWindow) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
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
  const Finished user = before_a_screen(4 * kLong);
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

// The folder goes while the session runs: no picture, data, surface or recording can be written there. The session goes on,
// and ends as it should.
TEST_F(ViewerPrograms, AFolderThatCannotBeWrittenEndsNoSession) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << kPerson << "mkdir gone && cd gone\n"
      << kMaster << " run --server " << server.address()
      << " --view 2>../err.txt &\n"
         "master=$!\n"
         "see 'Telenano: flakes at'; cd ..; await 'above \"$(time_told)\" 1'; rmdir gone\n"
         "for key in p d s ctrl+r; do xdotool key $key; sleep 0.5; done\n"
         "from=$(time_told); await 'above \"$(time_told)\" $from'; echo goes on\n"
         "xdotool key ctrl+q; wait $master; echo ended with $?\n";
  const Finished user = before_a_screen(4 * kLong);
  EXPECT_EQ(user.out, "goes on\nended with 0\n") << user.err << file_text(path("err.txt"));
}

// A disk that is full, by a limit of what a file may have: the recording is closed where it was, a line says so, and the
// session goes on; what is asked of the recording then is not said to be in it.
TEST_F(ViewerPrograms, ARecordingThatFailsIsToldAndTheSessionGoesOn) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh")) << "cd " << folder_.string() << kPerson << "ulimit -f 1500\n"
                                 << kMaster << " run --server " << server.address()
                                 << " --view --record full.h5 2>err.txt &\n"
                                    "master=$!\n"
                                    "see 'Telenano: flakes at'; await 'grep -q the.session.goes.on err.txt'\n"
                                    "press_until p '[ -s telenano-1.png ]'\n"
                                    "xdotool key m; xdotool key n\n"
                                    "from=$(time_told); await 'above \"$(time_told)\" $from'; echo goes on\n"
                                    "xdotool key ctrl+q; wait $master; echo ended with $?\n";
  const Finished user = before_a_screen(4 * kLong);
  const std::string said = file_text(path("err.txt"));
  EXPECT_EQ(user.out, "goes on\nended with 1\n") << user.err << said;
  EXPECT_NE(said.find("warning: full.h5: "), std::string::npos) << said;
  const recording::RecordingReader recording(path("full.h5"));
  EXPECT_FALSE(recording.closed());
  EXPECT_GT(recording.rows(), 100u) << "up to the last time that all was written";
  if (const char* look = std::getenv("TELENANO_LOOK"))
    std::filesystem::copy_file(path("telenano-1.png"), std::string(look) + "/recording_failed.png",
                               std::filesystem::copy_options::overwrite_existing);
}

// The first second of silence is told in the picture; at the end the window stays, with the cause, until a
// person closes it.
TEST_F(ViewerPrograms, AWindowDoesNotVanishWithTheServer) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
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
  const Finished user = before_a_screen(4 * kLong);
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
  const Finished timed = before_a_screen(kLong, "timed.sh");
  EXPECT_NE(timed.out.find("ended with 1"), std::string::npos) << timed.out << timed.err;
}

// At a terminal the window stays with a summary when the task is done; Enter begins the same session again,
// with a recording of its own. `script` gives a terminal; without one nobody is there to close it.
TEST_F(ViewerPrograms, ADoneTaskLeavesItsSummaryAndBeginsAgain) {
  if (const std::string no = missing({"/usr/bin/script"}); !no.empty()) GTEST_SKIP() << no;
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
  const Finished user = before_a_screen(4 * kLong);
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
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
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
  const Finished user = before_a_screen(4 * kLong);
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
  if (const std::string no = missing({"/usr/bin/xrdb"}); !no.empty()) GTEST_SKIP() << no;
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
        before_a_screen(4 * kLong, folder + "/user.sh", "-noreset -screen 0 " + screen + "x24");
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

}  // namespace
}  // namespace telenano::programs
