// telenano-nve trace: the example of deploy/ from its path to the surface on disk, and what it refuses.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "telenano/common/surface/gsf.h"
#include "tests/source_dir.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

class TraceTest : public ProgramsTest {
 protected:
  const std::string scene_ = scene_path("lithography");
  const std::string example_ = std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/lithography_path.csv";

  static Finished trace(const std::string& scene, const std::string& path,
                        const std::vector<std::string>& more = {}) {
    std::vector<std::string> command{kNve, "trace", "--scene", scene, "--path", path};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command, {}, kLong);
  }

  /// One line on standard error that has all of `words`, no result, and the exit code of a mistake.
  static void expect_refused(const Finished& run, const std::vector<std::string>& words) {
    EXPECT_EQ(run.exit_code, 2) << run.err;
    EXPECT_EQ(run.out, "");
    // Besides what a server says while it makes the fields of a ground that it sees first.
    const auto lines = lines_of(run.err);
    EXPECT_EQ(std::count_if(lines.begin(), lines.end(),
                            [](const std::string& line) {
                              return line.find("fields of the surface") == std::string::npos;
                            }),
              1)
        << run.err;
    for (const std::string& word : words) {
      EXPECT_NE(run.err.find(word), std::string::npos) << word << " in: " << run.err;
    }
  }

  std::string path_of(const std::string& rows) const {
    return write("path.csv", "t_s,x_nm,y_nm,z_nm\n" + rows);
  }
};

/// Of a scan whose middle is the origin of W.
double height_at(const surface::Scan& scan, double x_nm, double y_nm) {
  const surface::HeightGrid& grid = scan.grid;
  const int column = static_cast<int>(std::lround(x_nm / grid.dx_nm)) + grid.columns / 2;
  const int row = static_cast<int>(std::lround(y_nm / grid.dy_nm)) + grid.rows / 2;
  return grid.z_nm[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                   static_cast<std::size_t>(column)] +
         scan.lowest_before_shift_nm;
}

TEST_F(TraceTest, WritesTheExampleIntoTheSample) {
  const Finished run = trace(scene_, example_, {"--csv", path("f.csv"), "--save-surface", path("marks.gsf")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out, "");
  EXPECT_EQ(run.err, "");  // no progress where nobody looks on
  const std::string csv = file_text(path("f.csv"));
  const auto lines = lines_of(csv);
  ASSERT_EQ(lines.size(), 15u);  // the header and 14 rows of the path
  EXPECT_EQ(lines[0],
            "t_s,end_x_nm,end_y_nm,end_z_nm,tip_x_nm,tip_y_nm,tip_z_nm,force_x_nn,force_y_nn,force_z_nn,"
            "deflection_nm,branch,work_aj,stored_aj,dissipated_aj,fault_bits");
  double unpaid_at_start = 0;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    std::vector<std::string> cells;
    std::istringstream row(lines[i]);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    ASSERT_EQ(cells.size(), 16u) << lines[i];
    EXPECT_EQ(cells[15], "0") << lines[i];
    const double force = std::stod(cells[9]);
    const bool writes = std::stod(cells[3]) < 0;
    EXPECT_EQ(cells[11], writes ? "contact" : "vdw");
    EXPECT_NEAR(std::stod(cells[10]), force / 42.0, 1e-12);  // the lever of the scene
    // Every stroke is paid for: what was worked since the start is stored or lost; the start's own potential
    // is left in the difference. 1e-9 of the work is rounding.
    const double work = std::stod(cells[12]);
    const double unpaid = work - std::stod(cells[13]) - std::stod(cells[14]);
    if (i == 1) unpaid_at_start = unpaid;
    EXPECT_NEAR(unpaid, unpaid_at_start, 1e-9 * std::abs(work) + 1e-9);
  }
  EXPECT_LT(std::abs(unpaid_at_start), 1.0);
  const surface::Scan scan = surface::read_gsf(path("marks.gsf"));
  EXPECT_EQ(scan.title, "lithography");
  EXPECT_EQ(scan.grid.columns, 301);
  EXPECT_NEAR(scan.grid.dx_nm, 1.0, 1e-9);
  // In the strokes 5 to 9 nm (twice an indent's some 3, as only the front half of a contact that ploughs
  // bears), beside them nothing.
  for (const auto& [x, y] : {std::pair{-80, 60}, {-40, 60}, {-60, 0}, {20, 0}, {60, 0}, {100, 0}}) {
    EXPECT_GT(height_at(scan, x, y), -9.0) << x << ' ' << y;
    EXPECT_LT(height_at(scan, x, y), -5.0) << x << ' ' << y;
  }
  for (const auto& [x, y] : {std::pair{-100, 0}, {-20, 0}, {0, 100}, {60, -60}, {-60, -100}}) {
    EXPECT_NEAR(height_at(scan, x, y), 0.0, 1e-6) << x << ' ' << y;
  }
  // What a stroke has displaced stands in its rim.
  EXPECT_GT(height_at(scan, 60, 60), 0.1);
  EXPECT_LT(height_at(scan, 60, 60), 3.0);
  // The same again, and to standard output: the same bytes.
  const Finished again = trace(scene_, example_, {"--save-surface", path("again.gsf")});
  EXPECT_EQ(again.out, csv);
  EXPECT_EQ(file_text(path("again.gsf")), file_text(path("marks.gsf")));
}

TEST_F(TraceTest, TheSavedSurfaceIsASceneAgain) {
  ASSERT_EQ(trace(scene_, example_, {"--csv", path("f.csv"), "--save-surface", path("marks.gsf")}).exit_code,
            0);
  std::string text = file_text(scene_);
  const std::string flat = "kind = \"flat\"";
  const auto at = text.find(flat);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, flat.size(), "kind = \"scan\"\nfile = \"marks.gsf\"");
  const auto marks = text.find("[marks]");
  text.erase(marks, text.find("[friction]") - marks);
  const auto half = text.find("half_width_nm");
  if (half != std::string::npos) text.erase(half, text.find('\n', half) - half);
  for (const char* start : {"x_nm = 0.0", "y_nm = 0.0"}) {
    text.replace(text.find(start), 10, std::string(start, 7) + "150");
  }
  const std::string written = write("written.toml", text);
  // A scan's origin is its corner: the stroke at (-60, 0) is at (90.5, 150.5). Down on it and beside it.
  const auto lowest = [&](double x) {
    const std::string there = std::to_string(x) + ",150.5,";
    const Finished run = trace(written, path_of("0," + there + "30\n0.1," + there + "8\n"));
    EXPECT_EQ(run.exit_code, 0) << run.err;
    const auto lines = lines_of(run.out);
    EXPECT_EQ(lines.size(), 3u);
    return lines.empty() ? std::string() : lines.back();
  };
  EXPECT_NE(lowest(90.5).find(",vdw,"), std::string::npos);      // still above the bottom of the stroke
  EXPECT_NE(lowest(50.5).find(",contact,"), std::string::npos);  // pressed into the level sample
}

TEST_F(TraceTest, RefusesABadPath) {
  expect_refused(trace(scene_, path("none.csv")), {"none.csv", "cannot be read"});
  expect_refused(trace(scene_, folder_.string()), {"is a folder"});
  expect_refused(trace(scene_, write("path.csv", "")), {"path.csv", "is empty", "t_s,x_nm,y_nm,z_nm"});
  expect_refused(trace(scene_, path_of("")), {"path.csv", "no rows"});
  expect_refused(trace(scene_, write("path.csv", "t_s,x_nm,y_nm,z_um\n0,0,0,1\n")), {"path.csv:1", "header"});
  expect_refused(trace(scene_, path_of("0,0,0\n")), {"path.csv:2", "3 fields", "expected 4"});
  expect_refused(trace(scene_, path_of("0,0,0,1,2\n")), {"path.csv:2", "5 fields"});
  expect_refused(trace(scene_, path_of("0,0,0,1\n0,0,0,1\n")), {"path.csv:3", "time does not increase"});
  for (const char* bad : {"nan", "1e9", "inf", "1,5e", "", "0x10"}) {
    expect_refused(trace(scene_, path_of("0,0,0," + std::string(bad) + "\n")), {"path.csv:2"});
  }
}

TEST_F(TraceTest, RefusesABadSceneAndASurfaceThatKeepsNothing) {
  const std::string good = path_of("0,0,0,10\n");
  expect_refused(trace(path("none.toml"), good), {"none.toml"});
  expect_refused(trace(write("bad.toml", "name = \"x\"\n[sample]\nhardness_gpa = -1\n"), good), {"bad.toml"});
  expect_refused(trace(scene_path("flat_silicon_oxide"), good, {"--save-surface", path("s.gsf")}),
                 {"--save-surface", "hardness_gpa"});
  EXPECT_FALSE(std::filesystem::exists(path("s.gsf")));
  std::string text = file_text(scene_);
  text.replace(text.find("kind = \"flat\""), 13, "kind = \"flat\"\nradius_force = true");
  expect_refused(trace(write("rf.toml", text), good), {"rf.toml", "radius_force", "omit it"});
}

TEST_F(TraceTest, SaysWhereItCannotWriteAndWhatWasHeldBack) {
  const Finished full = trace(scene_, path_of("0,0,0,10\n"), {"--csv", path("no/such/folder.csv")});
  EXPECT_EQ(full.exit_code, 1) << full.err;
  EXPECT_NE(full.err.find("cannot be written"), std::string::npos) << full.err;
  // 500 nm beside a workspace of 135: it stops there, and says so.
  const Finished held = trace(scene_, path_of("0,0,0,10\n1,500,0,10\n"));
  EXPECT_EQ(held.exit_code, 0);
  EXPECT_NE(held.err.find("held back"), std::string::npos) << held.err;
  EXPECT_NE(held.out.find("\n1,135,0,10,"), std::string::npos) << held.out;
}

TEST_F(TraceTest, TheServerKeepsWhatASessionLeaves) {
  const Finished refused = run_program(
      {kNve, "serve", "--scene", scene_, "--listen", "127.0.0.1:0", "--save-surface", path("none")});
  expect_refused(refused, {"--save-surface", "is not a folder"});
  expect_refused(run_program({kNve, "serve", "--scene", scene_path("flakes"), "--listen", "127.0.0.1:0",
                              "--save-surface", folder_.string()}),
                 {"flakes.toml", "--save-surface", "hardness_gpa"});
  Server server(scene_, 0, {"--save-surface", folder_.string()});
  const Finished run = run_program(station(server, {"--task", "indent", "--duration-s", "2"}), {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const Finished above =
      run_program(station(server, {"--task", "position", "--duration-s", "0.5"}), {}, kLong);
  EXPECT_EQ(above.exit_code, 0) << above.err;
  server.stop();
  const surface::Scan scan = surface::read_gsf(path("lithography-1.gsf"));
  // 5 nm intended, less what coupling and lever give; adhesion alone leaves 0.5 nm.
  EXPECT_LT(scan.lowest_before_shift_nm, -0.6);
  EXPECT_GT(scan.lowest_before_shift_nm, -5.0);
  EXPECT_FALSE(std::filesystem::exists(path("lithography-2.gsf")));  // it touched nothing
}

TEST_F(TraceTest, WhatAnEarlierServerKeptIsNeverOverwritten) {
  std::string kept[2];
  for (int run = 1; run <= 3; ++run) {
    Server server(scene_, 0, {"--save-surface", folder_.string()});
    const Finished done = run_program(station(server, {"--task", "indent", "--duration-s", "2"}), {}, kLong);
    EXPECT_EQ(done.exit_code, 0) << done.err;
    server.stop();
    const std::string file = path("lithography-" + std::to_string(run) + ".gsf");
    ASSERT_TRUE(std::filesystem::exists(file)) << file;
    EXPECT_FALSE(std::filesystem::exists(file + ".part"));
    for (int before = 1; before < run; ++before) {
      EXPECT_EQ(file_text(path("lithography-" + std::to_string(before) + ".gsf")), kept[before - 1])
          << "of run " << before << " after run " << run;
    }
    if (run < 3) kept[run - 1] = file_text(file);
  }
}

TEST_F(TraceTest, TwoServersKeepInOneFolder) {
  Server first(scene_, 0, {"--save-surface", folder_.string()});
  Server second(scene_, 0, {"--save-surface", folder_.string()});
  for (Server* const server : {&first, &second}) {
    const Finished done = run_program(station(*server, {"--task", "indent", "--duration-s", "2"}), {}, kLong);
    EXPECT_EQ(done.exit_code, 0) << done.err;
    server->stop();
  }
  // Both had meant their first session to be the first: the second found that name taken.
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
    const std::string name = entry.path().filename().string();
    if (!name.ends_with(".gsf")) continue;
    ++files;
    EXPECT_LT(surface::read_gsf(entry.path().string()).lowest_before_shift_nm, 0) << name << ": touched";
  }
  EXPECT_EQ(files, 2);
}

TEST_F(TraceTest, AServerThatIsKilledHasLostSecondsOnly) {
  Server server(scene_, 0, {"--save-surface", folder_.string()});
  ChildProcess pressing(station(server, {"--task", "indent", "--duration-s", "60"}));
  const std::string file = path("lithography-1.gsf");
  // While the session goes on; it presses deeper for 30 s.
  const auto depth_nm = [&] { return -surface::read_gsf(file).lowest_before_shift_nm; };
  const auto end = std::chrono::steady_clock::now() + kLong;
  while (!std::filesystem::exists(file) && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(Milliseconds(20));
  ASSERT_TRUE(std::filesystem::exists(file)) << "nothing was kept while the session went on";
  const double first_nm = depth_nm();
  EXPECT_GT(first_nm, 0);
  while (depth_nm() <= first_nm && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(Milliseconds(20));
  EXPECT_GT(depth_nm(), first_nm) << "it is kept again and again";
  server.child().signal(SIGKILL);
  ASSERT_TRUE(server.child().wait(kLong));
  const std::string left = file_text(file);
  EXPECT_GT(depth_nm(), first_nm) << "whole, and what it was";
  pressing.signal(SIGINT);
  pressing.wait(kLong);
  // The next server leaves it alone.
  Server next(scene_, 0, {"--save-surface", folder_.string()});
  const Finished done = run_program(station(next, {"--task", "indent", "--duration-s", "2"}), {}, kLong);
  EXPECT_EQ(done.exit_code, 0) << done.err;
  next.stop();
  EXPECT_EQ(file_text(file), left);
  EXPECT_LT(surface::read_gsf(path("lithography-2.gsf")).lowest_before_shift_nm, 0);
}

}  // namespace
}  // namespace telenano::programs
