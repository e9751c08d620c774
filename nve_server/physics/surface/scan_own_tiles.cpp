// What a session has of a scan's fields for itself: tiles that it has pressed, each copied when it is first needed, and as
// they were before its last strokes.
#include <algorithm>
#include <cstring>
#include <new>

#include "telenano/nve_server/physics/surface/coefficient_change.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::physics {

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
  const std::size_t coefficients = size() / static_cast<std::size_t>(lanes);
  if (tiles != nullptr) {
    copy.own_tiles = std::make_unique<surface::ReservedMemory>(size());
    copy.own = copy.own_tiles->data();
    static_assert(sizeof(std::uint64_t) == sizeof(double));
    copy.words_tiles = std::make_unique<surface::ReservedMemory>(coefficients);
    copy.words = reinterpret_cast<std::uint64_t*>(copy.words_tiles->data());  // nobody has them as doubles
  } else {
    // Zeroed by the system when first touched, if at all.
    copy.own_whole.reset(static_cast<double*>(std::calloc(size(), sizeof(double))));
    copy.own = copy.own_whole.get();
    copy.words_whole.reset(static_cast<std::uint64_t*>(std::calloc(coefficients, sizeof(std::uint64_t))));
    copy.words = copy.words_whole.get();
  }
  if (copy.own == nullptr || copy.words == nullptr) throw std::bad_alloc();
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
    const auto line = static_cast<std::size_t>(columns + 2);
    const std::size_t from = static_cast<std::size_t>(along * kTile) * line;
    const std::size_t all = static_cast<std::size_t>(last - along * kTile) * line;
    const auto each = static_cast<std::size_t>(lanes);
    if (!own_tiles->open(from * each, all * each) || !words_tiles->open(from, all)) std::abort();
  }
  for (int j = along * kTile; j < last; ++j) {
    const std::size_t at = static_cast<std::size_t>(j) * static_cast<std::size_t>(stride()) +
                           static_cast<std::size_t>(across * kTile) * static_cast<std::size_t>(lanes);
    std::memcpy(own + at, made.get() + at,
                static_cast<std::size_t>(count) * static_cast<std::size_t>(lanes) * sizeof(double));
    const std::size_t first = at / static_cast<std::size_t>(lanes);
    for (std::size_t i = first; i < first + static_cast<std::size_t>(count); ++i) words[i] = word(i);
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

template <class Use>
void ScanFields::Grid::each_line(std::size_t tile, const Use& use) const noexcept {
  const int across = static_cast<int>(tile) % tiles_across, along = static_cast<int>(tile) / tiles_across;
  const int count = std::min(kTile, columns + 2 - across * kTile);
  const int last = std::min((along + 1) * kTile, rows + 2);
  for (int j = along * kTile; j < last; ++j) {
    use(static_cast<std::size_t>(j) * static_cast<std::size_t>(stride()) +
            static_cast<std::size_t>(across * kTile) * static_cast<std::size_t>(lanes),
        static_cast<std::size_t>(count) * static_cast<std::size_t>(lanes));
  }
}

// They are usable, so that they are in `own`.
void ScanFields::Grid::keep_tiles(StrokeHistory& history, std::size_t grid, int first_column, int last_column,
                                  int first_row, int last_row) const noexcept {
  static_assert(StrokeHistory::kTileValues >= std::size_t{kTile} * kTile * kLanes);
  for (int along = first_row / kTile; along <= last_row / kTile; ++along) {
    for (int across = first_column / kTile; across <= last_column / kTile; ++across) {
      const auto tile = static_cast<std::size_t>(along * tiles_across + across);
      double* to = history.keep(grid, tile);
      if (to == nullptr) continue;
      each_line(tile, [&](std::size_t at, std::size_t count) {
        std::memcpy(to, own + at, count * sizeof(double));
        to += count;
      });
    }
  }
}

std::vector<std::size_t> ScanFields::tiles_of_grids() const {
  std::vector<std::size_t> tiles;
  for (const Grid& grid : grids_) tiles.push_back(grid.copied.size());
  for (const Layer& layer : layers_) tiles.push_back(layer.grid.copied.size());
  return tiles;
}

std::size_t ScanFields::number_of_grid(const Grid& grid) const noexcept {
  for (std::size_t g = 0; g < grids_.size(); ++g)
    if (&grids_[g] == &grid) return g;
  for (std::size_t i = 0; i < layers_.size(); ++i)
    if (&layers_[i].grid == &grid) return grids_.size() + i;
  return 0;
}

void ScanFields::exchange_tile(std::size_t grid, std::size_t tile, double* values) noexcept {
  Grid& of = *grid_of(static_cast<std::uint32_t>(grid));
  const auto lanes = static_cast<std::size_t>(of.lanes);
  of.each_line(tile, [&](std::size_t at, std::size_t count) {
    for (std::size_t i = 0; i < count; i += lanes) {
      const Grid::Changing changing(of, (at + i) / lanes);
      std::swap_ranges(values + i, values + i + lanes, of.own + at + i);
    }
    values += count;
  });
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
