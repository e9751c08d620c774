#include "telenano/common/rt/latest_value.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace telenano::rt {
namespace {

struct Wide {
  std::uint64_t number = 0;
  std::array<std::uint64_t, 31> copies{};
  std::uint8_t odd_size = 7;
};

TEST(LatestValue, StartsWithADefaultAndKeepsTheNewest) {
  LatestValue<Wide> latest;
  EXPECT_EQ(latest.count(), 0u);
  EXPECT_EQ(latest.load().odd_size, 7);
  Wide value;
  for (std::uint64_t i = 1; i <= 3; ++i) {
    value.number = i;
    latest.store(value);
  }
  EXPECT_EQ(latest.load().number, 3u);
  EXPECT_EQ(latest.count(), 3u);
}

/// Readers that run against a writer see whole values only, and never an older one after a newer one.
TEST(LatestValue, IsNeverTornNorGoesBack) {
  constexpr int kReaders = 2;
  constexpr std::uint64_t kWrites = 300'000;
  LatestValue<Wide> latest;
  std::atomic<bool> done{false};
  std::array<bool, kReaders> whole{};
  std::array<bool, kReaders> forward{};
  std::vector<std::thread> readers;
  for (int r = 0; r < kReaders; ++r) {
    readers.emplace_back([&, r] {
      bool all_whole = true;
      bool all_forward = true;
      std::uint64_t last = 0;
      Wide value;
      while (!done.load(std::memory_order_acquire)) {
        if (!latest.try_load(value)) continue;
        for (const std::uint64_t copy : value.copies) all_whole = all_whole && copy == value.number;
        all_forward = all_forward && value.number >= last;
        last = value.number;
      }
      whole[static_cast<std::size_t>(r)] = all_whole;
      forward[static_cast<std::size_t>(r)] = all_forward;
    });
  }
  Wide value;
  for (std::uint64_t i = 1; i <= kWrites; ++i) {
    value.number = i;
    value.copies.fill(i);
    latest.store(value);
    if (i % 512 == 0) std::this_thread::yield();
  }
  done.store(true, std::memory_order_release);
  for (std::thread& reader : readers) reader.join();
  for (int r = 0; r < kReaders; ++r) {
    EXPECT_TRUE(whole[static_cast<std::size_t>(r)]);
    EXPECT_TRUE(forward[static_cast<std::size_t>(r)]);
  }
  EXPECT_EQ(latest.load().number, kWrites);
}

}  // namespace
}  // namespace telenano::rt
