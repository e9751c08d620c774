#include "telenano/master/app/run/next_run.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "telenano/master/app/recordings/free_recording.h"

namespace telenano::app {
namespace {

class NextRunWords : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_next_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void make(const std::string& name) const { std::ofstream(path(name)) << "x"; }

  std::filesystem::path folder_;
};

TEST_F(NextRunWords, ARecordingIsNeverReplaced) {
  EXPECT_EQ(free_recording(""), "");
  EXPECT_EQ(free_recording(path("a.h5")), path("a.h5"));
  make("a.h5");
  EXPECT_EQ(free_recording(path("a.h5")), path("a-2.h5"));
  make("a-2.h5");
  EXPECT_EQ(free_recording(path("a.h5")), path("a-3.h5"));
  EXPECT_EQ(free_recording(path("a-2.h5")), path("a-3.h5"));
}

TEST_F(NextRunWords, OnlyTheRecordingIsAnother) {
  make("a.h5");
  using Words = std::vector<std::string>;
  EXPECT_EQ(words_of_next_run({"telenano-master", "run", "--record", path("a.h5"), "--view"}),
            (Words{"telenano-master", "run", "--record", path("a-2.h5"), "--view"}));
  EXPECT_EQ(words_of_next_run({"m", "run", "--record=" + path("a.h5")}),
            (Words{"m", "run", "--record=" + path("a-2.h5")}));
  EXPECT_EQ(words_of_next_run({"m", "run", "--record", path("a.h5"), "--overwrite"}),
            (Words{"m", "run", "--record", path("a.h5"), "--overwrite"}));
  EXPECT_EQ(words_of_next_run({"m", "run", "--record"}), (Words{"m", "run", "--record"}));
  EXPECT_EQ(words_of_next_run({}), Words{});
}

TEST_F(NextRunWords, AnotherSampleTakesThePlaceOfTheOneBefore) {
  using Words = std::vector<std::string>;
  EXPECT_EQ(words_of_next_run({"m", "run", "--view"}, "flat PDMS"),
            (Words{"m", "run", "--view", "--server-scene", "flat PDMS"}));
  EXPECT_EQ(words_of_next_run({"m", "run", "--server-scene", "a", "--view", "--server-scene=b"}, "c"),
            (Words{"m", "run", "--view", "--server-scene", "c"}));
  EXPECT_EQ(words_of_next_run({"m", "run", "--server-scene", "a"}),
            (Words{"m", "run", "--server-scene", "a"}));
}

TEST_F(NextRunWords, NotBegunItGoesSilently) {
  const NextRun next;
  EXPECT_FALSE(next.asked());
}

}  // namespace
}  // namespace telenano::app
