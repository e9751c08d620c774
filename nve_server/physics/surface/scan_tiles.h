#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "telenano/nve_server/physics/surface/known_nodes.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

/// Private to ScanFields: which coefficients of a large scan are made, and how one tile is.
namespace telenano::physics {

/// From first to last.
struct Span {
  int first = 0, last = -1;
  int count() const noexcept { return last - first + 1; }
  bool has(int i) const noexcept { return i >= first && i <= last; }
};

// What hold_growth() looks at so that padded coefficients of the coarser grid rise as they must. A coefficient
// of number n (its node n − 1) is raised by the finer grid's nodes from 2n − 4 to 2n; there the coarse spline
// has coefficients n − 2 to n + 2, the finer one 2n − 4 to 2n + 2. Beside the rim it rises with its image.
inline Span risen_span(int first, int last, int count) noexcept {
  if (last >= count - 3) return {std::min(first, count - 3), count - 1};
  return {first <= 2 ? 0 : first, last <= 2 ? std::max(2, last) : last};
}
inline Span nodes_that_raise(const Span& risen, int finer_nodes) noexcept {
  return {std::max(0, 2 * risen.first - 4), std::min(finer_nodes - 1, 2 * risen.last)};
}
inline Span raw_span(const Span& risen, int count) noexcept {
  return {std::max(0, risen.first - 2), std::min(count - 1, risen.last + 2)};
}
inline Span fine_span(const Span& risen, int finer_count) noexcept {
  return {std::max(0, 2 * risen.first - 4), std::min(finer_count - 1, 2 * risen.last + 2)};
}

class ScanFields::Tiles {
 public:
  /// Of fields that are laid out: reserves their coefficients, and is asked by them from now on.
  Tiles(ScanFields& fields, std::shared_ptr<const BicubicSpline> height, const DilationLattice& top,
        double relief_nm, std::shared_ptr<const RetractionKernel> pull_off);

  void see(int grid, int column, int row) noexcept;
  void need(int grid, const Span& columns, const Span& rows) noexcept;
  /// By one thread only. False: nobody wishes for anything.
  bool make_wished() noexcept;
  void wish_nothing(bool nothing) noexcept { silent_.store(nothing, std::memory_order_relaxed); }
  /// What stencils reach that begin there, of all grids; nm from the first node.
  void make_area(double left, double right, double low, double high) noexcept;
  /// Of tiles, and of the nodes that they are made of.
  std::size_t bytes() const noexcept;

 private:
  static constexpr int kSide = 16;  // of a tile, finest coefficients; coarser grids cover as much
  static constexpr int kLeastSide = 4;
  static constexpr std::uint32_t kWishes = 64;
  static constexpr int kAhead = 6;   // tiles along the way of who looks
  static constexpr int kAround = 2;  // tiles round the one that is looked at
  static constexpr int kBeside = 4;  // coefficients beside the way: a tip moves sideways too
  enum : int { kNone, kMaking, kMade };
  /// A coefficient of the finest grid.
  struct Place {
    int column = 0, row = 0;
    int distance(const Place& other) const noexcept {
      return std::max(std::abs(column - other.column), std::abs(row - other.row));
    }
  };
  /// The last places that were wished around, the newest first: so where the tip at the newest one is going. Others' places are among
  /// them, which are further away.
  class Ways {
   public:
    void note(const Place& place) noexcept;
    /// As long as a tile, along the greater of both axes; zero: nobody came from anywhere near.
    std::array<double, 2> step() const noexcept;

   private:
    static constexpr int kNear = 4 * kSide;  // another tip is further away
    std::array<Place, 16> places_;
    std::size_t count_ = 0;
  };
  struct OfGrid {
    Grid grid;  // layout and memory alone
    bool layer = false;
    double finest_nm = 0;  // softening of the first lanes
    int side = kSide;
    int across = 0, along = 0;  // tiles
    std::unique_ptr<std::atomic<int>[]> state;
    std::unique_ptr<std::atomic<bool>[]> seen;  // it and the next ones, which its stencils reach, are made
    std::vector<std::unique_ptr<KnownNodes>> nodes;  // one a level
    std::shared_ptr<surface::ReservedMemory> memory;
    std::size_t tile(int ti, int tj) const noexcept {
      return static_cast<std::size_t>(tj) * static_cast<std::size_t>(across) + static_cast<std::size_t>(ti);
    }
  };
  bool take_wish(Place& place) noexcept;
  void ensure(std::size_t number, int ti, int tj) noexcept;
  void make(std::size_t number, int ti, int tj);
  void make_raw(OfGrid& of, std::size_t level, const Patch& to, int lane);

  std::shared_ptr<const BicubicSpline> height_;
  std::shared_ptr<const RetractionKernel> pull_off_;
  double most_log_radius_;
  std::vector<OfGrid> grids_;
  std::atomic<std::uint64_t> wishes_[kWishes] = {};
  std::atomic<std::uint32_t> wished_{0};
  Ways ways_;  // of the thread that makes what was wished
  std::atomic<bool> silent_{false};
  std::atomic<std::size_t> bytes_{0};
};

}  // namespace telenano::physics
