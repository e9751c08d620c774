#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "telenano/common/surface/height_view.h"
#include "telenano/nve_server/physics/surface/bicubic_spline.h"
#include "telenano/nve_server/physics/surface/height_grid.h"
#include "telenano/nve_server/physics/surface/mark.h"
#include "telenano/nve_server/physics/surface/stroke_history.h"
#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The heights of a grid as an interpolating bicubic B-spline (bicubic_spline.h): C².
///
/// Marks. press() lowers the surface and keeps it so: spline_marks.cpp says how. One thread presses; others
/// look through view(). A copy starts with the same heights and goes its own way: each session has its own
/// sample.
class SplineSurface final : public Surface {
 public:
  /// Throws UserError unless the grid has 2×2 finite samples or more and a positive spacing.
  explicit SplineSurface(const HeightGrid& grid);

  SplineSurface(const SplineSurface& other);
  SplineSurface(SplineSurface&&) noexcept = default;
  SplineSurface& operator=(const SplineSurface&) = delete;
  SplineSurface& operator=(SplineSurface&&) = delete;
  ~SplineSurface() override = default;

  HeightJet jet(double x_nm, double y_nm) const noexcept { return height_.jet(x_nm, y_nm); }
  bool inside(double x_nm, double y_nm) const noexcept { return height_.inside(x_nm, y_nm); }
  double height_nm(double x_nm, double y_nm) const noexcept override { return jet(x_nm, y_nm).z; }
  /// Of the samples; with marks at most and at least: not raised where one is filled up again, nor lowered.
  double lowest_nm() const noexcept override { return lowest_; }
  double highest_nm() const noexcept override { return highest_; }
  bool is_flat() const noexcept override { return false; }

  /// Afterwards, at the mark, the height is less by its depth and the gradient what it was (to rounding);
  /// nothing has changed where |x − mark.x| or |y − mark.y| exceeds radius + 2 cells (radius taken as 2 cells
  /// at least, the finest that this grid can show), twice the radius where something is piled up. Beyond the
  /// rim of the grid the mark is made at the nearest point of the rim. A mark that is no number, or has a
  /// negative depth or radius, changes nothing. Takes O(radius²/cell²).
  void press(const Mark& mark) noexcept;
  /// As ScanFields has it, of the heights: grid number `grid` of the history.
  void keep_strokes_in(StrokeHistory* history, std::size_t grid) noexcept {
    strokes_ = history;
    history_grid_ = grid;
  }
  std::size_t tiles() const noexcept;
  void exchange_tile(std::size_t tile, double* values) noexcept;  ///< after the last: settle()
  HeightGrid heights() const;                                     ///< at the nodes, as they are now
  const BicubicSpline& spline() const noexcept { return height_; }

  /// What marks have changed, for those who compare two surfaces, or carry one's marks over to another of the
  /// same scan.
  std::uint64_t marks_digest() const noexcept { return height_.changes_digest() + (marked_ ? 1u : 0u); }
  bool marked() const noexcept { return marked_; }
  int columns() const noexcept { return height_.columns(); }
  int rows() const noexcept { return height_.rows(); }
  /// What a mark may change at a node. Its own height is not quite that of the coefficients where no mark
  /// came by: that is the scan's.
  struct Node {
    double height_coefficient_nm = 0;
    double height_nm = 0;
    friend bool operator==(const Node&, const Node&) = default;
  };
  Node node(int column, int row) const noexcept {
    return {height_.coefficient(column, row), heights_[index(column, row)]};
  }
  /// After the last of them: settle(). Neither allocates.
  void set_node(int column, int row, const Node& node) noexcept;
  void settle(bool marked) noexcept;
  /// For other threads; stays valid when the surface has gone.
  std::shared_ptr<const surface::HeightView> view() const noexcept { return view_; }

  double x_first_nm() const noexcept { return height_.x_first_nm(); }
  double y_first_nm() const noexcept { return height_.y_first_nm(); }
  double x_last_nm() const noexcept { return height_.x_last_nm(); }
  double y_last_nm() const noexcept { return height_.y_last_nm(); }

 private:
  std::size_t index(int column, int row) const noexcept {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(height_.columns()) +
           static_cast<std::size_t>(column);
  }
  void store(int column, int row, double z_nm) noexcept;
  void store_row(int column, int row, int count, const double* z_nm) noexcept;  ///< from `column` on
  void keep_tiles(int left, int right, int low, int high) noexcept;
  template <class Use>
  void each_in_tile(std::size_t tile, const Use& use) noexcept;
  bool heap_up(double x_nm, double y_nm, double radius_nm, double volume) noexcept;

  double cell_;  // the wider spacing
  BicubicSpline height_;
  std::vector<double> heights_;  // at the nodes
  double lowest_, highest_;
  bool marked_ = false;
  StrokeHistory* strokes_ = nullptr;
  std::size_t history_grid_ = 0;
  std::shared_ptr<surface::HeightView> view_;
};

}  // namespace telenano::physics
