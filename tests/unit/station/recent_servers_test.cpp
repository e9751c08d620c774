// What the start screen remembers, and what it tells of a session that has ended.
#include "telenano/master/app/start/recent_servers.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "telenano/master/app/start/own_program.h"

namespace telenano::app {
namespace {

class RecentServersTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_recent_" + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string folder() const { return (folder_ / "telenano").string(); }
  std::filesystem::path folder_;
};

TEST_F(RecentServersTest, TheNewestIsFirstAndEachIsThereOnce) {
  RecentServers first(folder());
  EXPECT_TRUE(first.list().empty());
  first.note({"a:1", ""});
  first.note({"b:2", "/keys/lab.key"});
  first.note({"a:1", "new.key", "flakes"});
  const RecentServers again(folder());
  ASSERT_EQ(again.list().size(), 2u);
  EXPECT_EQ(again.list()[0].server, "a:1");
  EXPECT_EQ(again.list()[0].key, "new.key");
  EXPECT_EQ(again.list()[0].scene, "flakes");
  EXPECT_EQ(again.list()[1].scene, "");
  EXPECT_EQ(again.list()[1].key, "/keys/lab.key");
}

TEST_F(RecentServersTest, AKeyPairIsKeptWithAndWithoutAScene) {
  RecentServers first(folder());
  first.note({"a:1", "", "", "omega 1.id", "sha256:ab,sha256:cd"});
  first.note({"b:2", "", "flakes", "x.id", "sha256:ef"});
  first.note({"c:3", "c.key", "flat"});
  const RecentServers again(folder());
  ASSERT_EQ(again.list().size(), 3u);
  EXPECT_EQ(again.list()[0].key, "c.key");
  EXPECT_EQ(again.list()[0].identity + again.list()[0].server_key, "");
  EXPECT_EQ(again.list()[1].scene, "flakes");
  EXPECT_EQ(again.list()[1].identity, "x.id");
  EXPECT_EQ(again.list()[1].server_key, "sha256:ef");
  EXPECT_EQ(again.list()[2].key + again.list()[2].scene, "");
  EXPECT_EQ(again.list()[2].identity, "omega 1.id");
  EXPECT_EQ(again.list()[2].server_key, "sha256:ab,sha256:cd");
}

TEST_F(RecentServersTest, AFewAreKept) {
  RecentServers servers(folder());
  for (int i = 0; i < 20; ++i) servers.note({"host:" + std::to_string(i), ""});
  const RecentServers again(folder());
  ASSERT_EQ(again.list().size(), RecentServers::kMost);
  EXPECT_EQ(again.list()[0].server, "host:19");
}

TEST_F(RecentServersTest, NothingThatBreaksALineAndNoForeignFileDoesHarm) {
  RecentServers servers(folder());
  servers.note({"a\tb:1", ""});
  servers.note({"a:1", "x\ny"});
  servers.note({"", ""});
  servers.note({"a:1", "", "", "x\ty", "sha256:ab"});
  EXPECT_TRUE(servers.list().empty());
  RecentServers strange(folder());
  strange.note({"c:1", "", "a\nb"});
  EXPECT_EQ(RecentServers(folder()).list().at(0).scene, "") << "a server's own word";
  std::filesystem::create_directories(folder());
  std::ofstream(folder() + "/servers") << "\tno server\nno tab\n\nhost:9\t\n"
                                       << std::string(5000, 'x') << "\n";
  const RecentServers read(folder());
  ASSERT_EQ(read.list().size(), 1u);
  EXPECT_EQ(read.list()[0].server, "host:9");
  RecentServers nowhere("");
  nowhere.note({"a:1", ""});
  EXPECT_EQ(nowhere.list().size(), 1u) << "without a folder it lasts as long as the program";
}

TEST_F(RecentServersTest, TheFolderIsTheSpecificationsOwn) {
  ::setenv("HOME", "/home/somebody", 1);
  ::setenv("XDG_STATE_HOME", "/states", 1);
  EXPECT_EQ(RecentServers::users_folder(), "/states/telenano");
  ::setenv("XDG_STATE_HOME", "relative", 1);
  EXPECT_EQ(RecentServers::users_folder(), "/home/somebody/.local/state/telenano");
  ::unsetenv("HOME");
  EXPECT_EQ(RecentServers::users_folder(), "");
}

TEST(LastLines, OfASummaryTheHeadAndTheCause) {
  std::string text = "session 1 on scene 'flakes'\n1.0 s progress\nsummary of 5.1 s\n";
  for (int i = 0; i < 30; ++i) text += "  row " + std::to_string(i) + "\n";
  text += "telenano-master: the server has been silent\n";
  const auto lines = last_lines(text, 5);
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[0], "summary of 5.1 s");
  EXPECT_EQ(lines[1], "  row 0");
  EXPECT_EQ(lines[4], "telenano-master: the server has been silent");
  EXPECT_EQ(last_lines("a\n\nb\nc\n", 2), (std::vector<std::string>{"b", "c"}));
  EXPECT_TRUE(last_lines("", 3).empty());
}

}  // namespace
}  // namespace telenano::app
