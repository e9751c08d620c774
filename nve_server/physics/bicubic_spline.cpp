#include "nve_server/physics/bicubic_spline.h"

#include <algorithm>

namespace telenano::physics {
namespace {

// In place: samples -> B-spline coefficients of one line, mirrored ends. The system (c_{i−1} + 4c_i +
// c_{i+1})/6 = f_i is diagonally dominant, so elimination without pivoting (Thomas) is stable; with mirrored
// ends its first and last rows are 4c_0 + 2c_1 = 6f_0 and 2c_{n−2} + 4c_{n−1} = 6f_{n−1}.
void interpolate_line(std::vector<double>& line, std::vector<double>& upper) {
  const std::size_t n = line.size();
  upper[0] = 0.5;
  line[0] = 1.5 * line[0];
  for (std::size_t i = 1; i < n; ++i) {
    const double lower = i + 1 == n ? 2.0 : 1.0;
    const double pivot = 4.0 - lower * upper[i - 1];
    upper[i] = 1.0 / pivot;
    line[i] = (6.0 * line[i] - lower * line[i - 1]) / pivot;
  }
  for (std::size_t i = n - 1; i-- > 0;) line[i] -= upper[i] * line[i + 1];
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
  std::vector<double> line(static_cast<std::size_t>(grid.columns));
  std::vector<double> upper(static_cast<std::size_t>(std::max(grid.columns, grid.rows)));
  for (int row = 0; row < grid.rows; ++row) {
    for (int i = 0; i < grid.columns; ++i) line[static_cast<std::size_t>(i)] = spline.at(i, row);
    interpolate_line(line, upper);
    for (int i = 0; i < grid.columns; ++i) spline.at(i, row) = line[static_cast<std::size_t>(i)];
  }
  line.resize(static_cast<std::size_t>(grid.rows));
  for (int column = 0; column < grid.columns; ++column) {
    for (int i = 0; i < grid.rows; ++i) line[static_cast<std::size_t>(i)] = spline.at(column, i);
    interpolate_line(line, upper);
    for (int i = 0; i < grid.rows; ++i) spline.at(column, i) = line[static_cast<std::size_t>(i)];
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

HeightJet BicubicSpline::jet(double x_nm, double y_nm) const noexcept {
  const double x = std::clamp(x_nm, x_first_, x_last_);
  const double y = std::clamp(y_nm, y_first_, y_last_);
  const double across = (x - x_first_) * inv_dx_;
  const double along = (y - y_first_) * inv_dy_;
  const int column = std::min(static_cast<int>(across), columns_ - 2);
  const int row = std::min(static_cast<int>(along), rows_ - 2);
  const Weights wx = weights(across - column);
  const Weights wy = weights(along - row);

  double value[4], slope[4], bend[4];
  const double* c = &coefficients_[static_cast<std::size_t>(row) * static_cast<std::size_t>(stride_) +
                                   static_cast<std::size_t>(column)];
  for (int r = 0; r < 4; ++r, c += stride_) {
    value[r] = c[0] * wx.value[0] + c[1] * wx.value[1] + c[2] * wx.value[2] + c[3] * wx.value[3];
    slope[r] = c[0] * wx.slope[0] + c[1] * wx.slope[1] + c[2] * wx.slope[2] + c[3] * wx.slope[3];
    bend[r] = c[0] * wx.bend[0] + c[1] * wx.bend[1] + c[2] * wx.bend[2] + c[3] * wx.bend[3];
  }
  HeightJet jet;
  for (int r = 0; r < 4; ++r) {
    jet.z += wy.value[r] * value[r];
    jet.zx += wy.value[r] * slope[r];
    jet.zy += wy.slope[r] * value[r];
    jet.zxx += wy.value[r] * bend[r];
    jet.zxy += wy.slope[r] * slope[r];
    jet.zyy += wy.bend[r] * value[r];
  }
  jet.zx *= inv_dx_;
  jet.zy *= inv_dy_;
  jet.zxx *= inv_dx_ * inv_dx_;
  jet.zxy *= inv_dx_ * inv_dy_;
  jet.zyy *= inv_dy_ * inv_dy_;
  // Beyond the rim its height goes on unchanged across it.
  if (x != x_nm) jet.zx = jet.zxx = jet.zxy = 0.0;
  if (y != y_nm) jet.zy = jet.zyy = jet.zxy = 0.0;
  return jet;
}

ValueAndSlope BicubicSpline::value_and_slope(double x_nm, double y_nm) const noexcept {
  const double x = std::clamp(x_nm, x_first_, x_last_);
  const double y = std::clamp(y_nm, y_first_, y_last_);
  const double across = (x - x_first_) * inv_dx_;
  const double along = (y - y_first_) * inv_dy_;
  const int column = std::min(static_cast<int>(across), columns_ - 2);
  const int row = std::min(static_cast<int>(along), rows_ - 2);
  const Weights wx = weights(across - column);
  const Weights wy = weights(along - row);
  ValueAndSlope out;
  const double* c = &coefficients_[static_cast<std::size_t>(row) * static_cast<std::size_t>(stride_) +
                                   static_cast<std::size_t>(column)];
  for (int r = 0; r < 4; ++r, c += stride_) {
    const double value = c[0] * wx.value[0] + c[1] * wx.value[1] + c[2] * wx.value[2] + c[3] * wx.value[3];
    const double slope = c[0] * wx.slope[0] + c[1] * wx.slope[1] + c[2] * wx.slope[2] + c[3] * wx.slope[3];
    out.value += wy.value[r] * value;
    out.slope_x += wy.value[r] * slope;
    out.slope_y += wy.slope[r] * value;
  }
  out.slope_x = x != x_nm ? 0.0 : out.slope_x * inv_dx_;
  out.slope_y = y != y_nm ? 0.0 : out.slope_y * inv_dy_;
  return out;
}

}  // namespace telenano::physics
