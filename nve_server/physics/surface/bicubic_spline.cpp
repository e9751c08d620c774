#include "telenano/nve_server/physics/surface/bicubic_spline.h"

#include <algorithm>
#include <bit>

namespace telenano::physics {
namespace {

// In place: samples -> B-spline coefficients of `lines` lines side by side, mirrored ends; value i of line k
// is at line[i * stride + k]. The system (c_{i−1} + 4c_i + c_{i+1})/6 = f_i is diagonally dominant, so
// elimination without pivoting (Thomas) is stable; with mirrored ends its first and last rows are 4c_0 + 2c_1 =
// 6f_0 and 2c_{n−2} + 4c_{n−1} = 6f_{n−1}. `pivot`, `upper`: of that elimination, the same for all lines.
struct Elimination {
  std::vector<double> pivot, upper;

  explicit Elimination(std::size_t n) : pivot(n), upper(n) {
    upper[0] = 0.5;
    for (std::size_t i = 1; i < n; ++i) {
      pivot[i] = 4.0 - lower(i) * upper[i - 1];
      upper[i] = 1.0 / pivot[i];
    }
  }
  double lower(std::size_t i) const { return i + 1 == pivot.size() ? 2.0 : 1.0; }

  void solve(double* line, std::size_t stride, std::size_t lines) const {
    const std::size_t n = pivot.size();
    for (std::size_t k = 0; k < lines; ++k) line[k] = 1.5 * line[k];
    for (std::size_t i = 1; i < n; ++i) {
      double* const at = line + i * stride;
      for (std::size_t k = 0; k < lines; ++k) {
        at[k] = (6.0 * at[k] - lower(i) * (at - stride)[k]) / pivot[i];
      }
    }
    for (std::size_t i = n - 1; i-- > 0;) {
      double* const at = line + i * stride;
      for (std::size_t k = 0; k < lines; ++k) at[k] -= upper[i] * (at + stride)[k];
    }
  }
};

// splitmix64's finaliser over place and bits.
std::uint64_t word_of(std::uint64_t place, double value) noexcept {
  std::uint64_t z = std::bit_cast<std::uint64_t>(value) + (place + 1) * 0x9e3779b97f4a7c15ull;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

struct Weights {
  double value[4];
  double slope[4];
  double bend[4];
};

// The four cubic B-splines that reach into a cell, at u in [0, 1] across it, and their derivatives in u.
Weights weights(double u) {
  const double v = 1.0 - u;
  const double u2 = u * u;
  const double sixth = 1.0 / 6.0;
  return {{sixth * v * v * v, sixth * ((3.0 * u - 6.0) * u2 + 4.0),
           sixth * (((-3.0 * u + 3.0) * u + 3.0) * u + 1.0), sixth * u2 * u},
          {-0.5 * v * v, (1.5 * u - 2.0) * u, (-1.5 * u + 1.0) * u + 0.5, 0.5 * u2},
          {v, 3.0 * u - 2.0, 1.0 - 3.0 * u, u}};
}

}  // namespace

BicubicSpline::BicubicSpline(const HeightGrid& grid)
    : columns_(grid.columns),
      rows_(grid.rows),
      dx_(grid.dx_nm),
      dy_(grid.dy_nm),
      inv_dx_(1.0 / grid.dx_nm),
      inv_dy_(1.0 / grid.dy_nm),
      x_first_(grid.x_first_nm),
      y_first_(grid.y_first_nm),
      x_last_(grid.x_first_nm + (grid.columns - 1) * grid.dx_nm),
      y_last_(grid.y_first_nm + (grid.rows - 1) * grid.dy_nm),
      stride_(grid.columns + 2),
      coefficients_(static_cast<std::size_t>(grid.columns + 2) * static_cast<std::size_t>(grid.rows + 2)) {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      at(column, row) = grid.z_nm[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                                  static_cast<std::size_t>(column)];
    }
  }
}

BicubicSpline BicubicSpline::averaging(const HeightGrid& grid) {
  BicubicSpline spline(grid);
  spline.mirror_ends();
  return spline;
}

BicubicSpline BicubicSpline::interpolating(const HeightGrid& grid) {
  BicubicSpline spline(grid);
  const auto columns = static_cast<std::size_t>(grid.columns), rows = static_cast<std::size_t>(grid.rows);
  const Elimination along_x(columns), along_y(rows);
  for (int row = 0; row < grid.rows; ++row) along_x.solve(&spline.at(0, row), 1, 1);
  // Some columns at a time: a large scan's go through memory once.
  constexpr std::size_t kTogether = 64;
  for (std::size_t first = 0; first < columns; first += kTogether) {
    along_y.solve(&spline.at(static_cast<int>(first), 0), static_cast<std::size_t>(spline.stride_),
                  std::min(kTogether, columns - first));
  }
  spline.mirror_ends();
  return spline;
}

void BicubicSpline::mirror_ends() noexcept {
  for (int row = 0; row < rows_; ++row) {
    at(-1, row) = at(1, row);
    at(columns_, row) = at(columns_ - 2, row);
  }
  for (int column = -1; column <= columns_; ++column) {
    at(column, -1) = at(column, 1);
    at(column, rows_) = at(column, rows_ - 2);
  }
}

BicubicSpline::Place BicubicSpline::place(double x_nm, double y_nm) const noexcept {
  const double x = std::clamp(x_nm, x_first_, x_last_);
  const double y = std::clamp(y_nm, y_first_, y_last_);
  const double across = (x - x_first_) * inv_dx_;
  const double along = (y - y_first_) * inv_dy_;
  const int column = std::min(static_cast<int>(across), columns_ - 2);
  const int row = std::min(static_cast<int>(along), rows_ - 2);
  return {&coefficients_[static_cast<std::size_t>(row) * static_cast<std::size_t>(stride_) +
                         static_cast<std::size_t>(column)],
          across - column, along - row, x != x_nm, y != y_nm};
}

BicubicSpline::Stencil BicubicSpline::stencil(double x_nm, double y_nm) const noexcept {
  const Place at = place(x_nm, y_nm);
  const Weights wx = weights(at.u);
  const Weights wy = weights(at.v);
  const std::ptrdiff_t first = at.coefficients - coefficients_.data();
  Stencil stencil;
  stencil.column = static_cast<int>(first % stride_) - 1;
  stencil.row = static_cast<int>(first / stride_) - 1;
  for (int i = 0; i < 4; ++i) {
    stencil.x_value[i] = wx.value[i];
    stencil.x_slope[i] = wx.slope[i];
    stencil.y_value[i] = wy.value[i];
    stencil.y_slope[i] = wy.slope[i];
  }
  return stencil;
}

void BicubicSpline::set_coefficient(int column, int row, double value) noexcept {
  const auto place = static_cast<std::uint64_t>(offset(column, row));
  changes_ += word_of(place, value) - word_of(place, coefficient(column, row));
  if (column > 1 && column < columns_ - 2 && row > 1 && row < rows_ - 2) {  // not mirrored at a rim
    at(column, row) = value;
    return;
  }
  const int columns[3] = {column, column == 1 ? -1 : column, column == columns_ - 2 ? columns_ : column};
  const int rows[3] = {row, row == 1 ? -1 : row, row == rows_ - 2 ? rows_ : row};
  for (const int r : rows) {
    for (const int c : columns) at(c, r) = value;
  }
}

double BicubicSpline::node_value(int column, int row) const noexcept {
  const auto line = [&](int r) {
    return coefficient(column - 1, r) + 4.0 * coefficient(column, r) + coefficient(column + 1, r);
  };
  return (line(row - 1) + 4.0 * line(row) + line(row + 1)) / 36.0;
}

void BicubicSpline::row_sums(int column, int row, int count, double* sum) const noexcept {
  const double* const c = &coefficients_[offset(column - 1, row)];
  for (int i = 0; i < count; ++i) sum[i] = c[i] + 4.0 * c[i + 1] + c[i + 2];
}

// changed_to(i, coefficient), where the level is above 0.
template <class ChangedTo>
void BicubicSpline::change_row(int column, int row, int count, const double* level,
                               const ChangedTo& changed_to) noexcept {
  const bool mirrored = row <= 1 || row >= rows_ - 2 || column <= 1 || column + count - 1 >= columns_ - 2;
  if (mirrored) {
    for (int i = 0; i < count; ++i) {
      if (level[i] > 0.0) set_coefficient(column + i, row, changed_to(i, coefficient(column + i, row)));
    }
    return;
  }
  const std::size_t first = offset(column, row);
  double* const line = &coefficients_[first];
  std::uint64_t change = 0;
  for (int i = 0; i < count; ++i) {
    if (!(level[i] > 0.0)) continue;
    const std::uint64_t place = first + static_cast<std::size_t>(i);
    const double changed = changed_to(i, line[i]);
    change += word_of(place, changed) - word_of(place, line[i]);
    line[i] = changed;
  }
  changes_ += change;
}

void BicubicSpline::raise(int column, int row, int count, const double* level, double per_level) noexcept {
  change_row(column, row, count, level, [&](int i, double c) { return c + per_level * level[i]; });
}

void BicubicSpline::lower(int column, int row, int count, const double* level, const double* fall) noexcept {
  change_row(column, row, count, level, [&](int i, double c) { return c - fall[i]; });
}

int BicubicSpline::column_of(double x_nm) const noexcept {
  return static_cast<int>(std::clamp((x_nm - x_first_) * inv_dx_ + 0.5, 0.0, columns_ - 1.0));
}

int BicubicSpline::row_of(double y_nm) const noexcept {
  return static_cast<int>(std::clamp((y_nm - y_first_) * inv_dy_ + 0.5, 0.0, rows_ - 1.0));
}

// Along y first: the four columns are neighbours in memory and go through the same arithmetic, which the
// compiler does two or four at a time.
HeightJet BicubicSpline::jet(double x_nm, double y_nm) const noexcept {
  const Place at = place(x_nm, y_nm);
  const Weights wx = weights(at.u);
  const Weights wy = weights(at.v);
  const double* c0 = at.coefficients;
  const double* c1 = c0 + stride_;
  const double* c2 = c1 + stride_;
  const double* c3 = c2 + stride_;
  double value[4], slope[4], bend[4];
  for (int i = 0; i < 4; ++i) {
    value[i] = (c0[i] * wy.value[0] + c1[i] * wy.value[1]) + (c2[i] * wy.value[2] + c3[i] * wy.value[3]);
    slope[i] = (c0[i] * wy.slope[0] + c1[i] * wy.slope[1]) + (c2[i] * wy.slope[2] + c3[i] * wy.slope[3]);
    bend[i] = (c0[i] * wy.bend[0] + c1[i] * wy.bend[1]) + (c2[i] * wy.bend[2] + c3[i] * wy.bend[3]);
  }
  const auto dot = [](const double(&a)[4], const double(&b)[4]) {
    return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
  };
  HeightJet jet;
  jet.z = dot(wx.value, value);
  jet.zx = dot(wx.slope, value) * inv_dx_;
  jet.zy = dot(wx.value, slope) * inv_dy_;
  jet.zxx = dot(wx.bend, value) * (inv_dx_ * inv_dx_);
  jet.zxy = dot(wx.slope, slope) * (inv_dx_ * inv_dy_);
  jet.zyy = dot(wx.value, bend) * (inv_dy_ * inv_dy_);
  // Beyond the rim its height goes on unchanged across it.
  if (at.beyond_x) jet.zx = jet.zxx = jet.zxy = 0.0;
  if (at.beyond_y) jet.zy = jet.zyy = jet.zxy = 0.0;
  return jet;
}

ValueAndSlope BicubicSpline::value_and_slope(double x_nm, double y_nm) const noexcept {
  const Place at = place(x_nm, y_nm);
  const Weights wx = weights(at.u);
  const Weights wy = weights(at.v);
  const double* c0 = at.coefficients;
  const double* c1 = c0 + stride_;
  const double* c2 = c1 + stride_;
  const double* c3 = c2 + stride_;
  double value[4], slope[4];
  for (int i = 0; i < 4; ++i) {
    value[i] = (c0[i] * wy.value[0] + c1[i] * wy.value[1]) + (c2[i] * wy.value[2] + c3[i] * wy.value[3]);
    slope[i] = (c0[i] * wy.slope[0] + c1[i] * wy.slope[1]) + (c2[i] * wy.slope[2] + c3[i] * wy.slope[3]);
  }
  const auto dot = [](const double(&a)[4], const double(&b)[4]) {
    return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
  };
  return {dot(wx.value, value), at.beyond_x ? 0.0 : dot(wx.slope, value) * inv_dx_,
          at.beyond_y ? 0.0 : dot(wx.value, slope) * inv_dy_};
}

}  // namespace telenano::physics
