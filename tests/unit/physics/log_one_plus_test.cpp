#include "telenano/nve_server/physics/numerics/log_one_plus.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace telenano::physics {
namespace {

// Oracle: glibc's log1p on long double. The form rounds about ten times, each by half an ulp of a term that is no
// larger than the result: 4 ulp.
TEST(LogOnePlus, OfSeveralIsRightAndHasTheBitsOfEach) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> exponent(-40, 20);
  std::vector<double> y{0.0, 0.1, 0.2199999, 0.22, 0.2222222222222222, 0.2222222222222223, 0.23, 1.0, 1e6};
  for (int i = 0; i < 20000; ++i) y.push_back(std::exp2(exponent(random)));
  std::vector<double> log(y.size());
  log_one_plus(y.data(), static_cast<int>(y.size()), log.data());
  for (std::size_t i = 0; i < y.size(); ++i) {
    ASSERT_EQ(std::bit_cast<std::uint64_t>(log[i]), std::bit_cast<std::uint64_t>(LogOnePlus(y[i]).log()))
        << y[i];
    const long double want = std::log1p(static_cast<long double>(y[i]));
    EXPECT_LE(std::fabs(static_cast<double>(log[i] - want)), 4 * 0x1p-52 * static_cast<double>(want)) << y[i];
  }
}

}  // namespace
}  // namespace telenano::physics
