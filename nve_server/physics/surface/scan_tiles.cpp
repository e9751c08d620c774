#include "telenano/nve_server/physics/surface/scan_tiles.h"

#include <cmath>
#include <cstdlib>
#include <cstring>

#include "telenano/common/base/det_math.h"

namespace telenano::physics {

ScanFields::Tiles::Tiles(ScanFields& fields, std::shared_ptr<const BicubicSpline> height,
                         const DilationLattice& top, double relief_nm,
                         std::shared_ptr<const RetractionKernel> pull_off)
    : height_(std::move(height)),
      pull_off_(std::move(pull_off)),
      most_log_radius_(det_log(kMostRadii * fields.radius_)) {
  const auto add = [&](Grid& grid, double first_t, double second_t) {
    OfGrid of;
    of.layer = grid.lanes == kLayerLanes;
    of.finest_nm = first_t;
    const int ratio = (fields.grids_[0].columns - 1) / (grid.columns - 1);
    of.side = std::max(kLeastSide, kSide / ratio);
    of.across = (grid.columns + 2 + of.side - 1) / of.side;
    of.along = (grid.rows + 2 + of.side - 1) / of.side;
    const std::size_t tiles = of.tile(0, of.along);
    of.state = std::make_unique<std::atomic<int>[]>(tiles);
    of.seen = std::make_unique<std::atomic<bool>[]>(tiles);
    of.memory = std::make_shared<surface::ReservedMemory>(grid.size());
    for (const double t : {first_t, second_t}) {
      if (t > 0.0)
        of.nodes.push_back(std::make_unique<KnownNodes>(
            Dilation(*height_, fields.lattice_of(grid, top, t), fields.radius_, t, relief_nm, widest_lanes(),
                     grids_.empty() && of.nodes.empty() ? pull_off_.get() : nullptr)));
    }
    grid.made = {of.memory, of.memory->data()};
    grid.tiles = this;
    of.grid.lanes = grid.lanes;
    of.grid.columns = grid.columns;
    of.grid.rows = grid.rows;
    of.grid.inv_dx = grid.inv_dx;
    of.grid.inv_dy = grid.inv_dy;
    of.grid.made = grid.made;
    grids_.push_back(std::move(of));
  };
  for (std::size_t g = 0; g < fields.grids_.size(); ++g) {
    const int level = 2 * static_cast<int>(g);
    add(fields.grids_[g], fields.softening_of_level(level), fields.softening_of_level(level + 1));
  }
  for (Layer& layer : fields.layers_) add(layer.grid, layer.softening_nm, 0.0);
}

void ScanFields::Tiles::see(int number, int column, int row) noexcept {
  OfGrid& of = grids_[static_cast<std::size_t>(number)];
  const int ti = column / of.side, tj = row / of.side;
  std::atomic<bool>& seen = of.seen[of.tile(ti, tj)];
  if (seen.load(std::memory_order_acquire)) return;
  for (int j = tj; j <= std::min(tj + 1, of.along - 1); ++j) {
    for (int i = ti; i <= std::min(ti + 1, of.across - 1); ++i)
      ensure(static_cast<std::size_t>(number), i, j);
  }
  seen.store(true, std::memory_order_release);
  if (silent_.load(std::memory_order_relaxed)) return;
  // Whoever looks here may look further soon. A wish that nobody takes is forgotten.
  const int finer = (grids_[0].grid.columns - 1) / (of.grid.columns - 1);
  const auto x = static_cast<std::uint64_t>(column * finer);
  const auto y = static_cast<std::uint64_t>(row * finer);
  const std::uint32_t slot = wished_.fetch_add(1, std::memory_order_relaxed) % kWishes;
  wishes_[slot].store(std::uint64_t{1} << 63 | x << 31 | y, std::memory_order_release);
}

void ScanFields::Tiles::need(int number, const Span& columns, const Span& rows) noexcept {
  const OfGrid& of = grids_[static_cast<std::size_t>(number)];
  for (int tj = rows.first / of.side; tj <= rows.last / of.side; ++tj) {
    for (int ti = columns.first / of.side; ti <= columns.last / of.side; ++ti)
      ensure(static_cast<std::size_t>(number), ti, tj);
  }
}

// One makes it, others wait. Coarser grids wait for finer ones only: no circle.
void ScanFields::Tiles::ensure(std::size_t number, int ti, int tj) noexcept {
  OfGrid& of = grids_[number];
  std::atomic<int>& state = of.state[of.tile(ti, tj)];
  int now = state.load(std::memory_order_acquire);
  if (now == kMade) return;
  if (now == kNone && state.compare_exchange_strong(now, kMaking, std::memory_order_acq_rel)) {
    make(number, ti, tj);
    state.store(kMade, std::memory_order_release);
    state.notify_all();
    return;
  }
  while (state.load(std::memory_order_acquire) != kMade) state.wait(kMaking, std::memory_order_acquire);
}

void ScanFields::Tiles::make_raw(OfGrid& of, std::size_t level, const Patch& to, int lane) {
  const auto nodes_of = [](int first, int last, int count) {
    Span nodes{count, -1};
    for (int i = first; i <= last; ++i) {
      const int node = folded(i - 1, count);
      nodes.first = std::min(nodes.first, std::max(0, node - 2));
      nodes.last = std::max(nodes.last, std::min(count - 1, node + 2));
    }
    return nodes;
  };
  const Span x = nodes_of(to.left, to.right, of.grid.columns);
  const Span y = nodes_of(to.low, to.high, of.grid.rows);
  std::vector<DilatedNode> nodes;
  of.nodes[level]->get(x.first, y.first, x.count(), y.count(), nodes);
  interpolate(of.grid, nodes, x.first, y.first, x.count(), most_log_radius_, to, lane);
}

void ScanFields::Tiles::make(std::size_t number, int ti, int tj) {
  OfGrid& of = grids_[number];
  const Grid& grid = of.grid;
  const int left = ti * of.side, low = tj * of.side;
  const int right = std::min(left + of.side - 1, grid.columns + 1);
  const int high = std::min(low + of.side - 1, grid.rows + 1);
  const auto patch_of = [](const Span& x, const Span& y, int lanes, std::vector<double>& memory) {
    memory.resize(static_cast<std::size_t>(x.count()) * static_cast<std::size_t>(y.count()) *
                  static_cast<std::size_t>(lanes));
    return Patch{x.first, x.last,        y.first,
                 y.last,  memory.data(), static_cast<std::ptrdiff_t>(x.count()) * lanes,
                 lanes};
  };
  std::vector<double> memory;
  const Patch tile = patch_of({left, right}, {low, high}, grid.lanes, memory);
  const OfGrid* const finer = of.layer || number == 0 ? nullptr : &grids_[number - 1];
  const double fine_t = 0.5 * of.finest_nm;
  if (finer == nullptr || finer->grid.columns == grid.columns) {
    make_raw(of, 0, tile, 0);
    if (finer != nullptr) {
      need(static_cast<int>(number) - 1, {left, right}, {low, high});
      hold_growth(finer->grid, whole(finer->grid), grid, tile, tile, fine_t);
    }
  } else {
    const Span risen_x = risen_span(left, right, grid.columns + 2);
    const Span risen_y = risen_span(low, high, grid.rows + 2);
    std::vector<double> raw_memory;
    const Patch raw =
        patch_of(raw_span(risen_x, grid.columns + 2), raw_span(risen_y, grid.rows + 2), 3, raw_memory);
    make_raw(of, 0, raw, 0);
    need(static_cast<int>(number) - 1, fine_span(risen_x, finer->grid.columns + 2),
         fine_span(risen_y, finer->grid.rows + 2));
    hold_growth(finer->grid, whole(finer->grid), grid, raw, tile, fine_t);
    for (int j = low; j <= high; ++j) {
      for (int i = left; i <= right; ++i) std::memcpy(tile.at(i, j), raw.at(i, j), 3 * sizeof(double));
    }
  }
  if (!of.layer) {
    make_raw(of, 1, tile, 3);
    hold_growth(tile, of.finest_nm);
  }
  // Whole rows of tiles are opened, so that the system has few areas to keep; locked they would all be filled.
  const auto stride = static_cast<std::size_t>(grid.stride());
  if (!of.memory->open_unlocked(static_cast<std::size_t>(low) * stride,
                                static_cast<std::size_t>(high - low + 1) * stride))
    std::abort();
  for (int j = low; j <= high; ++j) {
    std::memcpy(whole(grid).at(left, j), tile.at(left, j),
                static_cast<std::size_t>(tile.stride) * sizeof(double));
  }
  bytes_.fetch_add(memory.size() * sizeof(double), std::memory_order_relaxed);
}

std::size_t ScanFields::Tiles::bytes() const noexcept {
  std::size_t sum = bytes_.load(std::memory_order_relaxed);
  for (const OfGrid& of : grids_)
    for (const auto& nodes : of.nodes) sum += nodes->bytes();
  return sum;
}

void ScanFields::Tiles::make_area(double left, double right, double low, double high) noexcept {
  for (std::size_t n = 0; n < grids_.size(); ++n) {
    const Grid& grid = grids_[n].grid;
    const int side = grids_[n].side;
    // With the next tile, as see() has it.
    const auto cells = [side](double first, double last, double inv, int nodes) {
      const auto cell = [&](double x) { return static_cast<int>(std::clamp(x * inv, 0.0, nodes - 2.0)); };
      return Span{cell(first), std::min((cell(last) / side + 1) * side, nodes + 1)};
    };
    need(static_cast<int>(n), cells(left, right, grid.inv_dx, grid.columns),
         cells(low, high, grid.inv_dy, grid.rows));
  }
}

void ScanFields::Tiles::Ways::note(const Place& place) noexcept {
  if (count_ == 0 || places_[0].distance(place) >= kSide / 2) {
    std::copy_backward(places_.begin(), places_.end() - 1, places_.end());
    count_ = std::min(count_ + 1, places_.size());
  }
  places_[0] = place;
}

std::array<double, 2> ScanFields::Tiles::Ways::step() const noexcept {
  std::size_t from = 0;  // the longest time ago, so that a slanting way is not taken for its last step
  for (std::size_t k = 1; k < count_; ++k) {
    if (places_[k].distance(places_[0]) <= kNear) from = k;
  }
  const double length = places_[0].distance(places_[from]);
  if (!(length > 0)) return {};
  return {kSide * (places_[0].column - places_[from].column) / length,
          kSide * (places_[0].row - places_[from].row) / length};
}

// The newest first. Several tips wish by turns, each from several grids at once.
bool ScanFields::Tiles::take_wish(Place& place) noexcept {
  const std::uint32_t now = wished_.load(std::memory_order_relaxed);
  for (std::uint32_t k = 1; k <= kWishes; ++k) {
    std::atomic<std::uint64_t>& slot = wishes_[(now - k) % kWishes];
    if (slot.load(std::memory_order_relaxed) == 0) continue;
    const std::uint64_t wish = slot.exchange(0, std::memory_order_acquire);
    if (wish == 0) continue;
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 31) - 1;
    place = {static_cast<int>(wish >> 31 & kMask), static_cast<int>(wish & kMask)};
    return true;
  }
  return false;
}

// First along the way, since a tip that goes on needs that soonest and a strip costs a third of what is around; then from the
// middle outwards, for one that turns. A newer wish is more urgent: what is left of this one somebody will wish for again.
bool ScanFields::Tiles::make_wished() noexcept {
  const std::uint32_t now = wished_.load(std::memory_order_relaxed);
  Place place;
  if (!take_wish(place)) return false;
  ways_.note(place);
  const Grid& grid = grids_[0].grid;
  /// What a tip there and close by needs, so many coefficients from here. False: somebody wishes for other things.
  const auto make = [&](double columns, double rows) {
    const double x = place.column + columns, y = place.row + rows;
    make_area((x - kBeside) / grid.inv_dx, (x + kBeside) / grid.inv_dx, (y - kBeside) / grid.inv_dy,
              (y + kBeside) / grid.inv_dy);
    return wished_.load(std::memory_order_relaxed) == now;
  };
  const std::array<double, 2> step = ways_.step();
  if (step[0] != 0.0 || step[1] != 0.0) {
    for (int k = 1; k <= kAhead; ++k) {
      if (!make(k * step[0], k * step[1])) return true;
    }
  }
  for (int around = 0; around <= kAround; ++around) {
    for (int rows = -around; rows <= around; ++rows) {
      const int stride = std::abs(rows) == around ? 1 : 2 * around;  // of the rows between only both ends
      for (int columns = -around; columns <= around; columns += std::max(1, stride)) {
        if (!make(kSide * columns, kSide * rows)) return true;
      }
    }
  }
  return true;
}

void ScanFields::Grid::see(int column, int row) const noexcept {
  tiles->see(grid_number, column, row);
}

void ScanFields::Grid::need(int left, int right, int low, int high) const noexcept {
  if (tiles != nullptr) tiles->need(grid_number, {left, right}, {low, high});
}

bool ScanFields::make_wished() const {
  return tiles_ && tiles_->make_wished();
}

void ScanFields::wish_nothing(bool nothing) const noexcept {
  if (tiles_) tiles_->wish_nothing(nothing);
}

void ScanFields::make_around(double x_nm, double y_nm, double reach_nm) const {
  if (!tiles_) return;
  const double x = x_nm - x_first_, y = y_nm - y_first_;
  tiles_->make_area(x - reach_nm, x + reach_nm, y - reach_nm, y + reach_nm);
}

std::size_t ScanFields::bytes_of_tiles() const noexcept {
  return tiles_->bytes();
}

}  // namespace telenano::physics
