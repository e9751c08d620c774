// What the start screen says of files before a session is begun with them.
#include "telenano/master/app/start/file_faults.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <string>

namespace telenano::app {
namespace {

class FileFaults : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_faults_" + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directory(folder_);
    std::ofstream(path("a.key")) << "a key";
  }
  void TearDown() override {
    ::chmod(folder_.c_str(), 0755);
    std::filesystem::remove_all(folder_);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  static bool says(const std::string& fault, const std::string& words) {
    EXPECT_EQ(fault.find('\n'), std::string::npos) << fault;
    EXPECT_LT(fault.size(), 120u) << fault;
    return fault.find(words) != std::string::npos;
  }
  /// Root may do all: the look of another user, in a process of its own. -1: this one may not become another.
  static int as_nobody(const std::function<bool()>& holds) {
    const pid_t child = ::fork();
    if (child == 0) {
      if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(2);
      ::_exit(holds() ? 1 : 0);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 0;
    return code == 2 ? -1 : code;
  }
  std::filesystem::path folder_;
};

TEST_F(FileFaults, AFileThatIsReadMustBeThere) {
  EXPECT_EQ(read_fault(path("a.key")), "");
  EXPECT_TRUE(says(read_fault(path("b.key")), "no such file")) << read_fault(path("b.key"));
  EXPECT_TRUE(says(read_fault(folder_.string()), "is a folder")) << read_fault(folder_.string());
  EXPECT_TRUE(says(read_fault("/dev/null"), "no plain file"));
  EXPECT_TRUE(says(read_fault(path("a.key/b")), "is no folder")) << read_fault(path("a.key/b"));
  EXPECT_TRUE(says(read_fault(std::string(256, 'x')), "too long"));
  EXPECT_TRUE(says(read_fault(std::string(10000, 'x')), "too long"));
  EXPECT_TRUE(says(read_fault("\xff\x01"), "no such file")) << "any bytes may be a name";
  ::chmod(path("a.key").c_str(), 0);
  const int told = as_nobody([&] { return says(read_fault(path("a.key")), "may not read"); });
  if (told >= 0) {
    EXPECT_EQ(told, 1);
  }
}

TEST_F(FileFaults, ARecordingNeedsAFreeNameInAFolderThatCanBeWritten) {
  EXPECT_EQ(recording_fault(path("s.h5")), "");
  EXPECT_EQ(recording_fault("a name that nobody has.h5"), "") << "here";
  EXPECT_TRUE(says(recording_fault(path("a.key")), "exists already"));
  EXPECT_TRUE(says(recording_fault(folder_.string()), "is a folder"));
  EXPECT_TRUE(says(recording_fault(path("none/s.h5")), "no such folder"))
      << recording_fault(path("none/s.h5"));
  EXPECT_TRUE(says(recording_fault(path("none/")), "no such folder")) << recording_fault(path("none/"));
  EXPECT_TRUE(says(recording_fault(path("a.key/s.h5")), "is no folder"));
  EXPECT_TRUE(says(recording_fault(path(std::string(256, 'x'))), "too long"));
  EXPECT_TRUE(says(recording_fault(std::string(10000, 'x')), "too long"));
  ::chmod(folder_.c_str(), 0555);
  const int told = as_nobody([&] { return says(recording_fault(path("s.h5")), "may not write"); });
  if (told >= 0) {
    EXPECT_EQ(told, 1);
  }
  ::chmod(folder_.c_str(), 0);
  const int closed = as_nobody([&] { return says(recording_fault(path("s.h5")), "may not look into"); });
  if (closed >= 0) {
    EXPECT_EQ(closed, 1);
  }
}

}  // namespace
}  // namespace telenano::app
