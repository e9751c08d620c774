#include "telenano/common/config/shared_files.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "telenano/common/base/error.h"

namespace telenano::config {
namespace {
namespace fs = std::filesystem;

class SharedFiles : public testing::Test {
 protected:
  void SetUp() override {
    home_ = fs::temp_directory_path() / ("telenano_shared_files_" + std::to_string(::getpid()));
    fs::create_directories(home_ / "shelf/scenes");
    fs::create_directories(home_ / "desk");
    for (const char* name : {"gold.toml", "mica.toml", "notes.txt"})
      std::ofstream(home_ / "shelf/scenes" / name) << name;
    before_ = fs::current_path();
    fs::current_path(home_ / "desk");
    ::setenv("TELENANO_SHARE", (home_ / "shelf").c_str(), 1);
  }
  void TearDown() override {
    ::unsetenv("TELENANO_SHARE");
    fs::current_path(before_);
    fs::remove_all(home_);
  }
  fs::path home_, before_;
};

TEST_F(SharedFiles, FindsWhatCameWithTheProgramByName) {
  const std::string gold = (home_ / "shelf/scenes/gold.toml").string();
  EXPECT_EQ(find_shared("gold", "scenes", ".toml"), gold);
  EXPECT_EQ(find_shared("gold.toml", "scenes", ".toml"), gold);
  EXPECT_EQ(shared_names("scenes", ".toml"), (std::vector<std::string>{"gold", "mica"}));
}

TEST_F(SharedFiles, AFileHereGoesFirst) {
  std::ofstream("gold.toml") << "mine";
  EXPECT_EQ(find_shared("gold.toml", "scenes", ".toml"), "gold.toml");
}

// A path is what it says, so that its own reader can tell what is wrong with it.
TEST_F(SharedFiles, WhatHasASlashIsAPath) {
  EXPECT_EQ(find_shared("./gold", "scenes", ".toml"), "./gold");
  EXPECT_EQ(find_shared("/nowhere/gold.toml", "scenes", ".toml"), "/nowhere/gold.toml");
  EXPECT_EQ(find_shared("", "scenes", ".toml"), "");
}

TEST_F(SharedFiles, NamesWhatThereIs) {
  try {
    find_shared("silver", "scenes", ".toml");
    FAIL();
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("has only: gold, mica"), std::string::npos) << error.what();
  }
  EXPECT_THROW(find_shared("gold", "elsewhere", ".toml"), UserError);
}

TEST_F(SharedFiles, WithoutTheVariableTheyLieBesideThePrograms) {
  ::unsetenv("TELENANO_SHARE");
  EXPECT_TRUE(fs::exists(shared_folder() / "scenes/flakes.toml")) << shared_folder();
}

}  // namespace
}  // namespace telenano::config
