// The station's picture with the real programs: without a display, in a window under Xvfb, and what is
// refused.
#include <cmath>

#include "common/recording/recording_reader.h"
#include "master/viewer/png.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

const std::string kScan = std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf";

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
  EXPECT_GT(at(880, 20)[0], 180);
  EXPECT_LT(at(880, 20)[1], 120);
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

TEST_F(ViewerPrograms, WhatCannotBeShownIsSaidBeforeAServerIsAsked) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--view"}, "there is no display"},
      {{"--device", "mouse"}, "there is no display"},
      {{"--device", "mouse", "--screenshot", path("b.png")}, "needs the window"},
      {{"--screenshot", path("none/b.png")}, "is no folder"},
      {{"--screenshot", path("b.png"), "--screenshot-size", "big"}, "expected WIDTHxHEIGHT"},
      {{"--screenshot", path("b.png"), "--screenshot-size", "10x10"}, "expected WIDTHxHEIGHT"},
      {{"--screenshot", path("b.png"), "--surface", path("none.gsf")}, "none.gsf"},
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
