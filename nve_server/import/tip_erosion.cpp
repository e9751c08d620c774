#include "telenano/nve_server/import/tip_erosion.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace telenano::import {
namespace {

using surface::HeightGrid;

/// out[q] = min over p of in[p] + k (q − p)².
class LowerEnvelope {
 public:
  explicit LowerEnvelope(std::size_t longest) : apex_(longest), begins_(longest + 1) {}

  void run(const std::vector<double>& in, double k, std::vector<double>& out) {
    const std::size_t n = in.size();
    std::size_t last = 0;
    apex_[0] = 0;
    begins_[0] = -INFINITY;
    begins_[1] = INFINITY;
    for (std::size_t q = 1; q < n; ++q) {
      // Where the parabola of q goes below that of p: to the right of this.
      const auto crossing = [&](std::size_t p) {
        const auto x = static_cast<double>(q);
        const auto y = static_cast<double>(p);
        return 0.5 * ((in[q] - in[p]) / (k * (x - y)) + x + y);
      };
      double s = crossing(apex_[last]);
      while (last > 0 && s <= begins_[last]) s = crossing(apex_[--last]);
      ++last;
      apex_[last] = q;
      begins_[last] = s;
      begins_[last + 1] = INFINITY;
    }
    std::size_t i = 0;
    for (std::size_t q = 0; q < n; ++q) {
      while (begins_[i + 1] < static_cast<double>(q)) ++i;
      const double d = static_cast<double>(q) - static_cast<double>(apex_[i]);
      out[q] = in[apex_[i]] + k * d * d;
    }
  }

 private:
  std::vector<std::size_t> apex_;
  std::vector<double> begins_;
};

/// min over p of z(p) + h(x − p).
std::vector<double> erode_plainly(const HeightGrid& grid, const std::vector<double>& z_nm, double radius_nm) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  const auto rows = static_cast<std::size_t>(grid.rows);
  const double kx = 0.5 * grid.dx_nm * grid.dx_nm / radius_nm;
  const double ky = 0.5 * grid.dy_nm * grid.dy_nm / radius_nm;
  LowerEnvelope envelope(std::max(columns, rows));
  std::vector<double> result(z_nm.size());
  std::vector<double> in(columns);
  std::vector<double> out(columns);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) in[column] = z_nm[row * columns + column];
    envelope.run(in, kx, out);
    for (std::size_t column = 0; column < columns; ++column) result[row * columns + column] = out[column];
  }
  in.resize(rows);
  out.resize(rows);
  for (std::size_t column = 0; column < columns; ++column) {
    for (std::size_t row = 0; row < rows; ++row) in[row] = result[row * columns + column];
    envelope.run(in, ky, out);
    for (std::size_t row = 0; row < rows; ++row) result[row * columns + column] = out[row];
  }
  return result;
}

std::vector<double> dilate_plainly(const HeightGrid& grid, const std::vector<double>& z_nm,
                                   double radius_nm) {
  std::vector<double> turned(z_nm.size());
  std::transform(z_nm.begin(), z_nm.end(), turned.begin(), [](double z) { return -z; });
  std::vector<double> result = erode_plainly(grid, turned, radius_nm);
  for (double& z : result) z = -z;
  return result;
}

/// Where a tip touches: the places x with S(x) − h(x − p) as high as the tip's own height. A tree of the
/// highest ground in squares, of which those are passed over whose highest would not reach the tip at their
/// nearest point: some tens of squares a pixel, whatever the tip's radius.
class Contacts {
 public:
  Contacts(const HeightGrid& grid, const std::vector<double>& z_nm, double radius_nm)
      : kx_(0.5 * grid.dx_nm * grid.dx_nm / radius_nm), ky_(0.5 * grid.dy_nm * grid.dy_nm / radius_nm) {
    levels_.push_back({grid.columns, grid.rows, z_nm});
    while (levels_.back().columns > 1 || levels_.back().rows > 1) {
      const Level& fine = levels_.back();
      Level coarse{(fine.columns + 1) / 2, (fine.rows + 1) / 2, {}};
      coarse.highest_nm.assign(
          static_cast<std::size_t>(coarse.columns) * static_cast<std::size_t>(coarse.rows), -INFINITY);
      for (int row = 0; row < fine.rows; ++row) {
        for (int column = 0; column < fine.columns; ++column) {
          double& highest = coarse.highest_nm[coarse.index(column / 2, row / 2)];
          highest = std::max(highest, fine.highest_nm[fine.index(column, row)]);
        }
      }
      levels_.push_back(std::move(coarse));
    }
  }

  /// The only place where a tip with its apex at this height over this pixel touches; none if there is
  /// another.
  std::optional<std::size_t> only_one(int column, int row, double tip_nm, double tolerance_nm) {
    std::optional<std::size_t> found;
    left_.assign(1, {static_cast<int>(levels_.size()) - 1, 0, 0});
    while (!left_.empty()) {
      const Square square = left_.back();
      left_.pop_back();
      const Level& level = levels_[static_cast<std::size_t>(square.level)];
      const double dx = distance(column, square.column, square.level);
      const double dy = distance(row, square.row, square.level);
      const std::size_t at = level.index(square.column, square.row);
      if (level.highest_nm[at] - kx_ * dx * dx - ky_ * dy * dy < tip_nm - tolerance_nm) continue;
      if (square.level == 0) {
        if (found) return std::nullopt;
        found = at;
        continue;
      }
      const Level& fine = levels_[static_cast<std::size_t>(square.level) - 1];
      for (int r = 2 * square.row; r < std::min(2 * square.row + 2, fine.rows); ++r) {
        for (int c = 2 * square.column; c < std::min(2 * square.column + 2, fine.columns); ++c)
          left_.push_back({square.level - 1, c, r});
      }
    }
    return found;
  }

 private:
  struct Level {
    int columns = 0;
    int rows = 0;
    std::vector<double> highest_nm;
    std::size_t index(int column, int row) const {
      return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
             static_cast<std::size_t>(column);
    }
  };
  struct Square {
    int level = 0;
    int column = 0;
    int row = 0;
  };
  /// In pixels, from one of them to the nearest of a square's.
  static double distance(int from, int square, int level) {
    const int first = square << level;
    const int last = first + (1 << level) - 1;
    return from < first ? first - from : from > last ? from - last : 0;
  }

  double kx_;
  double ky_;
  std::vector<Level> levels_;
  std::vector<Square> left_;
};

}  // namespace

std::vector<double> dilate(const HeightGrid& ground, double radius_nm) {
  return dilate_plainly(ground, ground.z_nm, radius_nm);
}

Erosion erode(const HeightGrid& scan, double radius_nm) {
  Erosion result;
  result.z_nm = erode_plainly(scan, scan.z_nm, radius_nm);

  const std::vector<double> again = dilate_plainly(scan, result.z_nm, radius_nm);
  double sum = 0;
  for (std::size_t i = 0; i < again.size(); ++i) {
    const double misfit = std::abs(again[i] - scan.z_nm[i]);
    sum += misfit * misfit;
    result.misfit_max_nm = std::max(result.misfit_max_nm, misfit);
  }
  result.misfit_rms_nm = std::sqrt(sum / static_cast<double>(again.size()));

  const auto [low, high] = std::minmax_element(scan.z_nm.begin(), scan.z_nm.end());
  const double reach_nm = std::sqrt(2.0 * radius_nm * (*high - *low));
  const double tolerance_nm = (*high - *low) / 65536.0;
  Contacts contacts(scan, result.z_nm, radius_nm);
  result.certain.assign(result.z_nm.size(), false);
  for (int row = 0; row < scan.rows; ++row) {
    if (std::min(row, scan.rows - 1 - row) * scan.dy_nm < reach_nm) continue;
    for (int column = 0; column < scan.columns; ++column) {
      if (std::min(column, scan.columns - 1 - column) * scan.dx_nm < reach_nm) continue;
      const std::size_t p = static_cast<std::size_t>(row) * static_cast<std::size_t>(scan.columns) +
                            static_cast<std::size_t>(column);
      const auto place = contacts.only_one(column, row, scan.z_nm[p], tolerance_nm);
      if (place) result.certain[*place] = true;
    }
  }
  result.certain_count =
      static_cast<std::size_t>(std::count(result.certain.begin(), result.certain.end(), true));
  return result;
}

double bluntest_radius_nm(const HeightGrid& scan, double tolerance_nm) {
  const auto [lowest, highest] = std::minmax_element(scan.z_nm.begin(), scan.z_nm.end());
  const double range_nm = *highest - *lowest;
  const double pixel_nm = std::max(scan.dx_nm, scan.dy_nm);
  const auto possible = [&](double radius_nm) {
    // The paraboloid of R is the sum of those of R₁ and R − R₁ = R′ between pixels, not on them: whole steps
    // miss the lowest sum by up to (d/2)²(1/R₁ + 1/R′)/2 along x and as much along y; R₁ alone is off by h
    // R′/R₁ at a depth h. The lesser of the two is largest, d √(h/4R₁), where they are the same.
    const double grid_nm =
        pixel_nm * std::sqrt(range_nm / (4.0 * radius_nm)) + pixel_nm * pixel_nm / (4.0 * radius_nm);
    const std::vector<double> again =
        dilate_plainly(scan, erode_plainly(scan, scan.z_nm, radius_nm), radius_nm);
    std::size_t sharper = 0;
    for (std::size_t i = 0; i < again.size(); ++i)
      sharper += scan.z_nm[i] - again[i] > tolerance_nm + grid_nm ? 1 : 0;
    return 1000 * sharper <= again.size();
  };
  double low = 1.0;
  double high = 1e4;
  if (possible(high)) return high;
  if (!possible(low)) return low;
  while (high > 1.01 * low) {
    const double middle = std::sqrt(low * high);
    (possible(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace telenano::import
