#include <gtest/gtest.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/studies/report/curve_data.h"
#include "tests/studies/report/decimate.h"
#include "tests/studies/report/page.h"
#include "tests/studies/report/report_command.h"
#include "tests/studies/report/run_data.h"
#include "tests/studies/report/synthetic_run.h"

namespace telenano::studies {
namespace {

std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

class ReportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const char* kept = std::getenv("TELENANO_KEEP_REPORT");  // a folder to look at afterwards
    keep_ = kept != nullptr;
    folder_ =
        keep_ ? std::filesystem::path(kept)
              : std::filesystem::temp_directory_path() / ("telenano_report_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override {
    if (!keep_) std::filesystem::remove_all(folder_);
  }
  bool keep_ = false;
  std::filesystem::path folder_;
};

TEST(Decimate, KeepsEveryExtremeOfItsStretchAndBothEnds) {
  std::vector<double> x;
  std::vector<double> y;
  for (int i = 0; i < 100'000; ++i) {
    x.push_back(i);
    y.push_back(std::sin(1e-3 * i));
  }
  y[55'555] = 40;  // a spike of one sample must not be lost
  y[77'777] = -40;
  y[10] = std::nan("");
  const std::vector<Point> points = decimate(x, y, 100);
  EXPECT_LE(points.size(), 202u);
  EXPECT_EQ(points.front().x, 0);
  EXPECT_EQ(points.back().x, 99'999);
  bool high = false;
  bool low = false;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i > 0) {
      EXPECT_LE(points[i - 1].x, points[i].x);
    }
    high = high || points[i].y == 40;
    low = low || points[i].y == -40;
    EXPECT_TRUE(std::isfinite(points[i].y));
  }
  EXPECT_TRUE(high && low);
  EXPECT_EQ(decimate({1, 2, 3}, {4, 5, 6}, 100).size(), 3u) << "short series stay whole";
}

TEST_F(ReportTest, SummaryGivesTheKnownAnswers) {
  SyntheticRun synthetic;
  synthetic.write(folder_ / "a.h5");
  const recording::Summary s = recording::summarise(recording::RecordingReader(folder_ / "a.h5"));
  EXPECT_EQ(s.rows, 8000u);
  EXPECT_NEAR(s.duration_s, 7.999, 1e-9);
  // The way back ends at +2 nm with the whole adhesion; the last tick before is at most 12 nm/s * 1 ms below.
  EXPECT_NEAR(s.pull_off_force_nn, SyntheticRun::kAdhesionNn, 0.06);
  const double deepest_force =
      SyntheticRun::kStiffness * (SyntheticRun::kDepthNm + 2) - SyntheticRun::kAdhesionNn;
  EXPECT_NEAR(s.peak_repulsion_nn, deepest_force, 1e-4);
  // Depth of the apex: 3 nm less what the cantilever gives, 0.02 nm/nN.
  EXPECT_NEAR(s.greatest_depth_nm, SyntheticRun::kDepthNm - 0.02 * deepest_force, 1e-4);
  EXPECT_NEAR(s.peak_hand_force_n, 0.1 * std::max(deepest_force, s.pull_off_force_nn), 1e-4);
  // Median of the lognormal; five standard errors of 1.25 * 0.25 / sqrt(8000) and a histogram bin of 1/16.
  EXPECT_NEAR(s.rtt_us.p50, 80, 1.4 + 80.0 / 16);
  EXPECT_GT(s.rtt_us.p99, s.rtt_us.p50);
  EXPECT_EQ(s.lost, 7);
  EXPECT_EQ(s.replies, 8000);
  EXPECT_NEAR(s.controller_duty, s.contact_fraction / 4, 1e-3);
  EXPECT_EQ(s.clamp_duty, 0);
  EXPECT_EQ(s.missed_ticks, 0);
  EXPECT_NEAR(s.slave_energy_net_aj, 40, 1e-9);
  EXPECT_NE(recording::summary_text(s).find("pull-off force"), std::string::npos);
}

TEST(Pieces, AreCutAtHolesAndAtWhatIsNotANumber) {
  std::vector<double> x;
  std::vector<double> y;
  for (int i = 0; i < 1000; ++i) {
    x.push_back(i < 400 ? i : i + 50);
    y.push_back(i == 700 ? std::nan("") : i);
  }
  EXPECT_EQ(hole_of(x), 10);
  const auto pieces = decimate_pieces(x, y, 1000, hole_of(x));
  ASSERT_EQ(pieces.size(), 3u);
  EXPECT_EQ(pieces[0].size(), 400u);
  EXPECT_EQ(pieces[1].size(), 300u);
  EXPECT_EQ(pieces[2].size(), 299u);
  EXPECT_EQ(pieces[1].front().x, 450);
}

TEST_F(ReportTest, ReadsAForceCurveAndFindsItsJumps) {
  const std::filesystem::path file = folder_ / "curve=1.csv";
  const auto write = [&](const std::string& rows) {
    std::ofstream(file) << "direction,base_z_nm,tip_z_nm,overlap_nm,force_nn,deflection_nm,branch,work_aj\n"
                        << rows;
  };
  std::string rows;
  const auto row = [&](const char* way, double z, double force, double work) {
    rows += std::string(way) + "," + std::to_string(z) + ",0,0," + std::to_string(force) + ",0,vdw," +
            std::to_string(work) + "\n";
  };
  // In contact 10 nN/nm below 1 nm; in at 0 nm with -10 nN, out at 0.8 nm with -18 nN, resolved to 0.1 nm.
  for (int i = 50; i >= -20; --i) row("approach", 0.1 * i, i > 0 ? -0.001 * (50 - i) : -10 - i, 0);
  for (int i = -20; i <= 50; ++i) row("retract", 0.1 * i, i > 8 ? -0.01 : -10 - i, 0.2 * (i + 20));
  write(rows);
  const CurveData data = load_curve(file);
  ASSERT_TRUE(data.snaps_in && data.lets_go);
  EXPECT_EQ(data.approach.jumps.size(), 1u);
  EXPECT_NEAR(data.snap_in_base_nm, 0.1, 1e-9);
  EXPECT_EQ(data.retract.jumps.size(), 1u);
  EXPECT_NEAR(data.pull_off_base_nm, 0.8, 1e-9);
  EXPECT_NEAR(data.pull_off_force_nn, 18, 1e-9);
  EXPECT_NEAR(data.loop_work_aj, 14, 1e-9);

  const auto message = [&](const std::string& text) -> std::string {
    write(text);
    try {
      load_curve(file);
    } catch (const UserError& error) {
      return error.what();
    }
    return "no UserError";
  };
  EXPECT_NE(message("approach,1,0,0,nan,0,vdw,0\n").find(":2: force_nn 'nan'"), std::string::npos);
  EXPECT_NE(message("approach,1,0\n").find("8 fields"), std::string::npos);
  EXPECT_NE(message("down,1,0,0,1,0,vdw,0\n").find("direction 'down'"), std::string::npos);
  EXPECT_NE(message("approach,1,0,0,1,0,vdw,0\n").find("both directions"), std::string::npos);
}

TEST_F(ReportTest, WritesOnePageWithEveryFigureInside) {
  SyntheticRun{}.write(folder_ / "a.h5");
  SyntheticRun{.duration_s = 4, .shaken = true}.write(folder_ / "shaken.h5");
  SyntheticRun{.duration_s = 4}.write(folder_ / "calm.h5");
  // Split at the first '=': a path may hold one.
  std::filesystem::create_directories(folder_ / "x=y");
  std::filesystem::copy_file(folder_ / "calm.h5", folder_ / "x=y" / "calm.h5",
                             std::filesystem::copy_options::overwrite_existing);
  CLI::App app;
  add_report_command(app);
  app.parse("report --title 'Tip & <sample>' --out " + (folder_ / "out").string() + " --run indent=" +
            (folder_ / "a.h5").string() + " --run \"it's again=" + (folder_ / "calm.h5").string() +
            "\" --pair \"none: (a), as it is=" + (folder_ / "shaken.h5").string() +
            "\" --pair \"ks=" + (folder_ / "shaken.h5").string() +
            "\" --pair \"with ks-clamp=" + (folder_ / "x=y" / "calm.h5").string() + "\"");
  const std::string page = slurp(folder_ / "out" / "index.html");
  EXPECT_NE(page.find("<title>Tip &amp; &lt;sample&gt;</title>"), std::string::npos);
  EXPECT_NE(page.find("&lt;a scene &amp; its comment&gt;"), std::string::npos);
  EXPECT_NE(page.find("pull-off force"), std::string::npos);
  EXPECT_NE(page.find("What was run"), std::string::npos);
  EXPECT_NE(page.find("<th>rate</th><td>1000 Hz</td>"), std::string::npos);
  EXPECT_NE(page.find("none: (a), as it is"), std::string::npos);
  for (const char* file : {"time_indent.tip_force_nn.csv", "distance_indent.tip_height_nm_approach.csv",
                           "energy_indent.energy_mj.csv", "round_trips.indent.csv"}) {
    EXPECT_GT(std::filesystem::file_size(folder_ / "out" / "data" / file), 100u) << file;
  }
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0)
    GTEST_SKIP() << "no gnuplot: no figures to look at";
  std::size_t figures = 0;
  for (std::size_t at = page.find("<svg"); at != std::string::npos; at = page.find("<svg", at + 1)) ++figures;
  EXPECT_EQ(figures, 8u);  // three for each of two runs, the pair, the round trips
  for (const auto& entry : std::filesystem::directory_iterator(folder_ / "out" / "data")) {
    if (entry.path().extension() == ".svg") {
      EXPECT_LT(entry.file_size(), 300'000u) << entry.path();
      EXPECT_GT(entry.file_size(), 4'000u) << entry.path();
    }
  }
  for (const char* outside : {"<img", "<script", "http://fonts", "url("}) {
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
  }
}

TEST_F(ReportTest, WithoutGnuplotThereIsAPageAndItSaysWhy) {
  SyntheticRun{.duration_s = 1}.write(folder_ / "a.h5");
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", folder_.c_str(), 1);
  const std::string text =
      make_report({.out = folder_ / "bare", .runs = {{"a", folder_ / "a.h5"}}, .pair = {}});
  ::setenv("PATH", path.c_str(), 1);
  EXPECT_NE(text.find("pull-off force"), std::string::npos);
  const std::string page = slurp(folder_ / "bare" / "index.html");
  EXPECT_NE(page.find("gnuplot is not installed"), std::string::npos);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "bare" / "data" / "time_a.tip_force_nn.csv"));
}

TEST_F(ReportTest, WrongInputIsOneClearLine) {
  const auto message_of = [](const ReportRequest& request) -> std::string {
    try {
      make_report(request);
    } catch (const UserError& error) {
      return error.what();
    }
    return "no UserError";
  };
  EXPECT_NE(message_of({}).find("--run LABEL=FILE"), std::string::npos);
  EXPECT_NE(message_of({.out = folder_, .runs = {}, .pair = {{"a", "a.h5"}}}).find("two or three times"),
            std::string::npos);
  EXPECT_NE(message_of({.out = folder_, .runs = {{"a", folder_ / "no.h5"}}, .pair = {}}).find("no such file"),
            std::string::npos);
  recording::Recorder({.path = folder_ / "empty.h5", .overwrite = true}, {}).close();
  EXPECT_NE(
      message_of({.out = folder_, .runs = {{"a", folder_ / "empty.h5"}}, .pair = {}}).find("holds no row"),
      std::string::npos);
  CLI::App app;
  add_report_command(app);
  EXPECT_THROW(app.parse("report --run file.h5"), UserError);
}

}  // namespace
}  // namespace telenano::studies
