#pragma once

#include <cstddef>
#include <vector>

namespace telenano::studies {

struct Point {
  double x = 0;
  double y = 0;
};

/// Thins a long series so that its picture stays the same: of every stretch of neighbours, the lowest and the
/// highest point stay, in their order, and the first and the last of all. At most 2 * stretches + 2 points;
/// short series are returned whole. Non-finite points are left out.
std::vector<Point> decimate(const std::vector<double>& x, const std::vector<double>& y,
                            std::size_t stretches);

}  // namespace telenano::studies
