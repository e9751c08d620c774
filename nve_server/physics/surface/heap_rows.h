#pragma once

#include <algorithm>

#include "telenano/nve_server/physics/surface/crater.h"

namespace telenano::physics {

/// heap_level() over rows of coefficients that are gone through twice in the same order: to sum, and to raise.
/// ξ is found once for a column, a row's levels in one loop without branches, and the second time they are
/// still there, as many as there is room for. The bits are those of heap_level().
class HeapRows {
 public:
  static constexpr int kBlock = 128;  ///< most columns at once

  template <class XiOf>
  HeapRows(int first_column, int last_column, const XiOf& xi_of) noexcept
      : first_(first_column), end_(first_column + std::min(kBlock, last_column + 1 - first_column)) {
    for (int i = first_; i < end_; ++i) xi_[i - first_] = xi_of(i);
  }

  /// From here on the same rows come again.
  void again() noexcept {
    again_ = true;
    next_ = 0;
  }

  /// Levels of `count` <= kBlock columns from `column` on; good until the next call.
  template <class XiOf>
  const double* levels(int column, int count, double eta, const XiOf& xi_of) noexcept {
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
    const double eta_sq = eta * eta;
    if (column >= first_ && column + count <= end_) {
      fill(xi_ + (column - first_), count, eta_sq, out);
    } else {
      double xi[kBlock];
      for (int i = 0; i < count; ++i) xi[i] = xi_of(column + i);
      fill(xi, count, eta_sq, out);
    }
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

  int first_, end_;
  bool again_ = false, full_ = false;
  int filled_ = 0, next_ = 0;
  double xi_[kBlock];
  double spare_[kBlock];
  double kept_[kRoom];
};

}  // namespace telenano::physics
