#include "telenano/master/calibration/filled_positions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace telenano::calibration {
namespace {

double motion_m(double time_s) {
  return 1e-3 * std::sin(2 * std::numbers::pi * 7.93 * time_s + 0.4) + 2e-2 * time_s;
}

/// 200 ms at 1 kHz without the positions from 100 ms on for so many.
std::vector<DynamicsSample> track_with_gap(int missing) {
  std::vector<DynamicsSample> track;
  for (int k = 0; k < 200; ++k) {
    const double time_s = 1e-3 * k;
    if (k < 100 || k >= 100 + missing) track.push_back({time_s, motion_m(time_s), time_s, 0, 0, 0});
  }
  return track;
}

double worst_m(const std::vector<TimedPosition>& positions) {
  double worst = 0;
  for (const TimedPosition& at : positions)
    worst = std::max(worst, std::fabs(at.position_m - motion_m(at.time_s)));
  return worst;
}

double longest_s(const std::vector<TimedPosition>& positions) {
  double longest = 0;
  for (std::size_t i = 1; i < positions.size(); ++i)
    longest = std::max(longest, positions[i].time_s - positions[i - 1].time_s);
  return longest;
}

// The amplitude is 1 mm; the header promises 0.004 of it.
TEST(FilledPositions, MeetASineInAGap) {
  for (const int missing : {3, 7, 12, 18}) {
    SCOPED_TRACE(missing);
    const std::vector<TimedPosition> filled = filled_positions(track_with_gap(missing));
    EXPECT_LT(longest_s(filled), 1.6e-3);
    EXPECT_GT(filled.size(), 199u - 1);
    EXPECT_LT(worst_m(filled), 4e-6);
  }
}

TEST(FilledPositions, LeaveOpenWhatIsTooLongOrHasNoSides) {
  const std::vector<TimedPosition> long_gap = filled_positions(track_with_gap(25));
  EXPECT_EQ(long_gap.size(), 175u);
  EXPECT_EQ(worst_m(long_gap), 0);
  // Two gaps with three positions between them.
  std::vector<DynamicsSample> track = track_with_gap(10);
  std::erase_if(
      track, [](const DynamicsSample& sample) { return sample.time_s > 0.1125 && sample.time_s < 0.1255; });
  EXPECT_EQ(filled_positions(track).size(), track.size());
  EXPECT_TRUE(filled_positions({}).empty());
}

// When a reading took long, nobody knows when the device was where it says.
TEST(FilledPositions, LeaveOutAReadingThatTookLong) {
  std::vector<DynamicsSample> track = track_with_gap(0);
  track[100].position_m += 1e-3;
  track[100].reading_took_s = 4e-3;
  EXPECT_LT(worst_m(filled_positions(track)), 1e-9);
}

}  // namespace
}  // namespace telenano::calibration
