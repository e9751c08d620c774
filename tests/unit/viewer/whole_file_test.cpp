#include "telenano/master/viewer/whole_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/master/viewer/png.h"

namespace telenano::viewer {
namespace {

std::string failure_of(const std::string& path, const std::string& bytes) {
  try {
    write_whole_file(path, bytes, "the data");
  } catch (const RunError& error) {
    return error.what();
  }
  return "";
}

TEST(WholeFile, IsWrittenAsItIs) {
  const std::string path =
      (std::filesystem::temp_directory_path() / ("telenano_whole_" + std::to_string(::getpid()))).string();
  const std::string bytes = "a\0b\n" + std::string(100'000, 'x');
  EXPECT_EQ(failure_of(path, "longer than what comes after it"), "");
  EXPECT_EQ(failure_of(path, bytes), "");
  std::ostringstream read;
  read << std::ifstream(path, std::ios::binary).rdbuf();
  EXPECT_EQ(read.str(), bytes);
  std::filesystem::remove(path);
}

// A device that is always full: every write says so. A picture goes the same way.
TEST(WholeFile, AFullDiskIsToldWithItsReason) {
  EXPECT_EQ(failure_of("/dev/full", "x"),
            "/dev/full: the data cannot be written: No space left on device; check the folder, its "
            "permissions and its "
            "free space");
  EXPECT_TRUE(std::filesystem::exists("/dev/full")) << "a device stays";
  EXPECT_THROW(write_png("/dev/full", {2, 2, std::vector<unsigned char>(12, 7)}), RunError);
  EXPECT_NE(failure_of("/no/such/folder/x", "x").find("No such file or directory"), std::string::npos);
}

}  // namespace
}  // namespace telenano::viewer
