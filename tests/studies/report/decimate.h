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

/// The same for a series with holes, as pieces that no line may join: it is parted at non-finite points and
/// where x goes further than `largest_step` from one point to the next. The pieces share the stretches.
std::vector<std::vector<Point>> decimate_pieces(const std::vector<double>& x, const std::vector<double>& y,
                                                std::size_t stretches, double largest_step);

/// Ten times the usual (median) step of a series of times; further apart is a hole, not a late tick.
double hole_of(const std::vector<double>& times);

}  // namespace telenano::studies
