#include "telenano/common/security/resumption_cache.h"

#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <vector>

#include "telenano/common/base/random.h"

namespace telenano::security {
namespace {

constexpr ResumptionCache::List kList{1};

ResumptionCache::Id random_id(Random& random) {
  ResumptionCache::Id id;
  for (auto& byte : id) byte = static_cast<std::uint8_t>(256 * random.uniform());
  return id;
}

std::vector<std::uint8_t> bytes(std::size_t size, std::uint8_t fill) {
  return std::vector<std::uint8_t>(size, fill);
}

std::vector<std::uint8_t> found(ResumptionCache& cache, const ResumptionCache::Id& id) {
  std::vector<std::uint8_t> out(ResumptionCache::kMaxBytes);
  out.resize(cache.look_up(id, out));
  return out;
}

TEST(ResumptionCache, GivesWhatWasKeptUntilItIsForgotten) {
  ResumptionCache cache(16);
  Random random(1);
  const auto a = random_id(random), b = random_id(random);
  EXPECT_TRUE(found(cache, a).empty());
  cache.keep(a, kList, bytes(100, 7));
  cache.keep(b, kList, bytes(200, 8));
  EXPECT_EQ(found(cache, a), bytes(100, 7));
  EXPECT_EQ(found(cache, b), bytes(200, 8));
  cache.keep(a, kList, bytes(50, 9));
  EXPECT_EQ(found(cache, a), bytes(50, 9));
  cache.forget(a);
  EXPECT_TRUE(found(cache, a).empty());
  EXPECT_EQ(found(cache, b), bytes(200, 8));
  cache.forget_all();
  EXPECT_TRUE(found(cache, b).empty());
}

TEST(ResumptionCache, ForgetsWhatIsOfOtherLists) {
  ResumptionCache cache(16);
  Random random(4);
  const auto a = random_id(random), b = random_id(random);
  ResumptionCache::List other = kList;
  other.back() = 1;
  cache.keep(a, kList, bytes(10, 1));
  cache.keep(b, other, bytes(10, 2));
  cache.forget_others(other);
  EXPECT_TRUE(found(cache, a).empty());
  EXPECT_EQ(found(cache, b), bytes(10, 2));
  cache.keep(b, kList, bytes(10, 3));
  cache.forget_others(other);
  EXPECT_TRUE(found(cache, b).empty()) << "it was agreed on anew under the list that goes";
}

// Ids that share their first bytes share their places; all 32 bytes tell them apart.
TEST(ResumptionCache, TheOldestOfAFewGivesWay) {
  ResumptionCache cache(1);
  std::vector<ResumptionCache::Id> ids(6);
  for (std::uint8_t i = 0; i < 6; ++i) {
    ids[i].back() = i;
    cache.keep(ids[i], kList, bytes(10, i));
  }
  EXPECT_TRUE(found(cache, ids[0]).empty());
  EXPECT_TRUE(found(cache, ids[1]).empty());
  for (std::uint8_t i = 2; i < 6; ++i) EXPECT_EQ(found(cache, ids[i]), bytes(10, i));
}

// Four ways with a quarter of the places filled: that five or more of 64 meet in one of 64 sets is a chance
// of 64 · P(Poisson(1) > 4) ≈ 0.2, and then one or two of them are lost.
TEST(ResumptionCache, HoldsNearlyAllThatItHasRoomForFourTimes) {
  ResumptionCache cache(256);
  Random random(2);
  std::vector<ResumptionCache::Id> ids;
  for (int i = 0; i < 64; ++i) {
    ids.push_back(random_id(random));
    cache.keep(ids.back(), kList, bytes(10, 1));
  }
  int held = 0;
  for (const auto& id : ids) held += found(cache, id).empty() ? 0 : 1;
  EXPECT_GE(held, 62);
}

TEST(ResumptionCache, WhatIsTooLongOrHasNoRoomIsNotGiven) {
  ResumptionCache cache(16);
  Random random(3);
  const auto a = random_id(random), b = random_id(random);
  cache.keep(a, kList, bytes(ResumptionCache::kMaxBytes + 1, 1));
  EXPECT_TRUE(found(cache, a).empty());
  cache.keep(b, kList, bytes(ResumptionCache::kMaxBytes, 1));
  EXPECT_EQ(found(cache, b).size(), ResumptionCache::kMaxBytes);
  std::vector<std::uint8_t> small(10, 5);
  EXPECT_EQ(cache.look_up(b, small), 0u);
  EXPECT_EQ(small, bytes(10, 5));
}

TEST(ResumptionCache, WorkersUseItAtOnce) {
  ResumptionCache cache(64);
  std::vector<std::thread> workers;
  for (std::uint8_t w = 1; w <= 3; ++w) {
    workers.emplace_back([&cache, w] {
      Random random(9);  // the same ids in each
      for (int i = 0; i < 2000; ++i) {
        const auto id = random_id(random);
        cache.keep(id, kList, bytes(20 + w, w));
        const auto got = found(cache, id);
        for (const auto byte : got) EXPECT_EQ(got.size(), 20u + byte) << "one worker's, whole";
        if (i % 3 == 0) cache.forget(id);
        if (i % 500 == 0) cache.forget_all();
      }
    });
  }
  for (auto& worker : workers) worker.join();
}

}  // namespace
}  // namespace telenano::security
