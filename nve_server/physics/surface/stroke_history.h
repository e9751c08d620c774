#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <span>
#include <vector>

namespace telenano::physics {

/// What strokes of marks have changed, so that the last ones can be taken back: of each tile of coefficients its
/// values before the stroke first touched it. A stroke is all that is pressed between two calls of begin(). Memory is
/// reserved once and taken page by page as it is written; where it is used up the oldest strokes are forgotten,
/// whole ones only, and a stroke that is larger than all of it cannot be taken back.
class StrokeHistory {
 public:
  static constexpr std::size_t kTileValues = 16 * 16 * 6;  ///< room for a tile of any grid
  static constexpr std::size_t kTiles = 340;               ///< 4 MiB

  /// `tiles_of[i]`: tiles of grid i. Throws std::bad_alloc.
  explicit StrokeHistory(const std::vector<std::size_t>& tiles_of)
      : kept_(kTiles), values_(static_cast<double*>(std::calloc(kTiles * kTileValues, sizeof(double)))) {
    if (!values_) throw std::bad_alloc();
    for (const std::size_t tiles : tiles_of) seen_.emplace_back(tiles, 0);
  }

  /// `maker`: whose it is, as who keeps it counts them.
  void begin(bool marked_before, std::uint64_t maker = 0) noexcept {
    ++stroke_;
    marked_before_ = marked_before;
    maker_ = maker;
    lost_ = false;
  }
  /// A tile is going to change. Room for its values, to be written there now; null: they are kept already, or
  /// cannot be.
  double* keep(std::size_t grid, std::size_t tile) noexcept {
    if (lost_ || stroke_ == 0 || seen_[grid][tile] == stroke_) return nullptr;
    if (count_ == kTiles && !forget_oldest()) {
      clear();
      lost_ = true;
      return nullptr;
    }
    seen_[grid][tile] = stroke_;
    const std::size_t at = (first_ + count_++) % kTiles;
    kept_[at] = {maker_, stroke_, static_cast<std::uint32_t>(grid), static_cast<std::uint32_t>(tile),
                 marked_before_};
    return values_.get() + at * kTileValues;
  }

  /// Strokes that can be taken back: none, or some.
  bool empty() const noexcept { return count_ == 0; }
  /// Was anything marked before the last of them?
  bool marked_before() const noexcept { return count_ > 0 && last().marked_before; }
  /// Whose the last of them is; 0: there is none, or nobody's in particular.
  std::uint64_t maker() const noexcept { return count_ > 0 ? last().maker : 0; }
  /// Tells of each tile of the last stroke: put(grid, tile, its values before). They stay until drop_last().
  template <class Put>
  void each_of_last(const Put& put) noexcept {
    for (std::size_t i = 0; i < of_last(); ++i) {
      const std::size_t at = (first_ + count_ - 1 - i) % kTiles;
      put(kept_[at].grid, kept_[at].tile, values_.get() + at * kTileValues);
    }
  }
  void drop_last() noexcept {
    count_ -= of_last();
    ++stroke_;  // what follows belongs to no stroke that is there
  }
  /// Nothing that was pressed until now can be taken back.
  void clear() noexcept {
    count_ = 0;
    ++stroke_;
  }

 private:
  struct Release {
    void operator()(double* p) const noexcept { std::free(p); }
  };
  struct Kept {
    std::uint64_t maker = 0;
    std::uint32_t stroke = 0;
    std::uint32_t grid = 0;
    std::uint32_t tile = 0;
    bool marked_before = false;
  };
  const Kept& last() const noexcept { return kept_[(first_ + count_ - 1) % kTiles]; }
  std::size_t of_last() const noexcept {
    std::size_t n = 0;
    while (n < count_ && kept_[(first_ + count_ - 1 - n) % kTiles].stroke == last().stroke) ++n;
    return n;
  }
  /// False: the oldest is the stroke that is under way.
  bool forget_oldest() noexcept {
    const std::uint32_t oldest = kept_[first_].stroke;
    if (oldest == stroke_) return false;
    while (count_ > 0 && kept_[first_].stroke == oldest) {
      first_ = (first_ + 1) % kTiles;
      --count_;
    }
    return true;
  }

  std::vector<Kept> kept_;  // a ring, the oldest at first_
  std::size_t first_ = 0;
  std::size_t count_ = 0;
  std::unique_ptr<double[], Release> values_;
  std::vector<std::vector<std::uint32_t>> seen_;  // the stroke that keeps a tile, by grid and tile
  std::uint32_t stroke_ = 0;
  std::uint64_t maker_ = 0;
  bool marked_before_ = false;
  bool lost_ = false;
};

}  // namespace telenano::physics
