#include "telenano/nve_server/import/clean_scan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace telenano::import {
namespace {

using surface::HeightGrid;

constexpr double kSigmaOfMad = 1.4826;  // of a normal distribution: 1/Φ⁻¹(3/4)

std::size_t index(const HeightGrid& grid, int column, int row) {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
         static_cast<std::size_t>(column);
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double range_nm(const HeightGrid& grid) {
  const auto [low, high] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  return *high - *low;
}

// A start for the sweeps: each gap gets the mean of its known neighbours, ring by ring from the rim of the
// gap inwards. Every gap is reached, since the pixels hang together.
void fill_rings(HeightGrid& grid, const std::vector<std::size_t>& gaps, std::vector<bool> unknown) {
  std::vector<std::size_t> left = gaps;
  std::vector<std::size_t> later;
  std::vector<std::pair<std::size_t, double>> ring;
  const auto columns = static_cast<std::size_t>(grid.columns);
  const std::size_t count = grid.z_nm.size();
  while (!left.empty()) {
    ring.clear();
    later.clear();
    for (const std::size_t i : left) {
      double sum = 0;
      int n = 0;
      const auto add = [&](std::size_t j) {
        if (unknown[j]) return;
        sum += grid.z_nm[j];
        ++n;
      };
      if (i % columns > 0) add(i - 1);
      if (i % columns + 1 < columns) add(i + 1);
      if (i >= columns) add(i - columns);
      if (i + columns < count) add(i + columns);
      if (n > 0)
        ring.emplace_back(i, sum / n);
      else
        later.push_back(i);
    }
    for (const auto& [i, z] : ring) {
      grid.z_nm[i] = z;
      unknown[i] = false;
    }
    left.swap(later);
  }
}

// More than `limit` from at least three of its four neighbours, to the same side: so is every pixel of a
// spike of one or two pixels.
bool may_be_spike(const HeightGrid& grid, int column, int row, double limit) {
  const double z = grid.z_nm[index(grid, column, row)];
  int neighbours = 0;
  int above = 0;
  int below = 0;
  const auto look = [&](int c, int r) {
    if (c < 0 || r < 0 || c >= grid.columns || r >= grid.rows) return;
    const double step = z - grid.z_nm[index(grid, c, r)];
    ++neighbours;
    above += step > limit ? 1 : 0;
    below += step < -limit ? 1 : 0;
  };
  look(column - 1, row);
  look(column + 1, row);
  look(column, row - 1);
  look(column, row + 1);
  return std::max(above, below) >= neighbours - 1;
}

struct Around {
  double median = 0;
  int alike = 0;  // others beyond half of the way from the median to the pixel
};

Around around(const HeightGrid& grid, int column, int row) {
  std::array<double, 25> z{};
  std::size_t n = 0;
  for (int r = std::max(0, row - 2); r <= std::min(grid.rows - 1, row + 2); ++r) {
    for (int c = std::max(0, column - 2); c <= std::min(grid.columns - 1, column + 2); ++c) {
      if (c != column || r != row) z[n++] = grid.z_nm[index(grid, c, r)];
    }
  }
  const auto middle = z.begin() + static_cast<std::ptrdiff_t>(n / 2);
  std::nth_element(z.begin(), middle, z.begin() + static_cast<std::ptrdiff_t>(n));
  Around result{*middle, 0};
  const double way = grid.z_nm[index(grid, column, row)] - result.median;
  for (std::size_t i = 0; i < n; ++i) {
    if ((z[i] - result.median) * (way < 0 ? -1.0 : 1.0) > 0.5 * std::abs(way)) ++result.alike;
  }
  return result;
}

struct Spike {
  std::size_t at = 0;
  double instead = 0;
};

std::vector<Spike> spikes_of(const HeightGrid& grid, double sigma) {
  const double limit = sigma * pixel_noise_nm(grid);
  std::vector<Spike> spikes;
  if (!(limit > 0.0)) return spikes;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      if (!may_be_spike(grid, column, row, 0.5 * limit)) continue;
      const Around there = around(grid, column, row);
      const std::size_t at = index(grid, column, row);
      if (std::abs(grid.z_nm[at] - there.median) > limit && there.alike <= 1)
        spikes.push_back({at, there.median});
    }
  }
  return spikes;
}

// Solves the symmetric 3 × 3 system of a weighted plane c + a x + b y by elimination.
struct Sums {
  double w = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, z = 0, xz = 0, yz = 0;

  bool solve(double& c, double& a, double& b) const {
    if (!(w > 0)) return false;
    const double mx = x / w, my = y / w, mz = z / w;
    const double sxx = xx - w * mx * mx, sxy = xy - w * mx * my, syy = yy - w * my * my;
    const double sxz = xz - w * mx * mz, syz = yz - w * my * mz;
    const double det = sxx * syy - sxy * sxy;
    // Nearly all the weight on one line: no plane.
    if (!(det > 1e-9 * sxx * syy)) return false;
    a = (sxz * syy - syz * sxy) / det;
    b = (syz * sxx - sxz * sxy) / det;
    c = mz - a * mx - b * my;
    return true;
  }
};

}  // namespace

bool fill_gaps(HeightGrid& grid, const std::vector<bool>& gap) {
  std::vector<std::size_t> gaps;
  double low = INFINITY;
  double high = -INFINITY;
  for (std::size_t i = 0; i < gap.size(); ++i) {
    if (gap[i]) {
      gaps.push_back(i);
    } else {
      low = std::min(low, grid.z_nm[i]);
      high = std::max(high, grid.z_nm[i]);
    }
  }
  if (gaps.empty()) return true;
  if (gaps.size() == gap.size()) return false;
  fill_rings(grid, gaps, gap);
  // Over-relaxation: a gap of n pixels across takes about n sweeps instead of n². No faster where pixels are
  // a line: 1.9 is near the best for gaps of some tens of pixels, and converges for every size.
  constexpr double kOver = 1.9;
  constexpr int kSweepsMax = 2000;
  const double small = 1e-6 * (high - low) * (2.0 - kOver);
  const auto columns = static_cast<std::size_t>(grid.columns);
  const std::size_t count = grid.z_nm.size();
  // A mean weighted by the pixels' sides: z_xx/dx² + z_yy/dy² = 0.
  const double wx = 1.0 / (grid.dx_nm * grid.dx_nm);
  const double wy = 1.0 / (grid.dy_nm * grid.dy_nm);
  for (int sweep = 0; sweep < kSweepsMax; ++sweep) {
    double largest = 0;
    for (const std::size_t i : gaps) {
      double sum = 0;
      double weight = 0;
      const auto add = [&](std::size_t j, double w) {
        sum += w * grid.z_nm[j];
        weight += w;
      };
      if (i % columns > 0) add(i - 1, wx);
      if (i % columns + 1 < columns) add(i + 1, wx);
      if (i >= columns) add(i - columns, wy);
      if (i + columns < count) add(i + columns, wy);
      const double change = kOver * (sum / weight - grid.z_nm[i]);
      grid.z_nm[i] += change;
      largest = std::max(largest, std::abs(change));
    }
    if (largest <= small) break;
  }
  // The solution lies between the heights around; sweeps that were cut short may not.
  for (const std::size_t i : gaps) grid.z_nm[i] = std::clamp(grid.z_nm[i], low, high);
  return true;
}

double pixel_noise_nm(const HeightGrid& grid) {
  const double floor_nm = range_nm(grid) / 65536.0;
  if (grid.columns < 3) return floor_nm;
  std::vector<double> second;
  second.reserve(grid.z_nm.size());
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 1; column + 1 < grid.columns; ++column) {
      const double* z = &grid.z_nm[index(grid, column, row)];
      second.push_back(std::abs(z[-1] - 2.0 * z[0] + z[1]));
    }
  }
  return std::max(kSigmaOfMad * median(second) / std::sqrt(6.0), floor_nm);
}

std::size_t count_spikes(const HeightGrid& grid, double sigma) {
  return spikes_of(grid, sigma).size();
}

std::size_t remove_spikes(HeightGrid& grid, double sigma) {
  const std::vector<Spike> spikes = spikes_of(grid, sigma);
  for (const Spike& spike : spikes) grid.z_nm[spike.at] = spike.instead;
  return spikes.size();
}

Plane fit_plane(const HeightGrid& grid) {
  // Of pixels a little apart. Far apart, most pairs would stand with one foot on a flake that covers a side;
  // from pixel to pixel, heights that come in steps give slopes that do, and noise counts for more. What is
  // left of either over the scan is some noise of a pixel, which the iteration takes.
  const auto apart = [](int n) { return std::clamp(n / 64, 1, 16); };
  const int few_columns = apart(grid.columns);
  const int few_rows = apart(grid.rows);
  std::vector<double> differences;
  differences.reserve(grid.z_nm.size());
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column + few_columns < grid.columns; ++column) {
      const std::size_t i = index(grid, column, row);
      differences.push_back(grid.z_nm[i + static_cast<std::size_t>(few_columns)] - grid.z_nm[i]);
    }
  }
  Plane plane;
  double a = median(differences) / few_columns;  // nm a column
  differences.clear();
  for (int row = 0; row + few_rows < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column)
      differences.push_back(grid.z_nm[index(grid, column, row + few_rows)] -
                            grid.z_nm[index(grid, column, row)]);
  }
  double b = median(differences) / few_rows;  // nm a row
  const double middle_column = 0.5 * (grid.columns - 1);
  const double middle_row = 0.5 * (grid.rows - 1);
  std::vector<double>& residuals = differences;
  const auto residual = [&](int column, int row, double c) {
    return grid.z_nm[index(grid, column, row)] - (c + a * (column - middle_column) + b * (row - middle_row));
  };
  residuals.clear();
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) residuals.push_back(residual(column, row, 0.0));
  }
  double c = median(residuals);
  const double floor_nm = range_nm(grid) / 65536.0;
  constexpr int kIterationsMax = 50;
  for (int iteration = 0; iteration < kIterationsMax && !plane.converged; ++iteration) {
    residuals.clear();
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column)
        residuals.push_back(std::abs(residual(column, row, c)));
    }
    const double scale = std::max(kSigmaOfMad * median(residuals), floor_nm);
    const double reach = 4.685 * scale;  // 95 % efficient for normal noise (Tukey's biweight)
    if (!(reach > 0)) {
      plane.converged = true;
      break;
    }
    Sums sums;
    for (int row = 0; row < grid.rows; ++row) {
      const double y = row - middle_row;
      for (int column = 0; column < grid.columns; ++column) {
        const double u = residual(column, row, c) / reach;
        if (!(std::abs(u) < 1.0)) continue;
        const double w = (1.0 - u * u) * (1.0 - u * u);
        const double x = column - middle_column;
        const double z = grid.z_nm[index(grid, column, row)];
        sums.w += w;
        sums.x += w * x;
        sums.y += w * y;
        sums.xx += w * x * x;
        sums.xy += w * x * y;
        sums.yy += w * y * y;
        sums.z += w * z;
        sums.xz += w * x * z;
        sums.yz += w * y * z;
      }
    }
    double c_new = 0, a_new = 0, b_new = 0;
    if (!sums.solve(c_new, a_new, b_new)) break;
    // Over the whole scan, the planes are apart by no more than a thousandth of what scatters about them.
    plane.converged =
        std::abs(c_new - c) + std::abs(a_new - a) * middle_column + std::abs(b_new - b) * middle_row <
        1e-3 * scale;
    a = a_new;
    b = b_new;
    c = c_new;
  }
  plane.slope_x = a / grid.dx_nm;
  plane.slope_y = b / grid.dy_nm;
  return plane;
}

void subtract(HeightGrid& grid, const Plane& plane) {
  const double a = plane.slope_x * grid.dx_nm;
  const double b = plane.slope_y * grid.dy_nm;
  const double middle_column = 0.5 * (grid.columns - 1);
  const double middle_row = 0.5 * (grid.rows - 1);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column)
      grid.z_nm[index(grid, column, row)] -= a * (column - middle_column) + b * (row - middle_row);
  }
}

}  // namespace telenano::import
