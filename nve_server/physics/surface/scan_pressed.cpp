// What marks have changed of a scan's fields, as a digest and coefficient by coefficient.
#include <cmath>

#include "telenano/nve_server/physics/surface/coefficient_change.h"
#include "telenano/nve_server/physics/surface/coefficient_words.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::physics {
namespace {

// What a snapshot may say that marks have done, wherever it comes from: no tip has pressed deeper, no heap
// stands higher, and the law has no radius beyond (branch_potential.h).
constexpr double kMostPressed_nm = 1e4;
constexpr double kMostLogRadiusRise = 12;

}  // namespace

std::uint64_t ScanFields::Grid::word(std::size_t number) const noexcept {
  return word_of(number, own + number * static_cast<std::size_t>(lanes), lanes == kLanes);
}

std::uint64_t ScanFields::marks_digest() const noexcept {
  std::uint64_t all = 0;
  for (const Grid& grid : grids_) all = 3 * all + grid.digest;
  for (const Layer& layer : layers_) all = 3 * all + layer.grid.digest;
  return all;
}

std::size_t ScanFields::pressable() const noexcept {
  std::size_t all = 0;
  const auto add = [&](const Grid& grid) { all += grid.size() / static_cast<std::size_t>(grid.lanes); };
  for (const Grid& grid : grids_) add(grid);
  for (const Layer& layer : layers_) add(layer.grid);
  return all;
}

bool ScanFields::set_pressed(const Pressed& pressed) noexcept {
  Grid* const grid = grid_of(pressed.grid);
  if (grid == nullptr || !grid->own || pressed.number >= grid->size() / static_cast<std::size_t>(grid->lanes))
    return false;
  const std::size_t at = pressed.number * static_cast<std::size_t>(grid->lanes);
  const int column = static_cast<int>(pressed.number) % (grid->columns + 2);
  const int row = static_cast<int>(pressed.number) / (grid->columns + 2);
  grid->need(column, column, row, row);
  const int levels = grid->lanes == kLanes ? 2 : 1;
  for (int level = 0; level < levels; ++level) {
    const double* const made = grid->made.get() + at + 3 * level;
    const double* const value = pressed.value + 2 * level;
    if (!(std::abs(value[0] - made[0]) <= kMostPressed_nm) ||
        !(std::abs(value[1] - made[1]) <= kMostLogRadiusRise))
      return false;
  }
  grid->make_usable(column, column, row, row);
  const Grid::Changing changing(*grid, pressed.number);
  for (int level = 0; level < levels; ++level) {
    for (int lane = 0; lane < 2; ++lane)
      grid->own[at + static_cast<std::size_t>(3 * level + lane)] = pressed.value[2 * level + lane];
  }
  return true;
}

}  // namespace telenano::physics
