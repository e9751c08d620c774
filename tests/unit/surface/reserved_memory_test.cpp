#include <gtest/gtest.h>

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "telenano/common/surface/reserved_memory.h"

namespace telenano::surface {
namespace {

constexpr std::size_t kDoubles = 1 << 20;

std::size_t page_doubles() {
  return static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)) / sizeof(double);
}

std::size_t resident_pages(const ReservedMemory& memory) {
  std::vector<unsigned char> there(kDoubles / page_doubles());
  EXPECT_EQ(::mincore(memory.data(), kDoubles * sizeof(double), there.data()), 0);
  return static_cast<std::size_t>(
      std::count_if(there.begin(), there.end(), [](unsigned char page) { return (page & 1) != 0; }));
}

/// As a station's process is; ends with this.
class LockedProcess {
 public:
  LockedProcess() : locked_(::mlockall(MCL_CURRENT | MCL_FUTURE) == 0) {}
  ~LockedProcess() { ::munlockall(); }
  bool locked() const { return locked_; }

 private:
  bool locked_;
};

TEST(ReservedMemory, TakesNoneUntilItIsOpened) {
  const ReservedMemory memory(kDoubles);
  EXPECT_EQ(resident_pages(memory), 0u);
  ASSERT_TRUE(memory.open(page_doubles(), 1));
  memory.data()[page_doubles()] = 1;
  EXPECT_EQ(resident_pages(memory), 1u);
}

// A large scan's fields are opened by whole rows of which a tip's way crosses a few pages.
TEST(ReservedMemory, InALockedProcessOnlyWhatIsWrittenIsFilled) {
  const LockedProcess process;
  if (!process.locked()) GTEST_SKIP() << "memory may not be locked here";
  const ReservedMemory filled(kDoubles), bare(kDoubles);
  ASSERT_TRUE(filled.open(0, kDoubles));
  EXPECT_EQ(resident_pages(filled), kDoubles / page_doubles());
  ASSERT_TRUE(bare.open_unlocked(0, kDoubles));
  EXPECT_EQ(resident_pages(bare), 0u);
  bare.data()[5 * page_doubles()] = 1;
  EXPECT_EQ(resident_pages(bare), 1u);
  ASSERT_TRUE(bare.open_unlocked(0, kDoubles));  // again
  EXPECT_EQ(bare.data()[5 * page_doubles()], 1);
  EXPECT_EQ(resident_pages(bare), 1u);
}

}  // namespace
}  // namespace telenano::surface
