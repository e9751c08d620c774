#include "tests/studies/report/decimate.h"

#include <algorithm>
#include <cmath>

namespace telenano::studies {

std::vector<Point> decimate(const std::vector<double>& x, const std::vector<double>& y,
                            std::size_t stretches) {
  std::vector<Point> points;
  points.reserve(std::min(x.size(), y.size()));
  for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i) {
    if (std::isfinite(x[i]) && std::isfinite(y[i])) points.push_back({x[i], y[i]});
  }
  if (points.size() <= 2 * stretches + 2 || stretches == 0) return points;
  std::vector<Point> kept{points.front()};
  for (std::size_t s = 0; s < stretches; ++s) {
    const auto begin = points.begin() + static_cast<std::ptrdiff_t>(s * points.size() / stretches);
    const auto end = points.begin() + static_cast<std::ptrdiff_t>((s + 1) * points.size() / stretches);
    const auto [low, high] =
        std::minmax_element(begin, end, [](const Point& a, const Point& b) { return a.y < b.y; });
    kept.push_back(*std::min(low, high));
    if (low != high) kept.push_back(*std::max(low, high));
  }
  kept.push_back(points.back());
  return kept;
}

}  // namespace telenano::studies
