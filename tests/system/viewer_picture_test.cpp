// What is drawn without a person: screenshots, recordings, scans that do not fit; and what is refused.
#include "tests/system/viewer_programs.h"

namespace telenano::programs {
namespace {

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
  EXPECT_NE(
      other.err.find(
          "is not the session's scan: it is 1000 x 1000 nm, and the scan of scene 'flakes' is 600 x 600 nm"),
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

// A display that is named but does not answer, with a server that does not either: the display comes first.
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
      {{"--screenshot", path("none/b.png")}, "is not a folder"},
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

}  // namespace
}  // namespace telenano::programs
