// The user's folder of scenes: kept, found, bounded, and nothing in it believed.
#include "telenano/master/scene/scene_cache.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

namespace telenano::scene_store {
namespace {

namespace fs = std::filesystem;

class Cache : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_sha256()) GTEST_SKIP() << "built without OpenSSL";
    std::string made = (fs::temp_directory_path() / "telenano_cache_XXXXXX").string();
    ASSERT_NE(::mkdtemp(made.data()), nullptr);
    base_ = made;
    folder_ = base_ / "below" / "telenano";
  }
  void TearDown() override {
    std::error_code ignored;
    if (!base_.empty()) fs::remove_all(base_, ignored);
  }
  fs::path file_of(const std::string& bundle) const { return folder_ / (hex(sha256(bundle)) + ".scene"); }
  static mode_t mode(const fs::path& path) {
    struct stat about {};
    return ::lstat(path.c_str(), &about) == 0 ? about.st_mode & 0777 : 0;
  }

  fs::path base_, folder_;
};

TEST_F(Cache, KeepsWhatOnlyItsUserMayRead) {
  ::umask(0);  // not what keeps the others out
  const SceneCache cache(folder_);
  const std::string bundle(100'000, 'x');
  const Sha256 hash = sha256(bundle);
  EXPECT_FALSE(cache.read(hash, bundle.size()));
  EXPECT_EQ(cache.keep(hash, bundle), "");
  EXPECT_EQ(cache.read(hash, bundle.size()), bundle);
  EXPECT_EQ(mode(folder_), 0700u);
  EXPECT_EQ(mode(file_of(bundle)), 0600u);
  EXPECT_EQ(cache.keep(hash, bundle), "") << "again";
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(Cache, BelievesNoFile) {
  const SceneCache cache(folder_);
  const std::string bundle = "a scene";
  const Sha256 hash = sha256(bundle);
  const auto refused = [&] { return !cache.read(hash, bundle.size()); };
  ASSERT_EQ(cache.keep(hash, bundle), "");
  std::ofstream(file_of(bundle)) << "b scene";  // as long
  EXPECT_TRUE(refused());
  EXPECT_FALSE(fs::exists(file_of(bundle))) << "what is not what its name says goes";
  ASSERT_EQ(cache.keep(hash, bundle), "");
  fs::resize_file(file_of(bundle), 1u << 30);  // sparse
  EXPECT_TRUE(refused());
  // A link to another file, even to the right bytes; a pipe nobody writes to; a folder.
  std::ofstream(base_ / "elsewhere") << bundle;
  fs::create_symlink(base_ / "elsewhere", file_of(bundle));
  EXPECT_TRUE(refused());
  fs::remove(file_of(bundle));
  ASSERT_EQ(::mkfifo(file_of(bundle).c_str(), 0600), 0);
  EXPECT_TRUE(refused());
  fs::remove(file_of(bundle));
  fs::create_directory(file_of(bundle));
  EXPECT_TRUE(refused());
  EXPECT_NE(cache.keep(hash, bundle), "");
  EXPECT_TRUE(fs::exists(base_ / "elsewhere"));
}

TEST_F(Cache, DoesNotUseAFolderThatOthersMayWriteTo) {
  fs::create_directories(folder_);
  for (const mode_t open : {0777, 0755, 0710}) {
    ASSERT_EQ(::chmod(folder_.c_str(), open), 0);
    const SceneCache cache(folder_);
    const std::string why = cache.keep(sha256("a"), "a");
    EXPECT_NE(why.find("chmod 700"), std::string::npos) << why;
    EXPECT_EQ(why.find('\n'), std::string::npos);
    EXPECT_FALSE(cache.read(sha256("a"), 1));
  }
  ASSERT_EQ(::chmod(folder_.c_str(), 0700), 0);
  fs::create_directory_symlink(folder_, base_ / "link");
  EXPECT_NE(SceneCache(base_ / "link").keep(sha256("a"), "a"), "");
  EXPECT_NE(SceneCache("").keep(sha256("a"), "a"), "");
}

TEST_F(Cache, LetsTheOldestGo) {
  const SceneCache cache(folder_, 2500);
  const auto scene = [](char c) { return std::string(1000, c); };
  const auto here = [&](char c) { return cache.read(sha256(scene(c)), 1000).has_value(); };
  const auto age = [&](char c, int hours) {
    fs::last_write_time(file_of(scene(c)), fs::file_time_type::clock::now() - std::chrono::hours(hours));
  };
  ASSERT_EQ(cache.keep(sha256(scene('a')), scene('a')), "");
  ASSERT_EQ(cache.keep(sha256(scene('b')), scene('b')), "");
  age('a', 3);
  age('b', 2);
  std::ofstream(folder_ / "notes.txt") << std::string(5000, 'n');  // not ours
  EXPECT_TRUE(here('a')) << "using it makes it young";
  ASSERT_EQ(cache.keep(sha256(scene('c')), scene('c')), "");
  EXPECT_FALSE(here('b'));
  EXPECT_TRUE(here('a'));
  EXPECT_TRUE(here('c'));
  EXPECT_TRUE(fs::exists(folder_ / "notes.txt"));
  EXPECT_NE(cache.keep(sha256(std::string(3000, 'd')), std::string(3000, 'd')), "");
}

// The server, or whoever else of this user came first, has made the folder above for all to see.
TEST_F(Cache, KeepsInAFolderOfItsOwn) {
  fs::create_directories(base_ / "telenano" / "fields");
  fs::permissions(base_ / "telenano", fs::perms(0755));
  ::setenv("XDG_CACHE_HOME", base_.c_str(), 1);
  const SceneCache cache(SceneCache::users_folder());
  EXPECT_EQ(cache.keep(sha256("bundle"), "bundle"), "");
  EXPECT_EQ(cache.read(sha256("bundle"), 6), "bundle");
}

TEST_F(Cache, IsWhereTheUserWantsIt) {
  ::setenv("XDG_CACHE_HOME", "/somewhere", 1);
  EXPECT_EQ(SceneCache::users_folder(), "/somewhere/telenano/scenes");
  ::setenv("XDG_CACHE_HOME", "not/absolute", 1);
  ::setenv("HOME", "/home/anna", 1);
  EXPECT_EQ(SceneCache::users_folder(), "/home/anna/.cache/telenano/scenes");
  ::unsetenv("XDG_CACHE_HOME");
  ::unsetenv("HOME");
  EXPECT_EQ(SceneCache::users_folder(), "");
}

}  // namespace
}  // namespace telenano::scene_store
