#include "nve_server/import/tip_erosion.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace telenano::import {
namespace {

using surface::HeightGrid;

/// out[q] = min over p of in[p] + k (q − p)², from[q] the p that gives it.
class LowerEnvelope {
 public:
  explicit LowerEnvelope(std::size_t longest) : apex_(longest), begins_(longest + 1) {}

  void run(const std::vector<double>& in, double k, std::vector<double>& out,
           std::vector<std::uint32_t>& from) {
    const std::size_t n = in.size();
    std::size_t last = 0;
    apex_[0] = 0;
    begins_[0] = -INFINITY;
    begins_[1] = INFINITY;
    for (std::size_t q = 1; q < n; ++q) {
      // Where the parabola of q goes below that of p: to the right of this.
      const auto crossing = [&](std::size_t p) {
        const auto x = static_cast<double>(q), y = static_cast<double>(p);
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
      from[q] = static_cast<std::uint32_t>(apex_[i]);
    }
  }

 private:
  std::vector<std::size_t> apex_;
  std::vector<double> begins_;
};

/// min over p of z(p) + h(x − p), and the pixel p that gives it.
struct Eroded {
  std::vector<double> z_nm;
  std::vector<std::uint32_t> from;
};

Eroded erode_plainly(const HeightGrid& grid, const std::vector<double>& z_nm, double radius_nm) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  const auto rows = static_cast<std::size_t>(grid.rows);
  const double kx = 0.5 * grid.dx_nm * grid.dx_nm / radius_nm;
  const double ky = 0.5 * grid.dy_nm * grid.dy_nm / radius_nm;
  LowerEnvelope envelope(std::max(columns, rows));
  Eroded result{std::vector<double>(z_nm.size()), std::vector<std::uint32_t>(z_nm.size())};
  std::vector<double> in(columns), out(columns);
  std::vector<std::uint32_t> from(columns);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) in[column] = z_nm[row * columns + column];
    envelope.run(in, kx, out, from);
    for (std::size_t column = 0; column < columns; ++column) {
      result.z_nm[row * columns + column] = out[column];
      result.from[row * columns + column] = from[column];
    }
  }
  in.resize(rows);
  out.resize(rows);
  from.resize(rows);
  std::vector<std::uint32_t> column_of(rows);
  for (std::size_t column = 0; column < columns; ++column) {
    for (std::size_t row = 0; row < rows; ++row) {
      in[row] = result.z_nm[row * columns + column];
      column_of[row] = result.from[row * columns + column];
    }
    envelope.run(in, ky, out, from);
    for (std::size_t row = 0; row < rows; ++row) {
      result.z_nm[row * columns + column] = out[row];
      result.from[row * columns + column] =
          static_cast<std::uint32_t>(from[row] * columns + column_of[from[row]]);
    }
  }
  return result;
}

std::vector<double> dilate_plainly(const HeightGrid& grid, const std::vector<double>& z_nm,
                                   double radius_nm) {
  std::vector<double> turned(z_nm.size());
  std::transform(z_nm.begin(), z_nm.end(), turned.begin(), [](double z) { return -z; });
  Eroded eroded = erode_plainly(grid, turned, radius_nm);
  for (double& z : eroded.z_nm) z = -z;
  return std::move(eroded.z_nm);
}

}  // namespace

std::vector<double> dilate(const HeightGrid& ground, double radius_nm) {
  return dilate_plainly(ground, ground.z_nm, radius_nm);
}

Erosion erode(const HeightGrid& scan, double radius_nm) {
  Eroded eroded = erode_plainly(scan, scan.z_nm, radius_nm);
  Erosion result;
  result.z_nm = std::move(eroded.z_nm);

  const std::vector<double> again = dilate_plainly(scan, result.z_nm, radius_nm);
  double sum = 0;
  for (std::size_t i = 0; i < again.size(); ++i) {
    const double misfit = std::abs(again[i] - scan.z_nm[i]);
    sum += misfit * misfit;
    result.misfit_max_nm = std::max(result.misfit_max_nm, misfit);
  }
  result.misfit_rms_nm = std::sqrt(sum / static_cast<double>(again.size()));

  // The tip at p touches x where S_r(x) = I(p) + h(x − p): where p is the pixel that x has its height from.
  std::vector<std::uint32_t> touches(result.z_nm.size(), 0);
  for (const std::uint32_t p : eroded.from) ++touches[p];
  const auto [low, high] = std::minmax_element(scan.z_nm.begin(), scan.z_nm.end());
  const double reach_nm = std::sqrt(2.0 * radius_nm * (*high - *low));
  const auto inside = [&](std::size_t p) {
    const auto column = static_cast<double>(p % static_cast<std::size_t>(scan.columns));
    const auto row = static_cast<double>(p / static_cast<std::size_t>(scan.columns));
    const double x = std::min(column, scan.columns - 1 - column) * scan.dx_nm;
    const double y = std::min(row, scan.rows - 1 - row) * scan.dy_nm;
    return std::min(x, y) >= reach_nm;
  };
  result.certain.assign(result.z_nm.size(), false);
  for (std::size_t x = 0; x < result.certain.size(); ++x) {
    const std::uint32_t p = eroded.from[x];
    if (touches[p] != 1 || !inside(p)) continue;
    result.certain[x] = true;
    ++result.certain_count;
  }
  return result;
}

}  // namespace telenano::import
