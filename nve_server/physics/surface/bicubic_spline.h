#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/nve_server/physics/surface/height_grid.h"
#include "telenano/nve_server/physics/surface/height_jet.h"

namespace telenano::physics {

/// A field with its gradient.
struct ValueAndSlope {
  double value = 0;
  double slope_x = 0, slope_y = 0;
};

/// Bicubic B-spline over a uniform grid, C²:
///
///   z(x, y) = Σ_ij c_ij β³(x/dx − i) β³(y/dy − j),
///
/// coefficients mirrored about the first and the last sample, so that the field has no slope across the rim:
/// continuing the rim's value outwards, as is done beyond the grid, keeps it C¹.
///
/// - interpolating: (c_{i−1} + 4c_i + c_{i+1})/6 = f_i along rows, then columns (Unser, IEEE Signal
///   Processing Magazine 16(6):22, 1999): passes through the samples, error O(h⁴), overshoots a step by up
///   to 14 %.
/// - averaging: c_ij = f_ij (Schoenberg's variation-diminishing spline): between the least and the greatest
///   of the 16 samples around, never beyond; error h²/6 · second derivative.
class BicubicSpline {
 public:
  /// Both need at least 2×2 samples and positive spacing.
  static BicubicSpline interpolating(const HeightGrid& grid);
  static BicubicSpline averaging(const HeightGrid& grid);

  HeightJet jet(double x_nm, double y_nm) const noexcept;
  ValueAndSlope value_and_slope(double x_nm, double y_nm) const noexcept;
  bool inside(double x_nm, double y_nm) const noexcept {
    return x_nm >= x_first_ && x_nm <= x_last_ && y_nm >= y_first_ && y_nm <= y_last_;
  }

  /// The 4×4 coefficients that reach a point, from (column, row) on (mirrored ones at the ends included), and
  /// the weights of their columns and rows in the value and in its slope (a cell).
  struct Stencil {
    int column, row;
    double x_value[4], x_slope[4];
    double y_value[4], y_slope[4];
  };
  Stencil stencil(double x_nm, double y_nm) const noexcept;
  /// Which column or row one stands for that lies one beyond either end.
  static int folded(int i, int count) noexcept { return i < 0 ? -i : (i < count ? i : 2 * count - 2 - i); }
  int column_of(double x_nm) const noexcept;  ///< the nearest
  int row_of(double y_nm) const noexcept;
  int columns() const noexcept { return columns_; }
  int rows() const noexcept { return rows_; }
  double dx_nm() const noexcept { return dx_; }
  double dy_nm() const noexcept { return dy_; }
  double node_x_nm(int column) const noexcept { return x_first_ + column * dx_; }
  double node_y_nm(int row) const noexcept { return y_first_ + row * dy_; }

  double coefficient(int column, int row) const noexcept { return coefficients_[offset(column, row)]; }
  void set_coefficient(int column, int row, double value) noexcept;
  /// Of all coefficients that were set, by place and bits, whatever the order and whatever was there between;
  /// 0: all as they were made.
  std::uint64_t changes_digest() const noexcept { return changes_; }
  double node_value(int column, int row) const noexcept;
  /// Of `count` columns in a row of coefficients (-1 to rows()), from `column` on: what it gives to its nodes.
  void row_sums(int column, int row, int count, double* sum) const noexcept;
  /// Each of `count` coefficients in a row, from `column` on, rises by per_level · level where its level is above
  /// 0, as if each were set.
  void raise(int column, int row, int count, const double* level, double per_level) noexcept;
  /// The same, where each falls by a height of its own.
  void lower(int column, int row, int count, const double* level, const double* fall) noexcept;

  double x_first_nm() const noexcept { return x_first_; }
  double y_first_nm() const noexcept { return y_first_; }
  double x_last_nm() const noexcept { return x_last_; }
  double y_last_nm() const noexcept { return y_last_; }

 private:
  explicit BicubicSpline(const HeightGrid& grid);
  std::size_t offset(int column, int row) const noexcept {
    return static_cast<std::size_t>(row + 1) * static_cast<std::size_t>(stride_) +
           static_cast<std::size_t>(column + 1);
  }
  double& at(int column, int row) noexcept { return coefficients_[offset(column, row)]; }
  template <class ChangedTo>
  void change_row(int column, int row, int count, const double* level, const ChangedTo& changed_to) noexcept;
  void mirror_ends() noexcept;
  struct Place {
    const double* coefficients;  // the first of the cell's 4×4
    double u, v;                 // in the cell, 0 to 1
    bool beyond_x, beyond_y;     // the rim
  };
  Place place(double x_nm, double y_nm) const noexcept;

  int columns_, rows_;
  double dx_, dy_, inv_dx_, inv_dy_;
  double x_first_, y_first_, x_last_, y_last_;
  int stride_;                        // columns + 2: one more at either end
  std::vector<double> coefficients_;  // padded, so that a cell's 4×4 are always there
  std::uint64_t changes_ = 0;         // Σ of (words of place and new bits) less (of place and old bits)
};

/// Values of nodes, row after row: each row of coefficients is summed along itself once, for the three rows of
/// nodes that it reaches. The bits are those of node_value().
class NodeRows {
 public:
  static constexpr int kMost = 128;  ///< columns

  /// Of `count` <= kMost columns from `column` on, first of `row`.
  NodeRows(const BicubicSpline& spline, int column, int count, int row) noexcept
      : spline_(spline), column_(column), count_(count), row_(row) {
    spline_.row_sums(column_, row_ - 1, count_, low_);
    spline_.row_sums(column_, row_, count_, here_);
    spline_.row_sums(column_, row_ + 1, count_, high_);
  }
  /// Of the row where it is, `count` columns from `first` of its own on.
  void values(int first, int count, double* value) const noexcept {
    for (int i = 0; i < count; ++i)
      value[i] = (low_[first + i] + 4.0 * here_[first + i] + high_[first + i]) / 36.0;
  }
  /// To the next row, of those that the spline has.
  void next() noexcept {
    double* const spare = low_;
    low_ = here_;
    here_ = high_;
    high_ = spare;
    ++row_;
    if (row_ < spline_.rows()) spline_.row_sums(column_, row_ + 1, count_, high_);
  }

 private:
  const BicubicSpline& spline_;
  int column_, count_, row_;
  double sums_[3][kMost];
  double *low_ = sums_[0], *here_ = sums_[1], *high_ = sums_[2];
};

}  // namespace telenano::physics
