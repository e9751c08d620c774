#include "tests/support/alloc_guard.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace telenano::support {
namespace {

void keep(const void* memory) {
  asm volatile("" : : "g"(memory) : "memory");
}

class AllocGuardTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  }
};

TEST_F(AllocGuardTest, CountsEveryWayOfTakingMemory) {
  const AllocGuard guard;
  EXPECT_EQ(guard.allocations(), 0u);
  auto one = std::make_unique<int>(1);
  keep(one.get());
  EXPECT_EQ(guard.allocations(), 1u);
  void* two = std::malloc(10);
  keep(two);
  void* three = std::calloc(3, 10);
  keep(three);
  three = std::realloc(three, 4000);
  keep(three);
  EXPECT_EQ(guard.allocations(), 4u);
  struct alignas(64) Wide {
    char bytes[64];
  };
  auto four = std::make_unique<Wide>();
  keep(four.get());
  EXPECT_EQ(guard.allocations(), 5u);
  std::free(two);
  std::free(three);
  EXPECT_EQ(guard.frees(), 2u);
}

TEST_F(AllocGuardTest, DoesNotCountOtherThreads) {
  std::thread other;
  {
    other = std::thread([] {
      for (int i = 0; i < 100; ++i) keep(std::vector<int>(100).data());
    });
  }
  const AllocGuard guard;
  other.join();
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST_F(AllocGuardTest, SeesNothingWhereNothingIsTaken) {
  std::vector<double> values(100);
  const AllocGuard guard;
  for (double& value : values) value += 1.0;
  const std::string short_text = "no heap";  // fits into the string itself
  keep(short_text.data());
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_EQ(guard.frees(), 0u);
}

}  // namespace
}  // namespace telenano::support
