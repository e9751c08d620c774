#include "telenano/common/rt/spsc_queue.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <thread>

#include "tests/support/alloc_guard.h"

namespace telenano::rt {
namespace {

TEST(SpscQueue, IsFirstInFirstOutAndCountsWhatItDrops) {
  SpscQueue<int> queue(4);
  ASSERT_EQ(queue.capacity(), 4u);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(queue.push(i), i < 4);
  EXPECT_EQ(queue.dropped(), 2u);
  int value = -1;
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(queue.pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(queue.pop(value));
  EXPECT_EQ(value, 3) << "a failed pop must leave the element alone";
}

TEST(SpscQueue, WrapsManyTimes) {
  SpscQueue<std::uint64_t> queue(3);
  EXPECT_EQ(queue.capacity(), 4u) << "rounded up to a power of two";
  std::uint64_t value = 0;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    ASSERT_TRUE(queue.push(2 * i));
    ASSERT_TRUE(queue.push(2 * i + 1));
    ASSERT_TRUE(queue.pop(value));
    EXPECT_EQ(value, 2 * i);
    ASSERT_TRUE(queue.pop(value));
    EXPECT_EQ(value, 2 * i + 1);
  }
  EXPECT_EQ(queue.dropped(), 0u);
}

TEST(SpscQueue, TakesNoMemoryAfterConstruction) {
  SpscQueue<std::array<double, 64>> queue(64);
  std::array<double, 64> element{};
  const support::AllocGuard guard;
  for (int i = 0; i < 1000; ++i) queue.push(element);
  while (queue.pop(element)) {
  }
  EXPECT_EQ(guard.allocations(), 0u);
}

/// Every element is either received whole and in order, or counted as dropped.
TEST(SpscQueue, LosesNothingUncountedBetweenTwoThreads) {
  struct Element {
    std::uint64_t number;
    std::array<std::uint64_t, 15> copies;
  };
  constexpr std::uint64_t kCount = 200'000;
  SpscQueue<Element> queue(256);
  std::atomic<bool> done{false};
  std::uint64_t received = 0;
  bool whole = true;
  bool ordered = true;
  std::thread consumer([&] {
    std::uint64_t last = 0;
    Element element{};
    for (;;) {
      const bool last_look = done.load(std::memory_order_acquire);
      while (queue.pop(element)) {
        ++received;
        ordered = ordered && element.number > last;
        last = element.number;
        for (const std::uint64_t copy : element.copies) whole = whole && copy == element.number;
      }
      if (last_look) return;
    }
  });
  std::uint64_t accepted = 0;
  for (std::uint64_t i = 1; i <= kCount; ++i) {
    Element element{i, {}};
    element.copies.fill(i);
    if (queue.push(element)) ++accepted;
    if (i % 1024 == 0) std::this_thread::yield();
  }
  done.store(true, std::memory_order_release);
  consumer.join();
  EXPECT_TRUE(whole);
  EXPECT_TRUE(ordered);
  EXPECT_EQ(received, accepted);
  EXPECT_EQ(accepted + queue.dropped(), kCount);
}

}  // namespace
}  // namespace telenano::rt
