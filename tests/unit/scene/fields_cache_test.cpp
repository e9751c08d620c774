// Fields kept in files. Oracle: fields made anew, to the last bit; what is damaged by hand must not be read.
#include "telenano/nve_server/scene/fields_cache.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::scene {
namespace {

namespace fs = std::filesystem;
constexpr double kRadius = 20;

physics::HeightGrid ground(unsigned seed = 1) {
  std::mt19937 random(seed);
  physics::HeightGrid grid{20, 18, 2.0, 2.0, 0.0, 0.0, {}};
  for (int i = 0; i < 20 * 18; ++i) grid.z_nm.push_back(static_cast<double>(random() % 10000) * 3e-4);
  return grid;
}

physics::SofteningRule rule() {
  return physics::softening_rule(kRadius, 0.4, 52.5, 0.165);
}

class FieldsCacheTest : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/telenano_fields_XXXXXX";
    ASSERT_NE(::mkdtemp(name), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string folder_;
};

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

TEST_F(FieldsCacheTest, WhatIsKeptComesBackToTheBit) {
  const FieldsCache cache(folder_ + "/of/fields");
  const physics::ScanFields made(ground(), kRadius, rule());
  EXPECT_FALSE(cache.find(ground(), kRadius, rule()));
  ASSERT_TRUE(cache.keep(ground(), kRadius, rule(), {}, made));
  const auto back = cache.find(ground(), kRadius, rule());
  ASSERT_TRUE(back);
  EXPECT_EQ(back->hash(), made.hash());
  EXPECT_EQ(back->levels(), made.levels());
  for (const double z : {-1.0, 0.3, 7.0}) {
    physics::ContactJet a, b;
    made.contact_at({11.3, 17.2, 2.0 + z}, a);
    back->contact_at({11.3, 17.2, 2.0 + z}, b);
    EXPECT_EQ(a.overlap_nm, b.overlap_nm);
    EXPECT_EQ(a.overlap_hess_per_nm, b.overlap_hess_per_nm);
    EXPECT_EQ(a.log_radius_grad_per_nm, b.log_radius_grad_per_nm);
  }
  // For the user alone, and nothing half written beside it.
  struct stat about {};
  ASSERT_EQ(::stat(cache.path(ground(), kRadius, rule()).c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600u);
  ASSERT_EQ(::stat(cache.folder().c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0700u);
  EXPECT_EQ(std::distance(fs::directory_iterator(cache.folder()), {}), 1);
}

// Each of what the fields depend on, changed by the least that it can be.
TEST_F(FieldsCacheTest, AnotherGroundTipOrRuleIsNotFound) {
  const FieldsCache cache(folder_);
  const physics::ScanFields made(ground(), kRadius, rule());
  ASSERT_TRUE(cache.keep(ground(), kRadius, rule(), {}, made));
  physics::HeightGrid other = ground();
  other.z_nm[200] = std::nextafter(other.z_nm[200], 10.0);
  EXPECT_FALSE(cache.find(other, kRadius, rule()));
  other = ground();
  other.dx_nm = std::nextafter(other.dx_nm, 10.0);
  EXPECT_FALSE(cache.find(other, kRadius, rule()));
  const physics::RetractionKernel law([](double gap, double) { return gap < 0 ? -1 - gap : -1 / (1 + gap); },
                                      kRadius);
  ASSERT_TRUE(law.active());
  EXPECT_FALSE(cache.find(ground(), kRadius, rule(), {}, &law));
  EXPECT_FALSE(cache.find(ground(), std::nextafter(kRadius, 30.0), rule()));
  for (double physics::SofteningRule::*part :
       {&physics::SofteningRule::finest_nm, &physics::SofteningRule::coarsest_nm,
        &physics::SofteningRule::pressed_growth, &physics::SofteningRule::gap_growth,
        &physics::SofteningRule::dead_zone_nm, &physics::SofteningRule::pressed_onset_nm}) {
    physics::SofteningRule changed = rule();
    changed.*part = std::nextafter(changed.*part, 100.0);
    EXPECT_FALSE(cache.find(ground(), kRadius, changed));
  }
  // Even under the right name: the key is compared.
  fs::copy_file(cache.path(ground(), kRadius, rule()), cache.path(other, kRadius, rule()));
  EXPECT_FALSE(cache.find(other, kRadius, rule()));
  EXPECT_TRUE(cache.find(ground(), kRadius, rule()));
}

TEST_F(FieldsCacheTest, ADamagedFileIsAsIfItWasNotThere) {
  const FieldsCache cache(folder_);
  const physics::ScanFields made(ground(), kRadius, rule());
  ASSERT_TRUE(cache.keep(ground(), kRadius, rule(), {}, made));
  const std::string path = cache.path(ground(), kRadius, rule());
  const std::string good = bytes_of(path);
  std::mt19937 random(3);
  for (int n = 0; n < 300; ++n) {  // one bit, anywhere
    std::string bad = good;
    const std::size_t at = n < 64 ? static_cast<std::size_t>(n) : random() % bad.size();
    bad[at] = static_cast<char>(bad[at] ^ (1 << (random() % 8)));
    write(path, bad);
    EXPECT_FALSE(cache.find(ground(), kRadius, rule())) << at;
  }
  for (const std::size_t length : {std::size_t{0}, std::size_t{7}, std::size_t{24}, std::size_t{48},
                                   good.size() / 2, good.size() - 8, good.size() - 1}) {
    write(path, good.substr(0, length));
    EXPECT_FALSE(cache.find(ground(), kRadius, rule())) << length;
  }
  write(path, good + std::string(8, '\0'));
  EXPECT_FALSE(cache.find(ground(), kRadius, rule()));
  // A head that asks for more than there is, or for a sum of sizes that wraps round.
  for (const std::uint64_t count : {~std::uint64_t{0}, std::uint64_t{1} << 61, std::uint64_t{1} << 40}) {
    std::string bad = good;
    std::memcpy(&bad[24], &count, 8);
    write(path, bad);
    EXPECT_FALSE(cache.find(ground(), kRadius, rule())) << count;
  }
  write(path, good);
  EXPECT_TRUE(cache.find(ground(), kRadius, rule()));
}

// A checksum is no seal: someone who can write the file makes it right. Then the coefficients must still be
// such as a ground has. The sum is made by keep() itself, from fields that restored() would not give.
TEST_F(FieldsCacheTest, CoefficientsThatNoGroundHasAreRefused) {
  const auto refused = [](std::size_t lane, double value) {
    const physics::ScanFields made(ground(), kRadius, rule());
    std::vector<std::vector<double>> all;
    for (const auto part : made.coefficients()) all.emplace_back(part.begin(), part.end());
    EXPECT_TRUE(physics::ScanFields::restored(ground(), kRadius, rule(), {}, all).has_value());
    all[1][6 * 37 + lane] = value;
    return !physics::ScanFields::restored(ground(), kRadius, rule(), {}, std::move(all)).has_value();
  };
  for (const std::size_t odd : {0u, 3u}) {
    for (const double value : {double(NAN), double(INFINITY), -1e9, 1e9}) EXPECT_TRUE(refused(odd, value));
    for (const double value : {double(NAN), 60.0, -60.0}) EXPECT_TRUE(refused(odd + 1, value));
    for (const double value : {double(NAN), 0.0, -0.3, 1.5}) EXPECT_TRUE(refused(odd + 2, value));
  }
  std::vector<std::vector<double>> none;
  EXPECT_FALSE(physics::ScanFields::restored(ground(), kRadius, rule(), {}, none).has_value());
}

TEST_F(FieldsCacheTest, AFileOfOthersALinkOrAPipeIsNotRead) {
  const FieldsCache cache(folder_);
  const physics::ScanFields made(ground(), kRadius, rule());
  ASSERT_TRUE(cache.keep(ground(), kRadius, rule(), {}, made));
  const std::string path = cache.path(ground(), kRadius, rule());
  ::chmod(path.c_str(), 0660);
  EXPECT_FALSE(cache.find(ground(), kRadius, rule()));
  ::chmod(path.c_str(), 0600);
  EXPECT_TRUE(cache.find(ground(), kRadius, rule()));
  fs::rename(path, folder_ + "/elsewhere");
  fs::create_symlink(folder_ + "/elsewhere", path);
  EXPECT_FALSE(cache.find(ground(), kRadius, rule()));
  fs::remove(path);
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  EXPECT_FALSE(cache.find(ground(), kRadius, rule()));  // nor waits for a writer
  fs::remove(path);
  fs::create_directory(path);
  EXPECT_FALSE(cache.find(ground(), kRadius, rule()));
  EXPECT_FALSE(cache.keep(ground(), kRadius, rule(), {}, made));
}

TEST_F(FieldsCacheTest, TheLongestUnusedMakeRoom) {
  const physics::ScanFields made(ground(1), kRadius, rule());
  const std::uint64_t one = made.bytes() + 8 * (ground().z_nm.size() + 64);
  const FieldsCache cache(folder_, 3 * one);
  for (unsigned seed = 1; seed <= 3; ++seed) {
    ASSERT_TRUE(
        cache.keep(ground(seed), kRadius, rule(), {}, physics::ScanFields(ground(seed), kRadius, rule())));
    const auto used = fs::file_time_type::clock::now() - std::chrono::hours(10 - seed);
    fs::last_write_time(cache.path(ground(seed), kRadius, rule()), used);
  }
  ASSERT_TRUE(cache.find(ground(1), kRadius, rule()));  // used now
  ASSERT_TRUE(cache.keep(ground(4), kRadius, rule(), {}, physics::ScanFields(ground(4), kRadius, rule())));
  EXPECT_TRUE(cache.find(ground(1), kRadius, rule()));
  EXPECT_FALSE(cache.find(ground(2), kRadius, rule()));
  EXPECT_TRUE(cache.find(ground(3), kRadius, rule()));
  EXPECT_TRUE(cache.find(ground(4), kRadius, rule()));
  // What alone is larger than the folder may be is not kept.
  EXPECT_FALSE(FieldsCache(folder_ + "/small", 1000).keep(ground(1), kRadius, rule(), {}, made));
  EXPECT_FALSE(FieldsCache("/proc/none", 3 * one).keep(ground(1), kRadius, rule(), {}, made));
}

TEST(FieldsCacheFolder, IsTheUsersUnlessSwitchedOff) {
  const auto with = [](const char* name, const char* value) { ::setenv(name, value, 1); };
  with("HOME", "/home/one");
  ::unsetenv("XDG_CACHE_HOME");
  ::unsetenv("CACHE_DIRECTORY");
  ::unsetenv("TELENANO_CACHE");
  EXPECT_EQ(FieldsCache::folder_of_user(), "/home/one/.cache/telenano/fields");
  with("XDG_CACHE_HOME", "relative");  // the specification: to be ignored
  EXPECT_EQ(FieldsCache::folder_of_user(), "/home/one/.cache/telenano/fields");
  with("XDG_CACHE_HOME", "/caches");
  EXPECT_EQ(FieldsCache::folder_of_user(), "/caches/telenano/fields");
  with("CACHE_DIRECTORY", "/var/cache/telenano");
  EXPECT_EQ(FieldsCache::folder_of_user(), "/var/cache/telenano/fields");
  with("TELENANO_CACHE", "/mine");
  EXPECT_EQ(FieldsCache::folder_of_user(), "/mine");
  with("TELENANO_CACHE", "off");
  EXPECT_EQ(FieldsCache::folder_of_user(), "");
  ::unsetenv("TELENANO_CACHE");
  ::unsetenv("CACHE_DIRECTORY");
}

}  // namespace
}  // namespace telenano::scene
