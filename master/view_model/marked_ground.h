#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/recording/mark_row.h"
#include "telenano/common/surface/height_grid.h"

namespace telenano::view_model {

/// The sample of a recording at a moving moment, with the marks that had been made by then. Rows that make no
/// sense (a recording may come from anywhere) are left out.
class MarkedGround {
 public:
  /// More nodes than any scene has.
  static constexpr std::uint64_t kNodesMost = std::uint64_t{1} << 24;

  /// `scene`: the heights of the scene itself; without heights: a plane. `rows` by rising time.
  MarkedGround(surface::HeightGrid scene, std::vector<recording::MarkRow> rows);

  bool has_marks() const noexcept { return !rows_.empty(); }
  /// To a moment of the recording, forwards or back. Has anything changed?
  bool move_to(double time_s);
  /// Null: as the scene itself, without marks.
  const surface::HeightGrid* heights() const noexcept { return placed_ ? &grid_ : nullptr; }

 private:
  void apply(const recording::MarkRow& row);
  void place();

  surface::HeightGrid scene_;
  std::vector<recording::MarkRow> rows_;
  surface::HeightGrid grid_;
  bool placed_ = false;
  double values_[recording::kMarkPlaces] = {};  // by MarkPlace, of the place that is being read
  std::uint32_t read_ = 0;                      // how many of them, in order
  std::size_t next_ = 0;
  double time_s_ = 0;
};

}  // namespace telenano::view_model
