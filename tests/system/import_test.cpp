// telenano-nve import: scenes that run as they are, the same heights the same way up from every format, what
// it refuses; Gwyddion itself where it is installed, and programs in its place that misbehave.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numeric>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/app/sample/gwyddion_convert.h"
#include "tests/support/gwy_bytes.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

namespace fs = std::filesystem;
namespace gwy = support::gwy;
using surface::Scan;

const std::string kData = std::string(TELENANO_SOURCE_DIR) + "/tests/data/import/";

bool gwyddion_is_installed() {
  return std::system("command -v gwyddion >/dev/null 2>&1") ==
         0;  // NOLINT(cert-env33-c, concurrency-mt-unsafe)
}

/// Waves, with one corner, the first value of the file, far above all else.
gwy::Field marked(int columns, int rows, double width, double height) {
  gwy::Field field{columns, rows, width, height};
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column)
      field.values.push_back(1e-9 * (std::sin(0.3 * column) + std::cos(0.2 * row) + 2.0));
  }
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column)
      field.values[static_cast<std::size_t>(row * columns + column)] = 9e-9;
  }
  return field;
}

class ImportTest : public ProgramsTest {
 protected:
  Finished import(const std::vector<std::string>& more, const std::string& search_path = "") const {
    std::vector<std::string> command;
    if (!search_path.empty()) command = {"/usr/bin/env", "PATH=" + search_path, "TMPDIR=" + folder_.string()};
    command.insert(command.end(), {kNve, "import"});
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command, {.folder = folder_}, kLong);
  }
  void expect_refused(const std::vector<std::string>& more, const std::vector<std::string>& words,
                      const std::string& search_path = "") const {
    const Finished run = import(more, search_path);
    EXPECT_EQ(run.exit_code, 2) << run.err;
    EXPECT_EQ(run.out, "");
    EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
    for (const std::string& word : words)
      EXPECT_NE(run.err.find(word), std::string::npos) << word << ": " << run.err;
  }
  std::string gwy_file(const std::string& name, const std::string& components) const {
    return write(name, gwy::file(components));
  }
  std::string program(const std::string& name, const std::string& script) const {
    fs::create_directories(folder_ / "bin");
    const std::string file = write("bin/" + name, "#!/bin/sh\n" + script);
    fs::permissions(file, fs::perms::owner_all);
    return file;
  }
  /// Of the folders that conversions work in, in this test's folder.
  std::size_t left_behind() const {
    std::size_t n = 0;
    for (const auto& entry : fs::directory_iterator(folder_))
      n += entry.path().filename().string().starts_with("telenano-import-") ? 1 : 0;
    return n;
  }
};

TEST_F(ImportTest, WritesASceneThatRunsAsItIs) {
  const std::string file =
      gwy_file("my scan.\xff.gwy", gwy::channel(0, "H\xf6he \"1\"\\", marked(64, 48, 64e-9, 96e-9)));
  const Finished made = import({file, "-o", "new/folder", "--spikes", "12", "--flatten", "rows-median",
                                "--deconvolve-radius-nm", "5", "--tip-radius-nm", "8"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_EQ(made.err, "");
  for (const char* word : {"spikes", "flatten", "level", "deconvolved", "certain", "written"})
    EXPECT_NE(made.out.find(word), std::string::npos) << word << " in:\n" << made.out;
  const std::string scene = path("new/folder/scene.toml");
  const std::string text = file_text(scene);
  for (const char* word :
       {"# spikes: ", "# flatten: ", "# level: ", "# deconvolved: ", "# from: my scan.?.gwy"})
    EXPECT_NE(text.find(word), std::string::npos) << word << " in:\n" << text;

  const Finished check = run_program({kNve, "check", "--scene", scene}, {.folder = folder_}, kLong);
  EXPECT_EQ(check.exit_code, 0) << check.err;
  EXPECT_NE(check.out.find("8 nm radius"), std::string::npos) << check.out;
  const Finished curve = run_program({kNve, "curve", "--scene", scene}, {.folder = folder_}, kLong);
  EXPECT_EQ(curve.exit_code, 0) << curve.err;
  EXPECT_GT(lines_of(curve.out).size(), 1000u);

  const Scan scan = surface::read_gsf(path("new/folder/my_scan__.gsf"));
  const Scan certain = surface::read_gsf(path("new/folder/my_scan___certainty.gsf"));
  EXPECT_EQ(certain.grid.z_nm.size(), scan.grid.z_nm.size());
  for (const double z : certain.grid.z_nm) ASSERT_TRUE(std::abs(z) < 1e-6 || std::abs(z - 1.0) < 1e-6) << z;
}

TEST_F(ImportTest, TheSameFieldComesTheSameWayUpFromEveryFormat) {
  // Pixels of 2 x 4 nm. The mark, first in the file, is at the top left: in frame W at the lowest x and the
  // highest y.
  const gwy::Field field = marked(40, 30, 80e-9, 120e-9);
  const std::string from_gwy = gwy_file("a.gwy", gwy::channel(0, "", field));
  ASSERT_EQ(import({from_gwy, "--level", "none"}).exit_code, 0);
  const Scan scan = surface::read_gsf(path("a/a.gsf"));
  EXPECT_EQ(scan.grid.columns, 40);
  EXPECT_EQ(scan.grid.rows, 30);
  EXPECT_NEAR(scan.grid.dx_nm, 2.0, 1e-9);
  EXPECT_NEAR(scan.grid.dy_nm, 4.0, 1e-9);
  const double lowest = *std::min_element(field.values.begin(), field.values.end());
  for (int row = 0; row < 30; ++row) {
    for (int column = 0; column < 40; ++column) {
      const double z_nm = scan.grid.z_nm[static_cast<std::size_t>((29 - row) * 40 + column)];
      // float32 of heights below 9 nm
      ASSERT_NEAR(z_nm, 1e9 * (field.values[static_cast<std::size_t>(row * 40 + column)] - lowest), 1e-6)
          << column << ", " << row;
    }
  }

  // A .gsf of the same field gives the same file again.
  fs::copy_file(path("a/a.gsf"), path("b.gsf"));
  ASSERT_EQ(import({path("b.gsf"), "--level", "none"}).exit_code, 0);
  const Scan again = surface::read_gsf(path("b/b.gsf"));
  for (std::size_t i = 0; i < scan.grid.z_nm.size(); ++i)
    ASSERT_NEAR(again.grid.z_nm[i], scan.grid.z_nm[i], 1e-6) << i;
}

TEST_F(ImportTest, ListsAndChoosesChannels) {
  gwy::Field phase = marked(8, 8, 1e-8, 1e-8);
  phase.unit_z = "deg";
  gwy::Field second = marked(8, 8, 2e-8, 2e-8);
  second.values[9] = std::nan("");
  const std::string file =
      gwy_file("s.gwy", gwy::channel(0, "Phase, \"raw\"", phase) +
                            gwy::channel(4, "Height", marked(8, 6, 1e-8, 1e-8)) +
                            gwy::channel(5, "Retrace", second) + gwy::channel(6, "Retrace", second));
  const Finished list = import({file, "--list"});
  EXPECT_EQ(list.exit_code, 0) << list.err;
  EXPECT_EQ(list.out,
            "channel,title,columns,rows,unit,lateral_unit,width,height,gaps,masked,usable\n"
            "0,\"Phase, \"\"raw\"\"\",8,8,\"deg\",\"m\",1e-08,1e-08,0,0,no\n"
            "4,\"Height\",8,6,\"m\",\"m\",1e-08,1e-08,0,0,yes\n"
            "5,\"Retrace\",8,8,\"m\",\"m\",2e-08,2e-08,1,0,yes\n"
            "6,\"Retrace\",8,8,\"m\",\"m\",2e-08,2e-08,1,0,yes\n");
  EXPECT_FALSE(fs::exists(path("s")));
  const auto rows_of = [&](const std::vector<std::string>& more) {
    std::vector<std::string> command{file, "--force"};
    command.insert(command.end(), more.begin(), more.end());
    const Finished run = import(command);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    const Scan scan = surface::read_gsf(path("s/s.gsf"));
    return std::pair(scan.grid.rows, std::lround(scan.width_nm));
  };
  EXPECT_EQ(rows_of({}), std::pair(6, 10L));
  EXPECT_EQ(rows_of({"--channel", "Height"}), std::pair(6, 10L));
  EXPECT_EQ(rows_of({"--channel", "5"}), std::pair(8, 20L));
  fs::remove_all(path("s"));
  expect_refused({file, "--channel", "Retrace"}, {"more than one", "5 'Retrace'", "6 'Retrace'"});
  expect_refused({file, "--channel", "Deflection"}, {"'Deflection'", "4 'Height' in m"});
  expect_refused({file, "--channel", "1"}, {"no channel '1'"});
  expect_refused({file, "--channel", "0"}, {"'deg'", "'m'"});
}

// What a channel in metres is, its title says. The marked one is 8 pixels wide, the other 6.
TEST_F(ImportTest, OfSeveralChannelsInMetresTheOneNamedAsAHeightIsTaken) {
  const char* heights[] = {
      "Height",       "Z",         "z",         "Height Sensor",    "Z Sensor",          "ZSensor",
      "ZSensorTrace", "ZSENSOR",   "Sensor",    "Topography [Fwd]", "Height (measured)", "HeightRetrace",
      "Z (Forward)",  "1F:Height", "topography"};
  const char* others[] = {"Amplitude",    "AmplitudeRetrace", "Z Error",  "Height Error", "Deflection",
                          "Error signal", "Deflection Error", "X Sensor", "YSensor",      "Horizontal",
                          "Zoom",         "Sensors",          "",         "Lateral Z",    "Heights"};
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const char* height : heights) pairs.emplace_back(height, "Amplitude");
  for (const char* other : others) pairs.emplace_back("Height", other);
  for (const auto& [height, other] : pairs) {
    for (const bool first : {true, false}) {
      const std::string file = gwy_file(
          "t.gwy", gwy::channel(0, first ? height : other, marked(first ? 8 : 6, 8, 1e-8, 1e-8)) +
                       gwy::channel(1, first ? other : height, marked(first ? 6 : 8, 8, 1e-8, 1e-8)));
      const Finished run = import({file, "-o", "t", "--force"});
      ASSERT_EQ(run.exit_code, 0) << run.err << height << ", " << other;
      EXPECT_EQ(surface::read_gsf(path("t/t.gsf")).grid.columns, 8) << height << ", " << other;
    }
  }
  fs::remove_all(path("t"));
  // None, or none that is known: the list, and the flag that names one.
  const gwy::Field field = marked(8, 8, 1e-8, 1e-8);
  for (const auto& [one, two] : {std::pair("Amplitude", "Deflection"), {"Forward", "Backward"}, {"", ""}}) {
    const std::string file = gwy_file("t.gwy", gwy::channel(0, one, field) + gwy::channel(3, two, field));
    expect_refused({file, "-o", "t"}, {"--channel", std::string("3 '") + two + "' in m"});
    EXPECT_EQ(import({file, "-o", "t", "--channel", "3", "--force"}).exit_code, 0);
    fs::remove_all(path("t"));
  }
  for (const char* signal : {"Amplitude Error", "Deflection"}) {
    expect_refused({gwy_file("t.gwy", gwy::channel(0, signal, field)), "-o", "t"}, {"--channel", signal});
  }
  EXPECT_FALSE(fs::exists(path("t")));
  EXPECT_EQ(import({gwy_file("t.gwy", gwy::channel(0, "Forward", field)), "-o", "t"}).exit_code, 0);
}

TEST_F(ImportTest, FillsGapsAndLeavesMasksUnlessTold) {
  gwy::Field field = marked(20, 20, 1e-8, 1e-8);
  gwy::Field mask = field;
  std::fill(mask.values.begin(), mask.values.end(), 0.0);
  field.values[210] = std::nan("");
  field.values[211] = HUGE_VAL;
  field.values[330] = 500e-9;
  mask.values[330] = 1.0;
  const std::string file =
      gwy_file("g.gwy", gwy::channel(0, "", field) + gwy::component("/0/mask", 'o', gwy::field(mask)));
  const Finished kept = import({file, "--level", "none"});
  ASSERT_EQ(kept.exit_code, 0) << kept.err;
  EXPECT_NE(kept.out.find("2 pixels without a height"), std::string::npos) << kept.out;
  EXPECT_NE(kept.out.find("1 masked pixels left"), std::string::npos) << kept.out;
  EXPECT_NE(kept.err.find("--spikes"), std::string::npos) << kept.err;  // which would be felt
  Scan scan = surface::read_gsf(path("g/g.gsf"));
  EXPECT_GT(*std::max_element(scan.grid.z_nm.begin(), scan.grid.z_nm.end()), 490.0);
  ASSERT_EQ(import({file, "--level", "none", "--fill-masked", "--force"}).exit_code, 0);
  scan = surface::read_gsf(path("g/g.gsf"));
  EXPECT_LT(*std::max_element(scan.grid.z_nm.begin(), scan.grid.z_nm.end()), 9.1);

  for (std::size_t i = 0; i < 101; ++i) field.values[200 + i] = std::nan("");
  expect_refused({gwy_file("h.gwy", gwy::channel(0, "", field))},
                 {"no height in 101 of 400", "three quarters"});
}

TEST_F(ImportTest, ReplacesNothingUnlessForced) {
  const std::string file = gwy_file("s.gwy", gwy::channel(0, "", marked(8, 8, 1e-8, 1e-8)));
  ASSERT_EQ(import({file, "-o", "out"}).exit_code, 0);
  write("out/scene.toml", "mine\n");
  expect_refused({file, "-o", "out"}, {"out/s.gsf", "--force", "-o"});
  fs::remove(path("out/s.gsf"));
  expect_refused({file, "-o", "out"}, {"out/scene.toml", "--force"});
  EXPECT_EQ(file_text(path("out/scene.toml")), "mine\n");
  EXPECT_FALSE(fs::exists(path("out/s.gsf")));
  EXPECT_EQ(import({file, "-o", "out", "--force"}).exit_code, 0);
  EXPECT_NE(file_text(path("out/scene.toml")), "mine\n");
  EXPECT_FALSE(fs::exists(path("out/scene.toml.part")));
  // Not over what is read, and not into a file.
  fs::copy_file(path("out/s.gsf"), path("t.gsf"));
  fs::create_directories(path("own"));
  fs::create_hard_link(path("t.gsf"), path("own/t.gsf"));
  expect_refused({path("t.gsf"), "-o", "own", "--force"}, {"own/t.gsf", "file to import"});
  expect_refused({file, "-o", path("t.gsf")}, {"t.gsf", "not a folder"});
}

TEST_F(ImportTest, EveryWrongFileAndFlagIsOneLine) {
  const std::string nowhere = path("empty_bin");
  fs::create_directories(nowhere);
  const gwy::Field field = marked(8, 8, 1e-8, 1e-8);
  const std::string good = gwy_file("good.gwy", gwy::channel(0, "Height", field));
  const auto field_file = [&](const std::string& name, const auto& change) {
    gwy::Field changed = field;
    change(changed);
    return gwy_file(name, gwy::channel(0, "Height", changed));
  };
  const std::string bytes = file_text(good);
  expect_refused({path("none.gwy")}, {"none.gwy", "no such file"});
  expect_refused({folder_.string()}, {"is a folder"});
  expect_refused({"/dev/zero"}, {"/dev/zero", "not a regular file"});
  expect_refused({write("empty.gwy", "")}, {"is empty"});
  expect_refused({write("cut.gwy", bytes.substr(0, bytes.size() - 9))}, {"cut.gwy", "truncated"});
  expect_refused({gwy_file("curves.gwy", gwy::component("/0/graph/graph/1", 's', gwy::text("x")))},
                 {"no image"});
  expect_refused({field_file("volts.gwy", [](gwy::Field& f) { f.unit_z = "V"; })},
                 {"no channel of heights", "0 'Height' in V"});
  expect_refused({field_file("nm.gwy", [](gwy::Field& f) { f.unit_z = "nm"; }), "--channel", "0"},
                 {"'nm'", "'m'"});
  expect_refused({field_file("deg.gwy", [](gwy::Field& f) { f.unit_xy = "deg"; }), "--channel", "0"},
                 {"'deg'", "'m'"});
  expect_refused({field_file("wide.gwy", [](gwy::Field& f) { f.width = 1.0; })}, {"1 m by", "1e-3 m"});
  expect_refused({field_file("nan.gwy", [](gwy::Field& f) { f.height = std::nan(""); })}, {"nan", "1e-3 m"});
  expect_refused({field_file("tall.gwy", [](gwy::Field& f) { f.values[3] = 1.0; })}, {"1e5 nm"});
  expect_refused({field_file("line.gwy",
                             [](gwy::Field& f) {
                               f.rows = 1;
                               f.values.resize(8);
                             })},
                 {"8 x 1 pixels", "2 to 8192"});
  expect_refused({write("cut.gsf", "Gwyddion Simple Field 1.0\nXRes = 3\n")},
                 {"cut.gsf", "header has no end"});
  expect_refused({write("scan.spm", "\\*File list\r\n")},
                 {"scan.spm", "gwyddion", "apt-get install gwyddion"}, nowhere);
  for (const char* flag : {"--tip-radius-nm", "--deconvolve-radius-nm", "--spikes"}) {
    for (const char* value : {"nan", "inf", "0", "-3", "1e9", "x"})
      expect_refused({good, flag, value}, {flag});
  }
  expect_refused({good, "--tip-radius-nm", "41"}, {"10 x 10 nm", "41 nm radius", "--tip-radius-nm"});
  expect_refused({good, "--level", "twist"}, {"--level", "plane"});
  expect_refused({good, "--flatten", "twist"}, {"--flatten", "rows-median"});
  expect_refused({}, {"file is required"});
  EXPECT_FALSE(fs::exists(path("good")));
  EXPECT_EQ(left_behind(), 0u);
}

TEST_F(ImportTest, AScanThatIsCoarseForItsTipIsToldOf) {
  const std::string file =
      gwy_file("c.gwy", gwy::channel(0, "", marked(16, 16, 160e-9, 160e-9)));  // 10 nm a pixel
  EXPECT_EQ(import({file, "--tip-radius-nm", "20"}).err.find("coarse"), std::string::npos);
  EXPECT_NE(import({file, "--tip-radius-nm", "19", "--force"}).err.find("coarse"), std::string::npos);
}

TEST_F(ImportTest, TheScanItselfTellsTheBluntestTip) {
  // Points of 10 nm on a plain, as a tip of 12 nm sees them; 1 nm a pixel.
  gwy::Field field{100, 100, 100e-9, 100e-9};
  for (int row = 0; row < 100; ++row) {
    for (int column = 0; column < 100; ++column) {
      double z_nm = 0;
      for (const auto& [x, y] : {std::pair{20, 30}, {70, 25}, {30, 75}, {75, 80}}) {
        const double squared = (column - x) * (column - x) + (row - y) * (row - y);
        z_nm = std::max(z_nm, 10.0 - squared / 24.0);
      }
      field.values.push_back(1e-9 * z_nm);
    }
  }
  const std::string file = gwy_file("p.gwy", gwy::channel(0, "", field));
  const Finished run = import({file, "--deconvolve-radius-nm", "blind"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::string before = "no blunter than ";
  ASSERT_NE(run.out.find(before), std::string::npos) << run.out;
  const double found = std::atof(run.out.c_str() + run.out.find(before) + before.size());
  EXPECT_GE(found, 0.98 * 12.0);
  EXPECT_LE(found, 1.25 * 12.0);  // see TipErosion.TheBluntestTipIsTheOneThatMeasured
  // The points are narrow again: four times π·120 pixels stood above half their height.
  const Scan scan = surface::read_gsf(path("p/p.gsf"));
  EXPECT_LT(std::count_if(scan.grid.z_nm.begin(), scan.grid.z_nm.end(), [](double z) { return z > 5.0; }),
            400);

  std::fill(field.values.begin(), field.values.end(), 1e-9);
  expect_refused({gwy_file("flat.gwy", gwy::channel(0, "", field)), "--deconvolve-radius-nm", "blind"},
                 {"blind", "give the radius"});
}

TEST_F(ImportTest, AThousandLinesTakeNoTime) {
  const std::string file = gwy_file("big.gwy", gwy::channel(0, "", marked(1024, 1024, 1e-6, 1e-6)));
  const auto begin = std::chrono::steady_clock::now();
  ASSERT_EQ(import({file}).exit_code, 0);
  // 0.3 s measured, 2 s promised; the rest is for sanitizers and a loaded machine.
  EXPECT_LT(std::chrono::steady_clock::now() - begin, Seconds(20));
}

// What stands in for Gwyddion.

TEST_F(ImportTest, OtherFormatsComeThroughAChild) {
  write("converted.gwy", gwy::file(gwy::channel(0, "Height", marked(8, 8, 1e-8, 1e-8))));
  program("gwyddion",
          "out=${1#--convert-to-gwy=}\n"
          "read line && exit 7\n"  // standard input is closed
          "[ -z \"$DISPLAY\" ] && [ \"$HOME\" = \"$(dirname \"$out\")\" ] || exit 8\n"
          "case $2 in /*) ;; *) exit 9;; esac\n"
          "cp '" +
              path("converted.gwy") + "' \"$out\"\n");
  write("-scan; touch x.spm", "anything");
  const Finished run = import({"-o", "out", "--", "-scan; touch x.spm"}, path("bin") + ":/usr/bin:/bin");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("converted by Gwyddion"), std::string::npos) << run.out;
  EXPECT_TRUE(fs::exists(path("out/scene.toml")));
  EXPECT_FALSE(fs::exists(path("x.spm")));  // no shell
  EXPECT_EQ(left_behind(), 0u);
}

// Gwyddion 2.62 takes the Latin-1 micro sign of a WSxM file for nothing, and the number for nanometres.
TEST_F(ImportTest, AWsxmFileIsHeldAgainstItsOwnHeader) {
  program("gwyddion", "cp '" + path("converted.gwy") + "' \"${1#--convert-to-gwy=}\"\n");
  const std::string programs = path("bin") + ":/usr/bin:/bin";
  const auto wsxm = [&](const std::string& x, const std::string& y, const std::string& z) {
    return write("scan.stp",
                 "WSxM file copyright UAM\r\nSxM Image file\r\n\r\n[Control]\r\n\r\n    X Amplitude: " + x +
                     "\r\n    Y Amplitude: " + y + "\r\n\r\n[General Info]\r\n\r\n    Z Amplitude: " + z +
                     "\r\n\r\n[Header end]\r\n");
  };
  const auto converted = [&](double width, double height, double factor) {
    gwy::Field field = marked(8, 8, width, height);
    for (double& z : field.values) z *= factor;
    write("converted.gwy", gwy::file(gwy::channel(0, "Topography", field)));
  };
  converted(20e-9, 20e-9, 1);
  for (const char* twenty :
       {"20 \xb5m", "20 \xc2\xb5m", "20 \xce\xbcm", "20 um", "20000 nm", "20 furlongs", "20", "x"}) {
    expect_refused({wsxm(twenty, twenty, "8 nm")}, {"scan.stp", "X Amplitude", "header", "save it as .gwy"},
                   programs);
    expect_refused({"--list", wsxm("20 nm", twenty, "8 nm")}, {"Y Amplitude", "header"}, programs);
  }
  for (const char* twenty : {"20 nm", "0.02 \xb5m", "0,02 um", "200 \xc5"})
    EXPECT_EQ(import({wsxm(twenty, twenty, "8 nm"), "--force"}, programs).exit_code, 0) << twenty;
  fs::remove_all(path("scan"));
  expect_refused({wsxm("20 nm", "20 nm", "8 \xb5m")}, {"Z Amplitude", "8000 nm"}, programs);
  converted(20e-6, 20e-6, 1);
  EXPECT_EQ(import({wsxm("20 \xb5m", "20 \xb5m", "8 nm")}, programs).exit_code, 0);
  EXPECT_EQ(left_behind(), 0u);
}

TEST_F(ImportTest, AChildThatMisbehavesIsOneLine) {
  const std::string file = write("scan.spm", "anything");
  app::ConvertLimits limits;
  const auto refusal = [&](const std::string& script) -> std::string {
    limits.program = program("stand-in", "out=${1#--convert-to-gwy=}\n" + script);
    try {
      app::convert_by_gwyddion(file, limits);
    } catch (const UserError& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_EQ(refusal("echo 'a warning' >&2; echo \"$2: File is truncated.\" >&2; exit 1"),
            file + ": Gwyddion cannot read it: File is truncated.");
  EXPECT_EQ(refusal("printf 'a\\033[31m\\n' >&2; exit 1"), file + ": Gwyddion cannot read it: a?[31m");
  EXPECT_EQ(refusal("exit 3"), file + ": Gwyddion cannot read it: it does not say why");
  EXPECT_EQ(refusal("exit 0"), file + ": Gwyddion cannot convert it: it does not say why");
  EXPECT_EQ(refusal("kill -SEGV $$"), file + ": Gwyddion crashes on it (signal 11)");
  // More words than are kept.
  EXPECT_NE(refusal("yes | head -c 3000000; exit 1").find("cannot read it"), std::string::npos);
  limits.bytes_max = 4096;
  EXPECT_EQ(refusal("exec head -c 100000 /dev/zero >\"$out\""),
            file + ": Gwyddion makes more of it than 4096 bytes");
  // One that does not end, with a child of its own that would keep the pipe open.
  limits.time = Milliseconds(300);
  EXPECT_EQ(refusal("sleep 1000 & echo $! >'" + path("pid") + "'; wait"),
            file + ": Gwyddion has not read it within 0 s: open it there and save it as .gwy");
  const std::string pid = file_text(path("pid"));
  ASSERT_FALSE(pid.empty());
  for (int i = 0; i < 200 && ::kill(std::atoi(pid.c_str()), 0) == 0; ++i) {
    const std::string state = file_text("/proc/" + std::to_string(std::atoi(pid.c_str())) + "/stat");
    if (state.find(") Z ") != std::string::npos) break;  // killed, and not yet gathered by its new parent
    std::this_thread::sleep_for(Milliseconds(50));
    ASSERT_LT(i, 199) << "the child's child lives on";
  }
}

// A write to a pipe that nobody reads ends no program of ours; another's decides for itself.
TEST_F(ImportTest, AChildHearsOfABrokenPipe) {
  program("gwyddion", "grep SigIgn /proc/self/status >'" + path("ignored") + "'\nexit 1\n");
  import({write("scan.spm", "anything")}, path("bin") + ":/usr/bin:/bin");
  const std::string ignored = file_text(path("ignored"));
  ASSERT_TRUE(ignored.starts_with("SigIgn:")) << ignored;
  EXPECT_EQ(std::strtoull(ignored.c_str() + 7, nullptr, 16) >> (SIGPIPE - 1) & 1, 0u) << ignored;
}

TEST_F(ImportTest, AnEndFromOutsideLeavesNothingBehind) {
  program("gwyddion", "echo started >'" + path("started") + "'; exec sleep 1000\n");
  ChildProcess child({"/usr/bin/env", "PATH=" + path("bin") + ":/usr/bin:/bin", "TMPDIR=" + folder_.string(),
                      kNve, "import", write("scan.spm", "anything")},
                     {.folder = folder_});
  for (int i = 0; i < 600 && !fs::exists(path("started")); ++i) std::this_thread::sleep_for(Milliseconds(50));
  ASSERT_TRUE(fs::exists(path("started")));
  EXPECT_EQ(left_behind(), 1u);
  child.signal(SIGTERM);
  ASSERT_TRUE(child.wait(kLong));
  EXPECT_EQ(child.ended_by(), SIGTERM);
  EXPECT_EQ(left_behind(), 0u);
  EXPECT_FALSE(fs::exists(path("scan")));
}

// Gwyddion itself.

TEST_F(ImportTest, AnInstrumentsFileGivesTheScanThatAnotherProgramMadeOfIt) {
  if (!gwyddion_is_installed()) GTEST_SKIP() << "Gwyddion is not installed: apt-get install gwyddion";
  const Finished run = import({kData + "top-1.top"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  Scan ours = surface::read_gsf(path("top-1/top-1.gsf"));
  Scan theirs = surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  ASSERT_EQ(ours.grid.columns, theirs.grid.columns);
  ASSERT_EQ(ours.grid.rows, theirs.grid.rows);
  EXPECT_NEAR(ours.width_nm, theirs.width_nm, 1e-3);
  // Each had a plane taken out, not the same one: what is between them is a plane, to float32 and the
  // instrument's steps, and to no more if one of them were turned over.
  const int columns = ours.grid.columns, rows = ours.grid.rows;
  std::vector<double> between;
  for (std::size_t i = 0; i < ours.grid.z_nm.size(); ++i)
    between.push_back(ours.grid.z_nm[i] - theirs.grid.z_nm[i]);
  const auto at = [&](int column, int row) {
    return between[static_cast<std::size_t>(row * columns + column)];
  };
  const double a = (at(columns - 1, 0) - at(0, 0)) / (columns - 1);
  const double b = (at(0, rows - 1) - at(0, 0)) / (rows - 1);
  double worst = 0;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column)
      worst = std::max(worst, std::abs(at(column, row) - (at(0, 0) + a * column + b * row)));
  }
  EXPECT_LT(worst, 1e-3);
  EXPECT_NE(run.out.find("converted by Gwyddion"), std::string::npos) << run.out;
}

TEST_F(ImportTest, AMicroSignInLatin1IsNoNanometre) {
  if (!gwyddion_is_installed()) GTEST_SKIP() << "Gwyddion is not installed: apt-get install gwyddion";
  expect_refused({kData + "wsxm_20um_latin1.stp"}, {"X Amplitude 20000 nm", "Gwyddion makes 20 nm"});
  EXPECT_EQ(import({kData + "wsxm_2000nm.stp"}).exit_code, 0);
  EXPECT_NEAR(surface::read_gsf(path("wsxm_2000nm/wsxm_2000nm.gsf")).width_nm, 2000, 1e-3);
}

TEST_F(ImportTest, ADamagedInstrumentsFileIsOneLine) {
  if (!gwyddion_is_installed()) GTEST_SKIP() << "Gwyddion is not installed: apt-get install gwyddion";
  expect_refused({write("cut.top", file_text(kData + "top-1.top").substr(0, 60000))},
                 {"cut.top", "Gwyddion cannot read it"});
  expect_refused({write("notes.txt", "no scan\n")}, {"notes.txt", "Gwyddion cannot read it"});
}

TEST_F(ImportTest, GwyddionsOwnFileIsReadWithoutIt) {
  const Finished run = import({kData + "asymmetric.gwy", "--level", "none"}, "/nowhere");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Scan from_gwy = surface::read_gsf(path("asymmetric/asymmetric.gsf"));
  const Scan from_gsf = surface::read_gsf(kData + "asymmetric.gsf");
  ASSERT_EQ(from_gwy.grid.z_nm.size(), 12u);
  for (std::size_t i = 0; i < 12; ++i) EXPECT_NEAR(from_gwy.grid.z_nm[i], from_gsf.grid.z_nm[i], 1e-6) << i;
  EXPECT_EQ(from_gwy.title, "Asymmetric height");
}

}  // namespace
}  // namespace telenano::programs
