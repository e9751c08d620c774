#pragma once

#include <algorithm>

#include "telenano/nve_server/physics/surface/crater.h"

namespace telenano::physics {

/// ξ of a mark's columns, found once for each column and not again in each row.
template <class XiOf>
class ColumnPlaces {
 public:
  static constexpr int kBlock = 128;  ///< most columns at once

  ColumnPlaces(int first_column, int last_column, const XiOf& xi_of) noexcept
      : xi_of_(xi_of),
        first_(first_column),
        end_(first_column + std::min(kBlock, last_column + 1 - first_column)) {
    for (int i = first_; i < end_; ++i) xi_[i - first_] = xi_of(i);
  }

  /// Of `count` <= kBlock columns from `column` on; good until the next call.
  const double* of(int column, int count) noexcept {
    if (column >= first_ && column + count <= end_) return xi_ + (column - first_);
    for (int i = 0; i < count; ++i) spare_[i] = xi_of_(column + i);
    return spare_;
  }

 private:
  const XiOf& xi_of_;
  int first_, end_;
  double xi_[kBlock];
  double spare_[kBlock];
};

/// heap_level() over rows of coefficients that are gone through twice in the same order: to sum, and to raise.
/// A row's levels are found in one loop without branches, and the second time they are still there, as many as
/// there is room for. The bits are those of heap_level().
class HeapRows {
 public:
  static constexpr int kBlock = 128;  ///< most columns at once

  /// From here on the same rows come again.
  void again() noexcept {
    again_ = true;
    next_ = 0;
  }

  /// Levels of `count` <= kBlock columns from `column` on; good until the next call.
  template <class XiOf>
  const double* levels(int column, int count, double eta, ColumnPlaces<XiOf>& columns) noexcept {
    if (again_ && next_ + count <= filled_) {
      const double* const kept = kept_ + next_;
      next_ += count;
      return kept;
    }
    double* out = spare_;
    if (!again_ && !full_) {
      full_ = filled_ + count > kRoom;
      if (!full_) {
        out = kept_ + filled_;
        filled_ += count;
      }
    }
    fill(columns.of(column, count), count, eta * eta, out);
    return out;
  }

 private:
  static constexpr int kRoom = 4096;

  static void fill(const double* xi, int count, double eta_sq, double* out) noexcept {
    constexpr double kReachSq = kHeapReach * kHeapReach;
    for (int i = 0; i < count; ++i) {
      const double rho_sq = xi[i] * xi[i] + eta_sq;
      const double rise = (rho_sq - 1.0) * (kReachSq - rho_sq);
      // Within the ring both factors are above 0, outside one of them is not.
      const double in = rise > 0.0 ? rise : 0.0;
      out[i] = in * in;
    }
  }

  bool again_ = false, full_ = false;
  int filled_ = 0, next_ = 0;
  double spare_[kBlock];
  double kept_[kRoom];
};

}  // namespace telenano::physics
