#include "telenano/common/link/clock_drift.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/random.h"

namespace telenano::link {
namespace {

/// A link with known delays between two clocks with a known drift: the oracle.
struct Oracle {
  double ppm = 0;
  double origin_ns = 5e12;  ///< the server's clock began long ago
  double up_ns = 3e6;       ///< least delays
  double down_ns = 4e6;
  double jitter_ns = 1e6;  ///< mean of what is added to each way, exponential

  std::int64_t at_server(double t_ns) const { return std::llround(origin_ns + t_ns * (1 + ppm * 1e-6)); }
  /// One exchange that begins at `t1_ns`; what was added to each way is left in `up`, `down`.
  void exchange(ClockDrift& drift, double t1_ns, Random& random) {
    added_up_ns = -std::log(1 - random.uniform()) * jitter_ns;
    added_down_ns = -std::log(1 - random.uniform()) * jitter_ns;
    const double there_ns = t1_ns + up_ns + added_up_ns;
    const double back_ns = there_ns + down_ns + added_down_ns;
    const std::int64_t t1 = std::llround(t1_ns), t4 = std::llround(back_ns);
    const std::int64_t t3 = at_server(there_ns);
    drift.add(t4, t4 - t1, t3 - t1, t4 - t3);
    up_excess_ns = static_cast<double>(t3 - t1) - drift.base_up_ns(t4);
    down_excess_ns = static_cast<double>(t4 - t3) - drift.base_down_ns(t4);
  }
  double added_up_ns = 0, added_down_ns = 0;
  double up_excess_ns = 0, down_excess_ns = 0;
};

TEST(ClockDrift, IsFoundThroughJitterAndIsNotFooledByAsymmetry) {
  for (const double ppm : {-200.0, -20.0, 0.0, 1.5, 50.0, 200.0}) {
    Oracle oracle;
    oracle.ppm = ppm;
    oracle.down_ns = 40e6;  // ten times the way up: an offset, but no drift
    ClockDrift drift;
    Random random(7);
    for (int k = 0; k < 60'000; ++k) oracle.exchange(drift, 1e6 * k, random);
    ASSERT_TRUE(drift.known());
    // A block of 2 s has 2000 exchanges; the least sum of two exponentials of mean 1 ms among them is some
    // 1 ms·√(2/2000) = 32 us, of which the offset sees a half: 16 us over a minute are 0.3 ppm a block, and
    // there are some thirty.
    EXPECT_NEAR(drift.drift_ppm(), ppm, 0.5) << ppm;
    EXPECT_LT(std::fabs(drift.drift_ppm() - ppm), 5 * drift.drift_error_ppm()) << "its own error is honest";
  }
}

TEST(ClockDrift, ExcessOfEachWayIsWhatTheLinkAdded) {
  for (const double ppm : {-200.0, 0.0, 200.0}) {
    Oracle oracle;
    oracle.ppm = ppm;
    ClockDrift drift;
    Random random(11);
    double worst_ns = 0, least_ns = 0;
    for (int k = 0; k < 120'000; ++k) {
      oracle.exchange(drift, 1e6 * k, random);
      if (k < 20'000) continue;
      worst_ns = std::max({worst_ns, std::fabs(oracle.up_excess_ns - oracle.added_up_ns),
                           std::fabs(oracle.down_excess_ns - oracle.added_down_ns)});
      least_ns = std::min({least_ns, oracle.up_excess_ns, oracle.down_excess_ns});
    }
    // The base lies on the least of some thousands of exponentials, mean/n = 1 us each, and is carried over
    // at most 128 s with a drift that is right to 0.3 ppm: 40 us.
    EXPECT_LT(worst_ns, 60'000) << ppm;
    EXPECT_GT(least_ns, -1) << "the base is a lower bound, the newest included";
  }
}

TEST(ClockDrift, StandsThroughABusyStretchOfOneWay) {
  Oracle oracle;
  oracle.ppm = 20;
  oracle.jitter_ns = 2e5;
  ClockDrift drift;
  Random random(5);
  double worst_ppm = 0;
  for (int k = 0; k < 60'000; ++k) {
    // For 12 s somebody else fills the queue up: 20 ms, 10 ms of offset, which over a minute are 200 ppm.
    const bool busy = k >= 40'000 && k < 52'000;
    oracle.up_ns = busy ? 23e6 : 3e6;
    oracle.exchange(drift, 1e6 * k, random);
    if (k > 20'000) worst_ppm = std::max(worst_ppm, std::fabs(drift.drift_ppm() - 20));
  }
  // The busy blocks weigh (20 us/10 ms)^2 of the others.
  EXPECT_LT(worst_ppm, 1);
}

TEST(ClockDrift, ForgetsAndSaysNothingTooEarly) {
  Oracle oracle;
  oracle.ppm = 100;
  oracle.jitter_ns = 1e4;
  ClockDrift drift;
  Random random(3);
  int k = 0;
  for (; k < 900; ++k) oracle.exchange(drift, 1e6 * k, random);
  EXPECT_FALSE(drift.known());
  EXPECT_EQ(drift.drift_ppm(), 0);
  for (; k < 5'000; ++k) oracle.exchange(drift, 1e6 * k, random);
  EXPECT_NEAR(drift.drift_ppm(), 100, 1);
  // The clock is disciplined to another rate, without a step; all blocks are 4 s after a while.
  oracle.origin_ns += 1e6 * k * 150e-6;
  oracle.ppm = -50;
  for (; k < 400'000; ++k) oracle.exchange(drift, 1e6 * k, random);
  EXPECT_NEAR(drift.drift_ppm(), -50, 1);
  // A pause of ten minutes with another rate in it does not count as a line between two points.
  drift.reset();
  EXPECT_FALSE(drift.known());
  EXPECT_EQ(drift.base_up_ns(0), 0);
}

}  // namespace
}  // namespace telenano::link
