#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <memory>
#include <vector>

namespace telenano::physics {

/// Private to Dilation: the highest and the lowest ground round each part of a lattice whose nodes are made a few at a time. A
/// node's sum has the reference of its whole part, so that its bits do not depend on which nodes are made with it; what that
/// takes, the heights of the part and of all that it reaches, is then found once. Any thread: whoever finds them, finds the same.
class PartExtremes {
 public:
  struct Extremes {
    double highest = 0, lowest = 0;
  };
  /// A tile of the lattice, and which of its parts: 0 is all of it, 4n + 1 to 4n + 4 the quarters of part n.
  struct Part {
    std::size_t tile = 0;
    std::size_t number = 0;
    Part quarter(std::size_t which) const noexcept { return {tile, 4 * number + 1 + which}; }
  };
  /// Of 64 × 64 nodes down to 8 × 8.
  static constexpr std::size_t kParts = 1 + 4 + 16 + 64;

  explicit PartExtremes(std::size_t tiles) : tiles_(tiles) {}
  ~PartExtremes() {
    for (std::atomic<Tile*>& tile : tiles_) delete tile.load(std::memory_order_relaxed);
  }
  PartExtremes(const PartExtremes&) = delete;
  PartExtremes& operator=(const PartExtremes&) = delete;

  /// False: nobody has found them yet.
  bool find(const Part& part, Extremes& extremes) const noexcept {
    const Tile* const tile = tiles_[part.tile].load(std::memory_order_acquire);
    if (tile == nullptr || !(*tile)[part.number].known.load(std::memory_order_acquire)) return false;
    extremes.highest = (*tile)[part.number].highest.load(std::memory_order_relaxed);
    extremes.lowest = (*tile)[part.number].lowest.load(std::memory_order_relaxed);
    return true;
  }
  void keep(const Part& part, const Extremes& extremes) {
    std::atomic<Tile*>& at = tiles_[part.tile];
    Tile* tile = at.load(std::memory_order_acquire);
    if (tile == nullptr) {
      auto made = std::make_unique<Tile>();
      if (at.compare_exchange_strong(tile, made.get(), std::memory_order_acq_rel)) tile = made.release();
    }
    Entry& entry = (*tile)[part.number];
    entry.highest.store(extremes.highest, std::memory_order_relaxed);
    entry.lowest.store(extremes.lowest, std::memory_order_relaxed);
    entry.known.store(true, std::memory_order_release);
  }

 private:
  struct Entry {
    std::atomic<double> highest{0}, lowest{0};
    std::atomic<bool> known{false};
  };
  using Tile = std::array<Entry, kParts>;
  std::vector<std::atomic<Tile*>> tiles_;
};

}  // namespace telenano::physics
