#include "telenano/common/recording/curve_segments.h"

#include <algorithm>
#include <cmath>

namespace telenano::recording {

std::vector<CurveSegment> find_curve_segments(const std::vector<double>& height,
                                              const std::vector<double>& lateral, double threshold) {
  std::vector<CurveSegment> segments;
  if (height.size() < 2) return segments;
  const auto close_leg = [&](std::size_t begin, std::size_t end) {
    const double rise = height[end] - height[begin];
    double sideways = 0;
    for (std::size_t i = begin; i <= end; ++i)
      sideways = std::max(sideways, std::abs(lateral[i] - lateral[begin]));
    if (std::abs(rise) >= threshold && sideways < 0.25 * std::abs(rise))
      segments.push_back({rise < 0, begin, end + 1});
  };
  // Zigzag: an extreme counts once the height has come back from it by the threshold.
  std::size_t begin = 0;
  std::size_t low = 0;
  std::size_t high = 0;
  int direction = 0;  // of the segment under way; 0 = not known yet
  for (std::size_t i = 1; i < height.size(); ++i) {
    if (height[i] < height[low]) low = i;
    if (height[i] > height[high]) high = i;
    if (direction >= 0 && height[high] - height[i] >= threshold) {
      if (direction > 0) close_leg(begin, high);
      begin = high;
      low = i;
      direction = -1;
    } else if (direction <= 0 && height[i] - height[low] >= threshold) {
      if (direction < 0) close_leg(begin, low);
      begin = low;
      high = i;
      direction = 1;
    }
  }
  if (direction != 0) close_leg(begin, direction > 0 ? high : low);
  return segments;
}

double segment_threshold_nm(const std::vector<double>& height_nm) {
  if (height_nm.empty()) return 0.2;
  const auto [low, high] = std::minmax_element(height_nm.begin(), height_nm.end());
  return std::max(0.1 * (*high - *low), 0.2);
}

}  // namespace telenano::recording
