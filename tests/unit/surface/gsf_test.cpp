#include "telenano/common/surface/gsf.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <vector>

#include "telenano/common/base/error.h"
#include "tests/source_dir.h"

namespace telenano::surface {
namespace {

constexpr const char* kGood = "XRes = 3\nYRes = 2\nXReal = 3e-08\nYReal = 1e-08\nXYUnits = m\nZUnits = m\n";
const std::vector<float> kHeights = {1e-9f, 2e-9f, 3e-9f, 4e-9f, 5e-9f, 6e-9f};

std::string gsf(const std::string& fields, const std::vector<float>& heights = kHeights) {
  std::string bytes = "Gwyddion Simple Field 1.0\n" + fields;
  bytes.append(4 - bytes.size() % 4, '\0');
  for (const float z : heights) {
    char raw[4];
    std::memcpy(raw, &z, 4);  // the tests run on little-endian machines
    bytes.append(raw, 4);
  }
  return bytes;
}

std::string error_of(const std::string& bytes) {
  try {
    parse_gsf(bytes, "s.gsf");
  } catch (const UserError& error) {
    return error.what();
  }
  return "no error";
}

TEST(Gsf, PutsRowsUpwardsAndTheLowestSampleAtZero) {
  const Scan scan = parse_gsf(gsf(kGood), "s.gsf");
  EXPECT_EQ(scan.grid.columns, 3);
  EXPECT_EQ(scan.grid.rows, 2);
  // 1e-6 nm: heights are single precision, 1e-9 m = 1 nm to 1e-7 of itself.
  EXPECT_NEAR(scan.grid.dx_nm, 10.0, 1e-12);
  EXPECT_NEAR(scan.grid.dy_nm, 5.0, 1e-12);
  EXPECT_NEAR(scan.grid.x_first_nm, 5.0, 1e-12);
  EXPECT_NEAR(scan.grid.y_first_nm, 2.5, 1e-12);
  const double expected[] = {3, 4, 5, 0, 1, 2};  // the file's second row is the lower one
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(scan.grid.z_nm[i], expected[i], 1e-6) << i;
  EXPECT_NEAR(scan.lowest_before_shift_nm, 1.0, 1e-6);
}

TEST(Gsf, WhatASessionLeftComesBackToItsPlace) {
  Scan left;
  left.grid = {3, 2, 10, 5, -40, 7, {-2, 0, 1, -0.5, 0, 0}};
  left.title = "lithography";
  left.in_frame_w = true;
  // Also when it was written again as it was read.
  const Scan read = parse_gsf(format_gsf(left, "s.gsf"), "s.gsf");
  for (const Scan& scan : {read, parse_gsf(format_gsf(read, "s.gsf"), "s.gsf")}) {
    EXPECT_TRUE(scan.in_frame_w);
    EXPECT_NEAR(scan.grid.x_first_nm, 5, 1e-9) << "as every scan, until it is asked for";
    EXPECT_NEAR(*std::min_element(scan.grid.z_nm.begin(), scan.grid.z_nm.end()), 0, 1e-12);
    const HeightGrid grid = heights_in_frame_w(scan);
    EXPECT_NEAR(grid.x_first_nm, -40, 1e-9);
    EXPECT_NEAR(grid.y_first_nm, 7, 1e-9);
    // Single precision: 6e-8 of 2 nm.
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(grid.z_nm[i], left.grid.z_nm[i], 2e-7) << i;
  }
  // A microscope's place is not the session's.
  for (const char* const offset : {"XOffset = 1e-6\n", "XOffset = far\n", "TelenanoFrame = V\n"}) {
    const Scan scan = parse_gsf(gsf(std::string(kGood) + offset), "s.gsf");
    EXPECT_EQ(heights_in_frame_w(scan).x_first_nm, scan.grid.x_first_nm) << offset;
    EXPECT_EQ(heights_in_frame_w(scan).z_nm, scan.grid.z_nm) << offset;
  }
}

TEST(Gsf, PadsWithOneToFourNulBytes) {
  for (int extra = 0; extra < 4; ++extra) {
    const std::string fields = std::string(kGood) + "Title = " + std::string(1 + extra, 'x') + "\n";
    EXPECT_EQ(error_of(gsf(fields)), "no error") << extra;
  }
}

TEST(Gsf, EveryMistakeIsOneLine) {
  const std::string good = gsf(kGood);
  const auto with = [](const std::string& from, const std::string& to) {
    std::string fields = kGood;
    fields.replace(fields.find(from), from.size(), to);
    return gsf(fields);
  };
  const std::string how =
      ": the first line must be 'Gwyddion Simple Field 1.0'; telenano-nve import FILE makes a scene of it";
  EXPECT_EQ(error_of("P5 3 2"), "s.gsf: is no Gwyddion Simple Field" + how);
  EXPECT_EQ(error_of(""), "s.gsf: is no Gwyddion Simple Field" + how);
  // As files of other programs begin.
  EXPECT_EQ(error_of("GWYPGwyContainer"), "s.gsf: is a Gwyddion file (.gwy), no Gwyddion Simple Field" + how);
  EXPECT_EQ(error_of("\\*File list\r\n\\Version: 0x09"),
            "s.gsf: is a NanoScope file (.spm), no Gwyddion Simple Field" + how);
  EXPECT_EQ(error_of("Gwyddion Simple Field 1.0\nXRes = 3\n"),
            "s.gsf: the header has no end: expected a NUL byte within the first 65536 bytes");
  EXPECT_EQ(error_of(with("XRes = 3\n", "")), "s.gsf: missing key XRes, expected an integer in [2, 8192]");
  EXPECT_EQ(error_of(with("XRes = 3", "XRes = 1")), "s.gsf: XRes is '1', expected an integer in [2, 8192]");
  EXPECT_EQ(error_of(with("XRes = 3", "XRes = 99999999999")),
            "s.gsf: XRes is '99999999999', expected an integer in [2, 8192]");
  EXPECT_EQ(error_of(with("YRes = 2", "YRes = 2.5")),
            "s.gsf: YRes is '2.5', expected an integer in [2, 8192]");
  EXPECT_EQ(error_of(with("XYUnits = m", "XYUnits = um")), "s.gsf: XYUnits is 'um', expected 'm'");
  EXPECT_EQ(error_of(with("ZUnits = m\n", "")), "s.gsf: missing key ZUnits, expected 'm'");
  EXPECT_EQ(error_of(with("XReal = 3e-08\n", "")),
            "s.gsf: missing key XReal, expected a length in [1e-10, 1e-3] m");
  EXPECT_EQ(error_of(with("XReal = 3e-08", "XReal = 30")),
            "s.gsf: XReal is '30', expected a length in [1e-10, 1e-3] m");
  EXPECT_EQ(error_of(with("YReal = 1e-08", "YReal = nan")),
            "s.gsf: YReal is 'nan', expected a length in [1e-10, 1e-3] m");
  EXPECT_EQ(error_of(with("XRes = 3", "XRes 3")),
            "s.gsf: header line 2 is 'XRes 3', expected 'name = value'");
  EXPECT_EQ(error_of(good.substr(0, good.size() - 1)),
            "s.gsf: is truncated: " + std::to_string(good.size() - 1) + " bytes, expected " +
                std::to_string(good.size()) + " for 3 x 2 samples");
  EXPECT_EQ(error_of(good + "x"), "s.gsf: has bytes after the data: " + std::to_string(good.size() + 1) +
                                      " bytes, expected " + std::to_string(good.size()) +
                                      " for 3 x 2 samples");
  std::vector<float> holes = kHeights;
  holes[1] = std::numeric_limits<float>::quiet_NaN();
  holes[4] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(error_of(gsf(kGood, holes)),
            "s.gsf: 2 of 6 heights are not finite; expected finite heights (fill the gaps first)");
  std::vector<float> tall = kHeights;
  tall[0] = 1.0f;
  EXPECT_EQ(error_of(gsf(kGood, tall)),
            "s.gsf: heights range over 1e+09 nm, expected at most 1e5 nm (are they in m?)");
}

TEST(Gsf, ReadsTheRealScan) {
  const Scan scan = read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  EXPECT_EQ(scan.grid.columns, 256);
  EXPECT_EQ(scan.grid.rows, 256);
  EXPECT_NEAR(scan.width_nm, 600.0, 1e-9);
  double highest = 0;
  for (const double z : scan.grid.z_nm) highest = std::max(highest, z);
  EXPECT_NEAR(highest, 14.1, 0.05);  // its README's figure, to the digits given there
}

// Byte for byte the file that another program wrote, but for the header's own fields: real heights survive.
TEST(Gsf, WritesTheRealScanAsItWas) {
  std::string before;
  const Scan scan = read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf", &before);
  const std::string after = format_gsf(scan, "s.gsf");
  const std::size_t data = 4u * 256 * 256;
  EXPECT_EQ(before.substr(before.size() - data), after.substr(after.size() - data));
  const Scan again = parse_gsf(after, "again.gsf");
  EXPECT_EQ(again.grid.z_nm, scan.grid.z_nm);
  EXPECT_EQ(again.width_nm, scan.width_nm);
  EXPECT_EQ(again.height_nm, scan.height_nm);
  EXPECT_EQ(again.title, scan.title);
  EXPECT_EQ(format_gsf(again, "again.gsf"), after);
}

TEST(Gsf, WritesWhatTheFormatSays) {
  Scan scan = parse_gsf(gsf(kGood), "s.gsf");
  EXPECT_EQ(format_gsf(scan, "s.gsf"), gsf(kGood));
  scan.title = "two\nlines ";
  scan.grid.x_first_nm += 100.0;
  EXPECT_EQ(format_gsf(scan, "s.gsf"),
            gsf("XRes = 3\nYRes = 2\nXReal = 3e-08\nYReal = 1e-08\nXOffset = 1e-07\nXYUnits = m\nZUnits = "
                "m\nTitle = two lines\n"));
}

TEST(Gsf, ATitleWithControlCharactersComesBackAsItWasRead) {
  const Scan scan = parse_gsf(gsf(std::string(kGood) + "Title = a\x01"
                                                       "b\x02\n"),
                              "s.gsf");
  EXPECT_EQ(scan.title, "a b");
  EXPECT_EQ(parse_gsf(format_gsf(scan, "s.gsf"), "s.gsf").title, scan.title);
}

TEST(Gsf, ReplacesAFileInOneMove) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "gsf_write_test";
  std::filesystem::create_directories(folder);
  const std::string path = (folder / "out.gsf").string();
  Scan scan = parse_gsf(gsf(kGood), "s.gsf");
  write_gsf(path, scan);
  scan.grid.z_nm[4] = 0.5;
  write_gsf(path, scan);
  EXPECT_NEAR(read_gsf(path).grid.z_nm[4], 0.5, 1e-6);
  EXPECT_FALSE(std::filesystem::exists(path + ".part"));
  const auto failure = [&](const std::string& where) -> std::string {
    try {
      write_gsf(where, scan);
    } catch (const RunError& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_EQ(failure((folder / "no/such.gsf").string()),
            (folder / "no/such.gsf").string() +
                ": the surface cannot be written: No such file or "
                "directory");
  EXPECT_EQ(failure(folder.string()), folder.string() + ": the surface cannot be written: it is a folder");
  const std::string pipe = (folder / "pipe").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(failure(pipe), pipe + ": the surface cannot be written: it is no regular file");
  EXPECT_TRUE(std::filesystem::is_fifo(pipe));  // not replaced
  scan.grid.z_nm[0] = std::numeric_limits<double>::infinity();
  EXPECT_THROW(write_gsf(path, scan), UserError);
  EXPECT_NEAR(read_gsf(path).grid.z_nm[4], 0.5, 1e-6);  // the old one is still there
  std::filesystem::remove_all(folder);
}

TEST(Gsf, AFileThatIsThereIsNeverCreated) {
  const auto folder =
      std::filesystem::temp_directory_path() / ("telenano_gsf_new_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const auto text_of = [](const std::string& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  };
  const std::string path = (folder / "s.gsf").string();
  Scan scan = parse_gsf(gsf(kGood), "s.gsf");
  ASSERT_TRUE(create_gsf(path, scan));
  EXPECT_FALSE(std::filesystem::exists(path + ".part"));
  const std::string before = text_of(path);
  EXPECT_EQ(before, format_gsf(scan, "s.gsf"));
  scan.grid.z_nm[4] = 0.5;
  EXPECT_FALSE(create_gsf(path, scan));
  EXPECT_EQ(text_of(path), before);
  // What another program writes there just now, or has left when it was killed.
  const std::string second = (folder / "t.gsf").string();
  std::ofstream(second + ".part") << "half";
  EXPECT_FALSE(create_gsf(second, scan));
  EXPECT_EQ(text_of(second + ".part"), "half");
  EXPECT_FALSE(std::filesystem::exists(second));
  // A name that points nowhere is somebody's too.
  const std::string link = (folder / "u.gsf").string();
  std::filesystem::create_symlink("nowhere", link);
  EXPECT_FALSE(create_gsf(link, scan));
  EXPECT_THROW(create_gsf((folder / "no/such.gsf").string(), scan), RunError);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace telenano::surface
