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

std::vector<std::vector<Point>> decimate_pieces(const std::vector<double>& x, const std::vector<double>& y,
                                                std::size_t stretches, double largest_step) {
  std::vector<std::vector<Point>> pieces;
  const std::size_t size = std::min(x.size(), y.size());
  const auto finite = [&](std::size_t i) { return std::isfinite(x[i]) && std::isfinite(y[i]); };
  for (std::size_t begin = 0; begin < size;) {
    if (!finite(begin)) {
      ++begin;
      continue;
    }
    std::size_t end = begin + 1;
    while (end < size && finite(end) && std::abs(x[end] - x[end - 1]) <= largest_step) ++end;
    const auto part = [&](const std::vector<double>& v) {
      return std::vector<double>(v.begin() + static_cast<std::ptrdiff_t>(begin),
                                 v.begin() + static_cast<std::ptrdiff_t>(end));
    };
    pieces.push_back(decimate(part(x), part(y), std::max<std::size_t>(stretches * (end - begin) / size, 2)));
    begin = end;
  }
  return pieces;
}

double hole_of(const std::vector<double>& times) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < times.size(); ++i) steps.push_back(times[i] - times[i - 1]);
  if (steps.empty()) return HUGE_VAL;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle > 0 ? 10 * *middle : HUGE_VAL;
}

}  // namespace telenano::studies
