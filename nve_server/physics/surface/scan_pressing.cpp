#include "telenano/nve_server/physics/surface/scan_pressing.h"

#include <algorithm>

#include "telenano/nve_server/physics/surface/crater.h"
#include "telenano/nve_server/physics/surface/crater_row.h"
#include "telenano/nve_server/physics/surface/heap_rows.h"

namespace telenano::physics {
namespace {

MarkPlace place_on(int columns, int rows, double inv_dx, double inv_dy, const FieldMark& mark, double x,
                   double y, double least_nodes) noexcept {
  MarkPlace place;
  place.columns = columns;
  place.rows = rows;
  place.inv_dx = inv_dx;
  place.inv_dy = inv_dy;
  place.dx = 1.0 / inv_dx;
  place.dy = 1.0 / inv_dy;
  place.x = x;
  place.y = y;
  place.radius = std::max(mark.radius_nm, least_nodes * std::max(place.dx, place.dy));
  place.per_radius = 1.0 / place.radius;
  place.column = std::min(static_cast<int>(x * inv_dx), columns - 2);
  place.row = std::min(static_cast<int>(y * inv_dy), rows - 2);
  return place;
}

/// A row is fetched while the one before it is worked on: rows lie too far apart for the processor to foresee where the next one
/// begins.
void fetch(const double* begin, std::size_t values) noexcept {
  constexpr std::size_t kLine = 8;
  for (std::size_t i = 0; i < values; i += kLine) __builtin_prefetch(begin + i);
}

}  // namespace

ScanFields::Pressing::Pressing(std::span<Grid* const> grids, const FieldMark& mark, double x,
                               double y) noexcept
    : grids_(grids),
      mark_(mark),
      place_(place_on(grids[0]->columns, grids[0]->rows, grids[0]->inv_dx, grids[0]->inv_dy, mark, x, y,
                      kLeastNodes)),
      wx_(cubic_weights(x * place_.inv_dx - place_.column, place_.inv_dx)),
      wy_(cubic_weights(y * place_.inv_dy - place_.row, place_.inv_dy)) {
  const double reach = mark.pile_up > 0.0 ? kHeapReach * place_.radius : place_.radius;
  reach_ = {place_.first_column(x - reach), place_.last_column(x + reach), place_.first_row(y - reach),
            place_.last_row(y + reach)};
  double moments[3][4] = {{0, 0, 0, mark.depth_nm}, {0, 0, 0, 0}, {0, 0, 0, 0}};
  for (int r = 0; r < 4; ++r) {
    const double eta = place_.eta_of(place_.row + r);
    for (int c = 0; c < 4; ++c) {
      const double xi = place_.xi_of(place_.column + c);
      const double level = crater_level(xi, eta);
      const double terms[3] = {level, level * xi, level * eta};
      const double weight[3] = {wx_.value[c] * wy_.value[r], wx_.slope[c] * wy_.value[r],
                                wx_.value[c] * wy_.slope[r]};
      for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) moments[i][k] += weight[i] * terms[k];
      }
    }
  }
  solve_crater(moments, fall_);
}

/// The coefficients that reach the mark: use(column, row).
template <class Use>
void ScanFields::Pressing::each_of_16(const Use& use) const {
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) use(place_.column + c, place_.row + r);
  }
}

void ScanFields::Pressing::lower_crater() noexcept {
  for (Grid* const grid : grids_)
    each_of_16([&](int i, int j) { grid->digest -= grid->words[place_.number_of(i, j)]; });
  const MarkPlace place = place_;
  const double a = fall_[0], b = fall_[1], c = fall_[2];
  const double last_a = mark_.strain * mark_.last_radius_nm;
  double lost = 0;
  const auto xi_of = [&](int i) { return place.xi_of(i); };
  ColumnPlaces places(reach_.first_column, reach_.last_column, xi_of);
  CraterRow part;
  place.each_within(1.0, [&](int j, double eta, int left, int right) {
    for (Grid* const grid : grids_) {
      if (j == reach_.last_row || !(mark_.strain > 0.0)) break;
      const auto lanes = static_cast<std::size_t>(grid->lanes);
      const std::size_t at = place.number_of(left, j + 1) * lanes;
      const std::size_t values = static_cast<std::size_t>(right + 1 - left) * lanes;
      fetch(grid->own + at, values);
      fetch(grid->made.get() + at, values);
    }
    for (int from = left; from <= right; from += CraterRow::kMost) {
      const int across = std::min(CraterRow::kMost, right + 1 - from);
      const double* const xi = places.of(from, across);
      double level[CraterRow::kMost], fall[CraterRow::kMost];
      for (int k = 0; k < across; ++k) {
        level[k] = crater_level(xi[k], eta);
        fall[k] = level[k] * (a + b * xi[k] + c * eta);
      }
      part.count = 0;
      for (int k = 0; k < across; ++k) {
        if (!(level[k] > 0.0)) continue;
        if (place.inside(from + k, j)) lost += fall[k];
        part.add(from + k, level[k], fall[k]);
      }
      for (std::size_t g = 0; g < grids_.size(); ++g) {
        const Grid& grid = *grids_[g];
        const auto lanes = static_cast<std::size_t>(grid.lanes);
        const std::size_t line = place.number_of(0, j);
        if (mark_.strain > 0.0) {
          part.rise_by_flow(grid.own + line * lanes, grid.made.get() + line * lanes, lanes, mark_.strain,
                            last_a);
        } else {
          part.rise_by_level(mark_.log_radius_rise);
        }
        lower_row_of(part, j, g);
      }
    }
  });
  lost_ = lost;
}

void ScanFields::Pressing::lower_row_of(const CraterRow& part, int j, std::size_t g) noexcept {
  Grid& grid = *grids_[g];
  const bool two_levels = grid.lanes == kLanes;
  const auto lanes = static_cast<std::size_t>(grid.lanes);
  const std::size_t line = place_.number_of(0, j);
  double* const at_line = grid.own + line * lanes;
  const auto lower = [&](int first, int last) {
    grid.digest += two_levels ? lower_row<kLanes, true>(at_line, grid.words, line, part, first, last)
                              : lower_row<kLayerLanes, false>(at_line, grid.words, line, part, first, last);
  };
  // The 16 that reach the mark are in the digest when all is done.
  int reached = part.count, beyond = part.count;
  if (place_.row_reaches(j)) {
    const int* const begin = part.column;
    reached = static_cast<int>(std::lower_bound(begin, begin + part.count, place_.column) - begin);
    beyond = static_cast<int>(std::lower_bound(begin, begin + part.count, place_.column + 4) - begin);
  }
  lower(0, reached);
  for (int k = reached; k < beyond; ++k) {
    const int i = part.column[k];
    double* const at = at_line + static_cast<std::size_t>(i) * lanes;
    at[0] -= part.fall[k];
    at[1] += part.rise[k];
    if (two_levels) {
      at[3] -= part.fall[k];
      at[4] += part.rise[k];
    }
    risen_[g] += wx_.value[i - place_.column] * wy_.value[j - place_.row] * part.rise[k];
  }
  lower(beyond, part.count);
}

/// What still lacks to the rise of ρ at the mark.
void ScanFields::Pressing::rise_at_mark() noexcept {
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    Grid& grid = *grids_[g];
    const double lacking = mark_.log_radius_rise - risen_[g];
    each_of_16([&](int i, int j) {
      const std::size_t number = place_.number_of(i, j);
      double* const at = grid.own + number * static_cast<std::size_t>(grid.lanes);
      at[1] += lacking;
      if (grid.lanes == kLanes) at[4] += lacking;
      grid.words[number] = grid.word(number);
      grid.digest += grid.words[number];
    });
  }
}

/// Of what the crater has lost, as much as the mark says stands in its rim.
void ScanFields::Pressing::pile_up() noexcept {
  if (!(mark_.pile_up > 0.0 && lost_ > 0.0)) return;
  const MarkPlace place = place_;
  const auto xi_of = [&](int i) { return place.xi_of(i); };
  ColumnPlaces places(reach_.first_column, reach_.last_column, xi_of);
  HeapRows heap_rows;
  const auto each_of_heap = [&](const auto& use) {
    place.each_within(kHeapReach, [&](int j, double eta, int left, int right) {
      for (int from = left; from <= right; from += HeapRows::kBlock) {
        const int count = std::min(HeapRows::kBlock, right + 1 - from);
        use(j, from, count, heap_rows.levels(from, count, eta, places));
      }
    });
  };
  double heap = 0;
  each_of_heap([&](int j, int from, int count, const double* level) {
    const bool near = place.row_reaches(j) && from <= place.column + 3 && from + count > place.column;
    if (!near && place.inside(from, j) && place.inside(from + count - 1, j)) {
      for (int i = 0; i < count; ++i) heap += level[i];  // what is none adds 0
      return;
    }
    for (int i = 0; i < count; ++i) {
      if (level[i] > 0.0 && !place.reaches(from + i, j) && place.inside(from + i, j)) heap += level[i];
    }
  });
  if (!(heap > 0.0)) return;
  const double height = mark_.pile_up * lost_ / heap;
  heap_rows.again();
  each_of_heap([&](int j, int from, int count, const double* level) {
    const auto raise = [&](int first, int last) {  // of the row's columns
      if (first >= last) return;
      for (Grid* const grid : grids_) {
        if (j < reach_.last_row)
          fetch(grid->own + place.number_of(first, j + 1) * static_cast<std::size_t>(grid->lanes),
                static_cast<std::size_t>(last - first) * static_cast<std::size_t>(grid->lanes));
        const std::size_t number = place.number_of(first, j);
        double* const at = grid->own + number * static_cast<std::size_t>(grid->lanes);
        const double* const levels = level + (first - from);
        grid->digest +=
            grid->lanes == kLanes
                ? raise_row<kLanes, true>(at, grid->words, number, levels, last - first, height)
                : raise_row<kLayerLanes, false>(at, grid->words, number, levels, last - first, height);
      }
    };
    const int end = from + count;
    const bool near = place.row_reaches(j);
    raise(from, near ? std::min(end, place.column) : end);
    if (near) raise(std::max(from, place.column + 4), end);
  });
}

}  // namespace telenano::physics
