// Marks in the fields of a scan: a local change of their coefficients, not of the nodes (spline_marks.cpp
// does the same for heights and says why). On each grid the coefficients of H fall by φ(a + b ξ + c η), φ the
// crater's level (crater.h), both levels of softening alike, such that H falls by the depth at the mark and
// keeps both slopes there; so the overlap at every apex there is what it was a depth higher, the softening,
// which goes by the distance from touch, included. Grids too coarse for the crater spread it over
// kLeastNodes of theirs. ρ follows the depth by the flow's own law; what then lacks to the rise at the mark
// the 16 coefficients share that reach it. The cosine stays.
#include <emmintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <new>
#include <span>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/contact/flow_family.h"
#include "telenano/nve_server/physics/numerics/log_one_plus.h"
#include "telenano/nve_server/physics/surface/crater.h"
#include "telenano/nve_server/physics/surface/cubic_weights.h"
#include "telenano/nve_server/physics/surface/heap_rows.h"
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

// The product of two words, both halves folded into one.
std::uint64_t folded_product(std::uint64_t a, std::uint64_t b) noexcept {
  __extension__ using Wide = unsigned __int128;
  const Wide product = static_cast<Wide>(a) * b;
  return static_cast<std::uint64_t>(product) ^ static_cast<std::uint64_t>(product >> 64);
}

// Of H and ρ of both levels of a coefficient, or of one level. The place is in it, so that what changes places
// counts. Odd constants of SplitMix64 and its finaliser (Steele, Lea, Flood 2014).
std::uint64_t word_of(std::uint64_t place, const double* value, bool two_levels) noexcept {
  const auto bits = [value](int lane) { return std::bit_cast<std::uint64_t>(value[lane]); };
  const std::uint64_t word =
      folded_product(bits(0) ^ (place + 1) * 0x9e3779b97f4a7c15u, bits(1) ^ 0xbf58476d1ce4e5b9u);
  if (!two_levels) return word;
  return folded_product(word ^ bits(3), bits(4) ^ 0x94d049bb133111ebu);
}

/// Some coefficients in a row of a crater: by how much H falls and ρ rises. What one of them takes waits for
/// itself (roots, divisions, a series); in loops of a few operations each several are under way at once.
struct CraterRow {
  static constexpr int kMost = 64;
  static_assert(kMost % 2 == 0);
  int count = 0;
  int column[kMost];
  double level[kMost], fall[kMost], rise[kMost];

  void add(int i, double level_, double fall_) noexcept {
    column[count] = i;
    level[count] = level_;
    fall[count] = fall_;
    ++count;
  }

  void rise_by_level(double log_radius_rise) noexcept {
    for (int k = 0; k < count; ++k) rise[k] = level[k] * log_radius_rise;
  }

  /// By the flow's own law at the depth that the coefficient falls: `own` and `made` begin with the row's.
  void rise_by_flow(const double* own, const double* made, std::size_t lanes, double strain,
                    double last_a) noexcept {
    double origin[kMost], old[kMost], cosine[kMost], more[kMost];
    for (int k = 0; k < count; ++k) {
      const std::size_t at = static_cast<std::size_t>(column[k]) * lanes;
      origin[k] = made[at + 1];
      old[k] = own[at + 1];
      cosine[k] = own[at + 2];
    }
    // Level ground has one radius before any mark.
    bool alike = true;
    for (int k = 1; k < count; ++k) alike &= origin[k] == origin[0];
    if (alike && count > 0) {
      std::fill_n(origin, count, det_exp(origin[0]));
    } else {
      det_exp_each(origin, static_cast<std::size_t>(count), origin);
    }
    det_exp_each(old, static_cast<std::size_t>(count), old);
    for (int k = 0; k < count; ++k) old[k] *= strain;
    if (count % 2 != 0) {  // the last goes with one that is thrown away
      origin[count] = old[count] = cosine[count] = 1.0;
      fall[count] = 0.0;
    }
    for (int k = 0; k < count; k += 2) {
      const __m128d before = _mm_loadu_pd(old + k), falls = _mm_loadu_pd(fall + k);
      const __m128d after = elastic_after_two_nm(strain, _mm_loadu_pd(origin + k), last_a, before,
                                                 _mm_mul_pd(falls, _mm_loadu_pd(cosine + k)));
      // Where it rises, or does not fall at all, the radius stays.
      const __m128d grows = _mm_and_pd(_mm_cmpgt_pd(falls, _mm_setzero_pd()), _mm_cmpgt_pd(after, before));
      _mm_storeu_pd(more + k, _mm_and_pd(grows, _mm_sub_pd(_mm_div_pd(after, before), _mm_set1_pd(1.0))));
    }
    log_one_plus(more, count, rise);
  }
};

/// Raises `count` coefficients in a row by height · level, those of a level above 0, keeps their words, and tells by how much
/// these have grown. Their number of lanes is a constant, so that nothing is looked up for each.
template <int kLanesEach, bool kTwoLevels>
std::uint64_t raise_row(double* at, std::uint64_t* words, std::size_t number, const double* level, int count,
                        double height) noexcept {
  std::uint64_t change = 0;
  for (int i = 0; i < count; ++i, ++number, at += kLanesEach) {
    if (!(level[i] > 0.0)) continue;
    const double rise = height * level[i];
    at[0] += rise;
    if constexpr (kTwoLevels) at[3] += rise;
    const std::uint64_t word = word_of(number, at, kTwoLevels);
    change += word - words[number];
    words[number] = word;
  }
  return change;
}

/// The same for what falls in a crater, with ρ rising.
template <int kLanesEach, bool kTwoLevels>
std::uint64_t lower_row(double* line, std::uint64_t* words, std::size_t first, const CraterRow& part,
                        int from, int to) noexcept {
  std::uint64_t change = 0;
  for (int k = from; k < to; ++k) {
    const auto i = static_cast<std::size_t>(part.column[k]);
    double* const at = line + i * kLanesEach;
    at[0] -= part.fall[k];
    at[1] += part.rise[k];
    if constexpr (kTwoLevels) {
      at[3] -= part.fall[k];
      at[4] += part.rise[k];
    }
    const std::uint64_t word = word_of(first + i, at, kTwoLevels);
    change += word - words[first + i];
    words[first + i] = word;
  }
  return change;
}

// What a snapshot may say that marks have done, wherever it comes from: no tip has pressed deeper, no heap
// stands higher, and the law has no radius beyond (branch_potential.h).
constexpr double kMostPressed_nm = 1e4;
constexpr double kMostLogRadiusRise = 12;

}  // namespace

/// While one coefficient changes: the digest goes with it.
class ScanFields::Grid::Changing {
 public:
  Changing(Grid& grid, std::size_t number) noexcept : grid_(grid), number_(number) {
    grid_.digest -= grid_.words[number_];
  }
  ~Changing() {
    grid_.words[number_] = grid_.word(number_);
    grid_.digest += grid_.words[number_];
  }
  Changing(const Changing&) = delete;
  Changing& operator=(const Changing&) = delete;

 private:
  Grid& grid_;
  std::size_t number_;
};

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

// Of grids that share their nodes: what goes by place alone is found once for all of them.
void ScanFields::press(std::span<Grid* const> grids, const FieldMark& mark, double x, double y) noexcept {
  const Grid& any = *grids[0];
  const int columns = any.columns, rows = any.rows;
  const double dx = 1.0 / any.inv_dx, dy = 1.0 / any.inv_dy;
  const double radius = std::max(mark.radius_nm, kLeastNodes * std::max(dx, dy));
  const double per_radius = 1.0 / radius;
  const double reach = mark.pile_up > 0.0 ? kHeapReach * radius : radius;
  const int column = std::min(static_cast<int>(x * any.inv_dx), columns - 2);
  const int row = std::min(static_cast<int>(y * any.inv_dy), rows - 2);
  const CubicWeights wx = cubic_weights(x * any.inv_dx - column, any.inv_dx);
  const CubicWeights wy = cubic_weights(y * any.inv_dy - row, any.inv_dy);
  const auto xi_of = [&](int i) { return (place_of(i, columns, dx) - x) * per_radius; };
  const auto eta_of = [&](int j) { return (place_of(j, rows, dy) - y) * per_radius; };

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

  const auto first_of = [](double from, double inv, int cell) {
    return std::max(0, std::min(static_cast<int>(std::floor(std::max(0.0, from) * inv)), cell));
  };
  const auto last_of = [](double to, double inv, int nodes, int cell) {
    const double at = std::min(to * inv, nodes + 1.0);
    return std::min(nodes + 1, std::max(static_cast<int>(std::ceil(at)) + 2, cell + 3));
  };
  const int first_column = first_of(x - reach, any.inv_dx, column);
  const int last_column = last_of(x + reach, any.inv_dx, columns, column);
  const int first_row = first_of(y - reach, any.inv_dy, row);
  const int last_row = last_of(y + reach, any.inv_dy, rows, row);
  for (Grid* const grid : grids) {
    grid->make_usable(first_column, last_column, first_row, last_row);
    if (strokes_ != nullptr)
      grid->keep_tiles(*strokes_, number_of_grid(*grid), first_column, last_column, first_row, last_row);
  }

  // The rows and columns that may be within a circle of `extent` radii, in order.
  const auto each_within = [&](double extent, const auto& use) {
    const double far = extent * radius;
    const int low = first_of(y - far, any.inv_dy, row), high = last_of(y + far, any.inv_dy, rows, row);
    for (int j = low; j <= high; ++j) {
      const double eta = eta_of(j);
      const double rest = extent * extent - eta * eta;
      if (!(rest > 0.0)) continue;
      const double half = std::sqrt(rest) * radius;
      const int left = first_of(x - half, any.inv_dx, columns + 1);
      const int right = last_of(x + half, any.inv_dx, columns, 0);
      use(j, eta, left, right);
    }
  };
  const auto number_of = [&](int i, int j) { return static_cast<std::size_t>(j * (columns + 2) + i); };
  const auto reaches = [&](int i, int j) {
    return j >= row && j <= row + 3 && i >= column && i <= column + 3;
  };
  // Its image is not counted twice.
  const auto inside = [&](int i, int j) { return j > 0 && j <= rows && i > 0 && i <= columns; };

  for (Grid* const grid : grids) {
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) grid->digest -= grid->words[number_of(column + c, row + r)];
    }
  }
  const double last_a = mark.strain * mark.last_radius_nm;
  double risen[kMostTogether] = {};
  double lost = 0;
  // The row after this one is fetched while this one is worked on: rows lie too far apart for the processor to
  // foresee where the next one begins.
  const auto fetch = [](const double* begin, std::size_t values) {
    constexpr std::size_t kLine = 8;
    for (std::size_t i = 0; i < values; i += kLine) __builtin_prefetch(begin + i);
  };
  ColumnPlaces places(first_column, last_column, xi_of);
  CraterRow part;
  each_within(1.0, [&](int j, double eta, int left, int right) {
    for (Grid* const grid : grids) {
      if (j == last_row || !(mark.strain > 0.0)) break;
      const auto lanes = static_cast<std::size_t>(grid->lanes);
      const std::size_t at = number_of(left, j + 1) * lanes;
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
        fall[k] = level[k] * (a[0] + a[1] * xi[k] + a[2] * eta);
      }
      part.count = 0;
      for (int k = 0; k < across; ++k) {
        if (!(level[k] > 0.0)) continue;
        if (inside(from + k, j)) lost += fall[k];
        part.add(from + k, level[k], fall[k]);
      }
      for (std::size_t g = 0; g < grids.size(); ++g) {
        Grid& grid = *grids[g];
        const bool two_levels = grid.lanes == kLanes;
        const auto lanes = static_cast<std::size_t>(grid.lanes);
        const std::size_t line = number_of(0, j);
        if (mark.strain > 0.0) {
          part.rise_by_flow(grid.own + line * lanes, grid.made.get() + line * lanes, lanes, mark.strain,
                            last_a);
        } else {
          part.rise_by_level(mark.log_radius_rise);
        }
        double* const at_line = grid.own + line * lanes;
        const auto lower = [&](int first, int last) {
          grid.digest += two_levels
                             ? lower_row<kLanes, true>(at_line, grid.words, line, part, first, last)
                             : lower_row<kLayerLanes, false>(at_line, grid.words, line, part, first, last);
        };
        // The 16 that reach the mark are in the digest when all is done.
        int reached = part.count, beyond = part.count;
        if (j >= row && j <= row + 3) {
          const int* const begin = part.column;
          reached = static_cast<int>(std::lower_bound(begin, begin + part.count, column) - begin);
          beyond = static_cast<int>(std::lower_bound(begin, begin + part.count, column + 4) - begin);
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
          risen[g] += wx.value[i - column] * wy.value[j - row] * part.rise[k];
        }
        lower(beyond, part.count);
      }
    }
  });
  for (std::size_t g = 0; g < grids.size(); ++g) {
    Grid& grid = *grids[g];
    const double lacking = mark.log_radius_rise - risen[g];
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        const std::size_t number = number_of(column + c, row + r);
        double* const at = grid.own + number * static_cast<std::size_t>(grid.lanes);
        at[1] += lacking;
        if (grid.lanes == kLanes) at[4] += lacking;
        grid.words[number] = grid.word(number);
        grid.digest += grid.words[number];
      }
    }
  }
  if (!(mark.pile_up > 0.0 && lost > 0.0)) return;
  HeapRows rows_of_heap;
  const auto each_of_heap = [&](const auto& use) {
    each_within(kHeapReach, [&](int j, double eta, int left, int right) {
      for (int from = left; from <= right; from += HeapRows::kBlock) {
        const int count = std::min(HeapRows::kBlock, right + 1 - from);
        use(j, from, count, rows_of_heap.levels(from, count, eta, places));
      }
    });
  };
  double heap = 0;
  each_of_heap([&](int j, int from, int count, const double* level) {
    const bool near = j >= row && j <= row + 3 && from <= column + 3 && from + count > column;
    if (!near && inside(from, j) && inside(from + count - 1, j)) {
      for (int i = 0; i < count; ++i) heap += level[i];  // what is none adds 0
      return;
    }
    for (int i = 0; i < count; ++i) {
      if (level[i] > 0.0 && !reaches(from + i, j) && inside(from + i, j)) heap += level[i];
    }
  });
  if (!(heap > 0.0)) return;
  const double height = mark.pile_up * lost / heap;
  rows_of_heap.again();
  each_of_heap([&](int j, int from, int count, const double* level) {
    const auto raise = [&](int first, int last) {  // of the row's columns
      if (first >= last) return;
      for (Grid* const grid : grids) {
        if (j < last_row)
          fetch(grid->own + number_of(first, j + 1) * static_cast<std::size_t>(grid->lanes),
                static_cast<std::size_t>(last - first) * static_cast<std::size_t>(grid->lanes));
        const std::size_t number = number_of(first, j);
        double* const at = grid->own + number * static_cast<std::size_t>(grid->lanes);
        const double* const levels = level + (first - from);
        grid->digest +=
            grid->lanes == kLanes
                ? raise_row<kLanes, true>(at, grid->words, number, levels, last - first, height)
                : raise_row<kLayerLanes, false>(at, grid->words, number, levels, last - first, height);
      }
    };
    const int end = from + count;
    const bool near = j >= row && j <= row + 3;
    raise(from, near ? std::min(end, column) : end);
    if (near) raise(std::max(from, column + 4), end);
  });
}

void ScanFields::press(const FieldMark& mark) noexcept {
  if (!is_mark(mark) || !grids_[0].own) return;
  bool back_x, back_y;
  const double x = mirrored(mark.x_nm - x_first_, width_, back_x);
  const double y = mirrored(mark.y_nm - y_first_, length_, back_y);
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    Grid& grid = grids_[g];
    if (g == 0 || grid.columns != grids_[g - 1].columns) press_alike(grid, mark, x, y);
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
    if (strokes_ != nullptr) grid.keep_tiles(*strokes_, g, left, right, low, high);
    for (int j = low; j <= high; ++j) {
      for (int i = left; i <= right; ++i) {
        if (i >= column && i <= column + 3 && j >= row && j <= row + 3) continue;
        const auto number = static_cast<std::size_t>(j * (grid.columns + 2) + i);
        double* const at = grid.own + number * kLanes;
        const int fi = 2 * node_of(i, grid.columns), fj = 2 * node_of(j, grid.rows);  // node, padded less 1
        const double* const fine = finer.corner(fi, fj) + finer.stride() + kLanes + 3;
        const double lacking = std::max(0.0, *fine - most_fall - at[0]);
        if (!(lacking > 0.0)) continue;
        const Grid::Changing changing(grid, number);
        at[0] += lacking;
        at[3] += lacking;
      }
    }
  }
}

// All grids that share this one's nodes.
void ScanFields::press_alike(const Grid& one, const FieldMark& mark, double x, double y) noexcept {
  Grid* alike[kMostTogether];
  std::size_t count = 0;
  const auto number = static_cast<std::uint32_t>(grids_.size() + layers_.size());
  for (std::uint32_t n = 0; n < number; ++n) {
    Grid* const grid = grid_of(n);
    if (grid->columns != one.columns || grid->rows != one.rows) continue;
    alike[count++] = grid;
    if (count < kMostTogether) continue;
    press({alike, count}, mark, x, y);
    count = 0;
  }
  if (count > 0) press({alike, count}, mark, x, y);
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
