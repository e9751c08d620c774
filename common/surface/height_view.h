#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "telenano/common/surface/height_grid.h"

namespace telenano::surface {

/// The sample's heights for those who only look (a viewer, a recorder), while one other thread presses marks
/// into them: nobody waits for anybody.
///
/// What a reader may see: version() first, with acquire order, then heights: they are at least as new as that
/// version. Heights of a later mark may be among them, also half of one: every height is one that its node
/// had, but neighbours may be of different marks. A reader whose version() is the same afterwards and before
/// has seen no later mark in full; one that wants the latest looks again when version() has moved.
class HeightView {
 public:
  explicit HeightView(const HeightGrid& grid)
      : place_{grid.columns, grid.rows, grid.dx_nm, grid.dy_nm, grid.x_first_nm, grid.y_first_nm, {}},
        z_(std::make_unique<std::atomic<float>[]>(grid.z_nm.size())) {
    for (std::size_t i = 0; i < grid.z_nm.size(); ++i) {
      z_[i].store(static_cast<float>(grid.z_nm[i]), std::memory_order_relaxed);
    }
  }

  int columns() const noexcept { return place_.columns; }
  int rows() const noexcept { return place_.rows; }
  float height_nm(int column, int row) const noexcept {
    return z_[index(column, row)].load(std::memory_order_relaxed);
  }
  const HeightGrid& place() const noexcept { return place_; }  ///< without heights
  /// All heights, as they are now. Allocates.
  HeightGrid heights() const {
    HeightGrid grid = place_;
    const std::size_t count = static_cast<std::size_t>(columns()) * static_cast<std::size_t>(rows());
    grid.z_nm.reserve(count);
    for (std::size_t i = 0; i < count; ++i)
      grid.z_nm.push_back(static_cast<double>(z_[i].load(std::memory_order_relaxed)));
    return grid;
  }
  /// Counts marks, from 0.
  std::uint64_t version() const noexcept { return version_.load(std::memory_order_acquire); }

  /// The writer's thread only: heights, then publish().
  void store(int column, int row, double height_nm) noexcept {
    z_[index(column, row)].store(static_cast<float>(height_nm), std::memory_order_relaxed);
  }
  void publish() noexcept {
    version_.store(version_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

 private:
  std::size_t index(int column, int row) const noexcept {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(place_.columns) +
           static_cast<std::size_t>(column);
  }

  HeightGrid place_;  // without heights
  std::unique_ptr<std::atomic<float>[]> z_;
  std::atomic<std::uint64_t> version_{0};
};

}  // namespace telenano::surface
