#include "telenano/common/recording/curve_segments.h"

#include <gtest/gtest.h>

#include <cmath>

namespace telenano::recording {
namespace {

TEST(Segments, AreCutAtTheTurningPointsAndIgnoreTremor) {
  std::vector<double> height;
  std::vector<double> still;
  for (int i = 0; i <= 400; ++i) {
    const double tremor = 0.3 * std::sin(1.3 * i);
    height.push_back(10 * std::cos(2 * M_PI * i / 200.0) + tremor);  // down 100, up 100, down 100, up 100
    still.push_back(0);
  }
  const std::vector<CurveSegment> segments = find_curve_segments(height, still, 2.0);
  ASSERT_EQ(segments.size(), 4u);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    EXPECT_EQ(segments[i].approach, i % 2 == 0);
    // The tremor may move an extreme by some samples, about sqrt(2 * 0.3 / curvature) = 25.
    EXPECT_NEAR(static_cast<double>(segments[i].begin), 100.0 * static_cast<double>(i), 25);
  }
  std::vector<double> sideways;
  for (std::size_t i = 0; i < height.size(); ++i) sideways.push_back(static_cast<double>(i));
  EXPECT_TRUE(find_curve_segments(height, sideways, 2.0).empty()) << "a scan has no approach";
}

TEST(Segments, ThresholdIsATenthOfTheWayButNeverNothing) {
  EXPECT_EQ(segment_threshold_nm({}), 0.2);
  EXPECT_EQ(segment_threshold_nm({5, 5.5}), 0.2);
  EXPECT_EQ(segment_threshold_nm({-10, 20, 5}), 3.0);
}

}  // namespace
}  // namespace telenano::recording
