#pragma once

#include <span>

#include "telenano/nve_server/physics/surface/crater_row.h"
#include "telenano/nve_server/physics/surface/cubic_weights.h"
#include "telenano/nve_server/physics/surface/mark_place.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::physics {

/// One mark in grids that share their nodes: what goes by place alone is found once for all of them.
class ScanFields::Pressing {
 public:
  static constexpr double kLeastNodes =
      3.0;  ///< the heap then begins beyond the 16 coefficients, but for their corners

  /// At (x, y) in the mirrored scan.
  Pressing(std::span<Grid* const> grids, const FieldMark& mark, double x, double y) noexcept;

  /// Padded coefficients that may change.
  struct Reach {
    int first_column, last_column, first_row, last_row;
  };
  const Reach& reach() const noexcept { return reach_; }

  // In this order, where all within reach is usable.
  void lower_crater() noexcept;
  void rise_at_mark() noexcept;
  void pile_up() noexcept;

 private:
  void lower_row_of(const CraterRow& part, int j, std::size_t grid) noexcept;
  template <class Use>
  void each_of_16(const Use& use) const;

  std::span<Grid* const> grids_;
  const FieldMark& mark_;
  MarkPlace place_;
  Reach reach_;
  CubicWeights wx_, wy_;
  double fall_[3];                    // a, b, c
  double risen_[kMostTogether] = {};  // ρ at the mark, by grid
  double lost_ = 0;                   // Σ of what has fallen
};

}  // namespace telenano::physics
