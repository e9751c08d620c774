// Marks in the fields of a scan: a local change of their coefficients, not of the nodes (spline_marks.cpp
// does the same for heights and says why). On each grid the coefficients of H fall by φ(a + b ξ + c η), φ the
// crater's level (crater.h), both levels of softening alike, such that H falls by the depth at the mark and
// keeps both slopes there; so the overlap at every apex there is what it was a depth higher, the softening,
// which goes by the distance from touch, included. Grids too coarse for the crater spread it over
// kLeastNodes of theirs. ρ follows the depth by the flow's own law; what then lacks to the rise at the mark
// the 16 coefficients share that reach it. The cosine stays.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <new>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/contact/flow_family.h"
#include "telenano/nve_server/physics/numerics/log_one_plus.h"
#include "telenano/nve_server/physics/surface/crater.h"
#include "telenano/nve_server/physics/surface/cubic_weights.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::physics {
namespace {

constexpr double kLeastNodes = 3.0;  // the heap then begins beyond the 16 coefficients, but for their corners

bool is_mark(const FieldMark& mark) noexcept {
  return std::isfinite(mark.x_nm) && std::isfinite(mark.y_nm) && std::isfinite(mark.depth_nm) &&
         std::isfinite(mark.radius_nm) && std::isfinite(mark.log_radius_rise) && std::isfinite(mark.strain) &&
         std::isfinite(mark.pile_up) && mark.depth_nm >= 0.0 && mark.radius_nm >= 0.0 && mark.strain >= 0.0 &&
         mark.pile_up >= 0.0 && mark.last_radius_nm > 0.0;
}

// Place of a padded coefficient, mirrored ones at their image.
double place_of(int padded, int nodes, double spacing) noexcept {
  const int i = padded - 1;
  return spacing * (i < 0 ? -i : (i < nodes ? i : 2 * nodes - 2 - i));
}

// SplitMix64's finaliser (Steele, Lea, Flood 2014).
std::uint64_t mixed(std::uint64_t x) noexcept {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

// Of H and ρ of one level of a coefficient. The place is in it, so that what changes places counts.
std::uint64_t word_of(std::uint64_t place, const double* value) noexcept {
  return mixed(mixed((place + 1) * 0x9e3779b97f4a7c15u ^ std::bit_cast<std::uint64_t>(value[0])) +
               std::bit_cast<std::uint64_t>(value[1]));
}

// What a snapshot may say that marks have done, wherever it comes from: no tip has pressed deeper, no heap
// stands higher, and the law has no radius beyond (branch_potential.h).
constexpr double kMostPressed_nm = 1e4;
constexpr double kMostLogRadiusRise = 12;

}  // namespace

/// While coefficients of an area change: the digest goes with them.
class ScanFields::Grid::Changing {
 public:
  Changing(Grid& grid, const Area& area) noexcept : grid_(grid), area_(area) {
    grid_.digest -= grid_.words(area_);
  }
  ~Changing() { grid_.digest += grid_.words(area_); }
  Changing(const Changing&) = delete;
  Changing& operator=(const Changing&) = delete;

 private:
  Grid& grid_;
  Area area_;
};

std::uint64_t ScanFields::Grid::words(const Area& area) const noexcept {
  std::uint64_t sum = 0;
  for (int j = area.first_row; j <= area.last_row; ++j) {
    for (int i = area.first_column; i <= area.last_column; ++i) {
      const auto number = static_cast<std::size_t>(j * (columns + 2) + i);
      const double* const at = own + number * static_cast<std::size_t>(lanes);
      sum += word_of(2 * number, at);
      if (lanes == kLanes) sum += word_of(2 * number + 1, at + 3);
    }
  }
  return sum;
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
  const Grid::Changing changing(*grid, {column, column, row, row});
  for (int level = 0; level < levels; ++level) {
    for (int lane = 0; lane < 2; ++lane)
      grid->own[at + static_cast<std::size_t>(3 * level + lane)] = pressed.value[2 * level + lane];
  }
  return true;
}

// What is `usable` may stay so: it is as it was made again.
void ScanFields::Grid::unmark() noexcept {
  if (!own || digest == 0) return;
  const int tiles_along = static_cast<int>(copied.size()) / tiles_across;
  for (int tj = 0; tj < tiles_along; ++tj) {
    for (int ti = 0; ti < tiles_across; ++ti) {
      if (copied[static_cast<std::size_t>(tj * tiles_across + ti)] != 0) copy_tile(ti, tj);
    }
  }
  digest = 0;
}

void ScanFields::unmark() noexcept {
  for (Grid& grid : grids_) grid.unmark();
  for (Layer& layer : layers_) layer.grid.unmark();
}

double ScanFields::largest_log_radius() const noexcept {
  if (tiled()) return det_log(kMostRadii * radius_);
  double most = -HUGE_VAL;
  const auto look = [&](const Grid& grid) {
    const double* const all = grid.made.get();
    for (std::size_t i = 0; i < grid.size(); i += static_cast<std::size_t>(grid.lanes)) {
      most = std::max(most, all[i + 1]);
      if (grid.lanes == kLanes) most = std::max(most, all[i + 4]);
    }
  };
  for (const Grid& grid : grids_) look(grid);
  for (const Layer& layer : layers_) look(layer.grid);
  return most;
}

ScanFields ScanFields::for_marks(const ScanFields& unmarked) {
  ScanFields fields;
  fields.rule_ = unmarked.rule_;
  fields.softening_ = unmarked.softening_;
  fields.radius_ = unmarked.radius_;
  fields.levels_ = unmarked.levels_;
  fields.x_first_ = unmarked.x_first_;
  fields.y_first_ = unmarked.y_first_;
  fields.width_ = unmarked.width_;
  fields.length_ = unmarked.length_;
  for (const Grid& grid : unmarked.grids_) fields.grids_.push_back(grid.for_marks());
  for (const Layer& layer : unmarked.layers_)
    fields.layers_.push_back({layer.softening_nm, layer.grid.for_marks()});
  fields.tiles_ = unmarked.tiles_;
  return fields;
}

ScanFields::Grid ScanFields::Grid::for_marks() const {
  Grid copy;
  copy.lanes = lanes;
  copy.columns = columns;
  copy.rows = rows;
  copy.inv_dx = inv_dx;
  copy.inv_dy = inv_dy;
  copy.made = made;
  copy.tiles = tiles;
  copy.grid_number = grid_number;
  if (tiles != nullptr) {
    copy.own_tiles = std::make_unique<surface::ReservedMemory>(size());
    copy.own = copy.own_tiles->data();
  } else {
    // Zeroed by the system when first touched, if at all.
    copy.own_whole.reset(static_cast<double*>(std::calloc(size(), sizeof(double))));
    copy.own = copy.own_whole.get();
  }
  if (copy.own == nullptr) throw std::bad_alloc();
  copy.tiles_across = (columns + 2 + kTile - 1) / kTile;
  const int tiles_along = (rows + 2 + kTile - 1) / kTile;
  copy.copied.assign(static_cast<std::size_t>(copy.tiles_across) * static_cast<std::size_t>(tiles_along), 0);
  copy.usable = copy.copied;
  return copy;
}

void ScanFields::Grid::copy_tile(int across, int along) noexcept {
  const int count = std::min(kTile, columns + 2 - across * kTile);
  const int last = std::min((along + 1) * kTile, rows + 2);
  need(across * kTile, across * kTile + count - 1, along * kTile, last - 1);
  if (own_tiles) {
    const auto line = static_cast<std::size_t>(stride());
    const std::size_t from = static_cast<std::size_t>(along * kTile) * line;
    if (!own_tiles->open(from, static_cast<std::size_t>(last - along * kTile) * line)) std::abort();
  }
  for (int j = along * kTile; j < last; ++j) {
    const std::size_t at = static_cast<std::size_t>(j) * static_cast<std::size_t>(stride()) +
                           static_cast<std::size_t>(across * kTile) * static_cast<std::size_t>(lanes);
    std::memcpy(own + at, made.get() + at,
                static_cast<std::size_t>(count) * static_cast<std::size_t>(lanes) * sizeof(double));
  }
}

// Of padded coefficients from first to last: they, and all that a stencil reaches which reaches them, are in
// `own` afterwards.
void ScanFields::Grid::make_usable(int first_column, int last_column, int first_row, int last_row) noexcept {
  const int tiles_along = static_cast<int>(usable.size()) / tiles_across;
  const int left = std::max(0, first_column - 3) / kTile, right = last_column / kTile;
  const int low = std::max(0, first_row - 3) / kTile, high = last_row / kTile;
  const auto flag = [this](std::vector<std::uint8_t>& of, int ti, int tj) -> std::uint8_t& {
    return of[static_cast<std::size_t>(tj * tiles_across + ti)];
  };
  for (int tj = low; tj <= high; ++tj) {
    for (int ti = left; ti <= right; ++ti) {
      if (flag(usable, ti, tj) != 0) continue;
      for (int nj = tj; nj <= std::min(tj + 1, tiles_along - 1); ++nj) {
        for (int ni = ti; ni <= std::min(ti + 1, tiles_across - 1); ++ni) {
          if (flag(copied, ni, nj) != 0) continue;
          copy_tile(ni, nj);
          flag(copied, ni, nj) = 1;
        }
      }
      flag(usable, ti, tj) = 1;
    }
  }
}

void ScanFields::Grid::press(const FieldMark& mark, double x, double y) noexcept {
  const double dx = 1.0 / inv_dx, dy = 1.0 / inv_dy;
  const double radius = std::max(mark.radius_nm, kLeastNodes * std::max(dx, dy));
  const double per_radius = 1.0 / radius;
  const double reach = mark.pile_up > 0.0 ? kHeapReach * radius : radius;
  const int column = std::min(static_cast<int>(x * inv_dx), columns - 2);
  const int row = std::min(static_cast<int>(y * inv_dy), rows - 2);
  const CubicWeights wx = cubic_weights(x * inv_dx - column, inv_dx);
  const CubicWeights wy = cubic_weights(y * inv_dy - row, inv_dy);
  const auto xi_of = [&](int i) { return (place_of(i, columns, dx) - x) * per_radius; };
  const auto eta_of = [&](int j) { return (place_of(j, rows, dy) - y) * per_radius; };

  const bool two_levels = lanes == kLanes;
  double moments[3][4] = {{0, 0, 0, mark.depth_nm}, {0, 0, 0, 0}, {0, 0, 0, 0}};
  for (int r = 0; r < 4; ++r) {
    const double eta = eta_of(row + r);
    for (int c = 0; c < 4; ++c) {
      const double xi = xi_of(column + c);
      const double level = crater_level(xi, eta);
      const double terms[3] = {level, level * xi, level * eta};
      const double weight[3] = {wx.value[c] * wy.value[r], wx.slope[c] * wy.value[r],
                                wx.value[c] * wy.slope[r]};
      for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) moments[i][k] += weight[i] * terms[k];
      }
    }
  }
  double a[3];
  solve_crater(moments, a);

  const auto first_of = [&](double from, double inv, int cell) {
    return std::max(0, std::min(static_cast<int>(std::floor(std::max(0.0, from) * inv)), cell));
  };
  const auto last_of = [&](double to, double inv, int nodes, int cell) {
    const double at = std::min(to * inv, nodes + 1.0);
    return std::min(nodes + 1, std::max(static_cast<int>(std::ceil(at)) + 2, cell + 3));
  };
  const int first_column = first_of(x - reach, inv_dx, column), first_row = first_of(y - reach, inv_dy, row);
  const int last_column = last_of(x + reach, inv_dx, columns, column);
  const int last_row = last_of(y + reach, inv_dy, rows, row);
  make_usable(first_column, last_column, first_row, last_row);
  const Changing changing(*this, {first_column, last_column, first_row, last_row});
  const auto coefficient = [&](double* base, int i, int j) {
    return base + static_cast<std::size_t>(j) * static_cast<std::size_t>(stride()) +
           static_cast<std::size_t>(i) * static_cast<std::size_t>(lanes);
  };
  const double last_a = mark.strain * mark.last_radius_nm;
  double lost = 0, heap = 0, risen = 0;
  for (int j = first_row; j <= last_row; ++j) {
    const double eta = eta_of(j);
    const bool row_reaches = j >= row && j <= row + 3;
    const bool row_inside = j > 0 && j <= rows;
    for (int i = first_column; i <= last_column; ++i) {
      const double xi = xi_of(i);
      const bool reaches = row_reaches && i >= column && i <= column + 3;
      const bool inside = row_inside && i > 0 && i <= columns;  // its image is not counted twice
      const double level = crater_level(xi, eta);
      if (!(level > 0.0)) {
        if (inside && !reaches) heap += heap_level(xi, eta);
        continue;
      }
      double* const at = coefficient(own, i, j);
      const double fall = level * (a[0] + a[1] * xi + a[2] * eta);
      at[0] -= fall;
      if (two_levels) at[3] -= fall;
      if (inside) lost += fall;
      double rise = level * mark.log_radius_rise;
      if (mark.strain > 0.0) {
        rise = 0;
        if (fall > 0.0) {
          const double origin = det_exp(made.get()[at - own + 1]);
          const double old = mark.strain * det_exp(at[1]);
          const FlowFamily family(mark.strain, origin, last_a);
          const double after = family.elastic_nm(family.after_nm(old, fall * at[2]));
          if (after > old) rise = LogOnePlus(after / old - 1.0).log();
        }
      }
      at[1] += rise;
      if (two_levels) at[4] += rise;
      if (reaches) risen += wx.value[i - column] * wy.value[j - row] * rise;
    }
  }
  const double lacking = mark.log_radius_rise - risen;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) {
      double* const at = coefficient(own, column + c, row + r);
      at[1] += lacking;
      if (two_levels) at[4] += lacking;
    }
  }
  if (!(mark.pile_up > 0.0 && heap > 0.0 && lost > 0.0)) return;
  const double height = mark.pile_up * lost / heap;
  for (int j = first_row; j <= last_row; ++j) {
    const double eta = eta_of(j);
    const bool row_reaches = j >= row && j <= row + 3;
    for (int i = first_column; i <= last_column; ++i) {
      if (row_reaches && i >= column && i <= column + 3) continue;
      const double level = heap_level(xi_of(i), eta);
      if (!(level > 0.0)) continue;
      double* const at = coefficient(own, i, j);
      at[0] += height * level;
      if (two_levels) at[3] += height * level;
    }
  }
}

void ScanFields::press(const FieldMark& mark) noexcept {
  if (!is_mark(mark) || !grids_[0].own) return;
  bool back_x, back_y;
  const double x = mirrored(mark.x_nm - x_first_, width_, back_x);
  const double y = mirrored(mark.y_nm - y_first_, length_, back_y);
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    Grid& grid = grids_[g];
    grid.press(mark, x, y);
    // Where the crater is spread on a coarse grid that falls more than the finer one does round it, and a
    // larger softening must not lower the ground so much that pressing deeper would lift it away
    // (scan_fields_build.cpp): held up there, but for the 16 that the mark itself needs.
    const double spread = kLeastNodes * std::max(1.0 / grid.inv_dx, 1.0 / grid.inv_dy);
    if (g == 0 || spread <= mark.radius_nm || grids_[g - 1].columns == grid.columns) continue;
    const Grid& finer = grids_[g - 1];
    const double most_fall = 0.53 * rule_.finest_nm * (1 << (2 * g - 1));
    const int column = std::min(static_cast<int>(x * grid.inv_dx), grid.columns - 2);
    const int row = std::min(static_cast<int>(y * grid.inv_dy), grid.rows - 2);
    constexpr int kReach = static_cast<int>(kLeastNodes) + 1;
    const auto node_of = [](int padded, int nodes) {
      const int i = padded - 1;
      return i < 0 ? -i : (i < nodes ? i : 2 * nodes - 2 - i);
    };
    const int left = std::max(0, column + 1 - kReach),
              right = std::min(grid.columns + 1, column + 2 + kReach);
    const int low = std::max(0, row + 1 - kReach), high = std::min(grid.rows + 1, row + 2 + kReach);
    grid.make_usable(left, right, low, high);
    const Grid::Changing changing(grid, {left, right, low, high});
    for (int j = low; j <= high; ++j) {
      for (int i = left; i <= right; ++i) {
        if (i >= column && i <= column + 3 && j >= row && j <= row + 3) continue;
        double* const at = grid.own + static_cast<std::size_t>(j) * static_cast<std::size_t>(grid.stride()) +
                           static_cast<std::size_t>(i) * kLanes;
        const int fi = 2 * node_of(i, grid.columns), fj = 2 * node_of(j, grid.rows);  // node, padded less 1
        const double* const fine = finer.corner(fi, fj) + finer.stride() + kLanes + 3;
        const double lacking = std::max(0.0, *fine - most_fall - at[0]);
        at[0] += lacking;
        at[3] += lacking;
      }
    }
  }
  for (Layer& layer : layers_) layer.grid.press(mark, x, y);
}

std::size_t ScanFields::own_bytes() const noexcept {
  std::size_t values = 0;
  const auto add = [&](const Grid& grid) {
    values += static_cast<std::size_t>(std::count(grid.copied.begin(), grid.copied.end(), 1)) * kTile *
              kTile * static_cast<std::size_t>(grid.lanes);
  };
  for (const Grid& grid : grids_) add(grid);
  for (const Layer& layer : layers_) add(layer.grid);
  return values * sizeof(double);
}

}  // namespace telenano::physics
