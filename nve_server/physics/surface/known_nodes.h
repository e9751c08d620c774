#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "telenano/nve_server/physics/surface/dilation.h"

namespace telenano::physics {

/// Private to ScanFields: the nodes of one dilation, each made once. A tile's coefficients take the nodes beside it as well, so
/// that of a strip of tiles a third of the nodes, and of small tiles of coarse grids most, would be made twice and more. Any
/// thread: two that make the same node make the same bits.
class KnownNodes {
 public:
  explicit KnownNodes(Dilation dilation)
      : dilation_(std::move(dilation)),
        across_(blocks(dilation_.lattice().columns)),
        blocks_(across_ * blocks(dilation_.lattice().rows)) {
    dilation_.remember_tiles();
  }
  ~KnownNodes() {
    for (std::atomic<Block*>& block : blocks_) delete block.load(std::memory_order_relaxed);
  }
  KnownNodes(const KnownNodes&) = delete;
  KnownNodes& operator=(const KnownNodes&) = delete;

  /// So many nodes were made, one that was made twice counted twice.
  std::size_t made() const noexcept { return made_.load(std::memory_order_relaxed); }
  std::size_t bytes() const noexcept { return bytes_.load(std::memory_order_relaxed); }
  /// The nodes of a rectangle, row-major.
  void get(int first_column, int first_row, int columns, int rows, std::vector<DilatedNode>& nodes) {
    make_missing(first_column, first_row, columns, rows);
    nodes.resize(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
    std::size_t at = 0;
    for (int j = first_row; j < first_row + rows; ++j)
      for (int i = first_column; i < first_column + columns; ++i) nodes[at++] = read(i, j);
  }

 private:
  static constexpr int kSide = 16;
  struct Block {
    /// A bit a column, for each row.
    std::array<std::atomic<std::uint32_t>, kSide> known{};
    std::array<std::array<std::atomic<double>, 3>, kSide * kSide> node{};
  };
  static std::size_t blocks(int nodes) { return static_cast<std::size_t>((nodes + kSide - 1) / kSide); }

  std::atomic<Block*>& block_of(int i, int j) noexcept {
    return blocks_[static_cast<std::size_t>(j / kSide) * across_ + static_cast<std::size_t>(i / kSide)];
  }
  bool knows(int i, int j) noexcept {
    const Block* const block = block_of(i, j).load(std::memory_order_acquire);
    return block != nullptr &&
           (block->known[static_cast<std::size_t>(j % kSide)].load(std::memory_order_acquire) >> (i % kSide) &
            1u) != 0;
  }
  DilatedNode read(int i, int j) noexcept {
    const Block& block = *block_of(i, j).load(std::memory_order_acquire);
    const auto& node = block.node[static_cast<std::size_t>(j % kSide * kSide + i % kSide)];
    return {node[0].load(std::memory_order_relaxed), node[1].load(std::memory_order_relaxed),
            node[2].load(std::memory_order_relaxed)};
  }
  void write(int i, int j, const DilatedNode& node) {
    std::atomic<Block*>& at = block_of(i, j);
    Block* block = at.load(std::memory_order_acquire);
    if (block == nullptr) {
      auto made = std::make_unique<Block>();
      if (at.compare_exchange_strong(block, made.get(), std::memory_order_acq_rel)) {
        block = made.release();
        bytes_.fetch_add(sizeof(Block), std::memory_order_relaxed);
      }
    }
    auto& to = block->node[static_cast<std::size_t>(j % kSide * kSide + i % kSide)];
    to[0].store(node.height_nm, std::memory_order_relaxed);
    to[1].store(node.log_radius, std::memory_order_relaxed);
    to[2].store(node.cosine, std::memory_order_relaxed);
    block->known[static_cast<std::size_t>(j % kSide)].fetch_or(1u << (i % kSide), std::memory_order_release);
  }

  /// The least rectangle in which all lie that are missing: along a strip these are a rectangle.
  void make_missing(int left, int low, int columns, int rows) {
    int right = left + columns - 1, high = low + rows - 1;
    const auto row_known = [&](int j) {
      for (int i = left; i <= right; ++i)
        if (!knows(i, j)) return false;
      return true;
    };
    const auto column_known = [&](int i) {
      for (int j = low; j <= high; ++j)
        if (!knows(i, j)) return false;
      return true;
    };
    while (low <= high && row_known(low)) ++low;
    while (low <= high && row_known(high)) --high;
    if (low > high) return;
    while (left <= right && column_known(left)) ++left;
    while (left <= right && column_known(right)) --right;
    if (left > right) return;  // somebody else has made them meanwhile
    std::vector<DilatedNode> made;
    dilation_.make_rectangle(left, low, right - left + 1, high - low + 1, made);
    made_.fetch_add(made.size(), std::memory_order_relaxed);
    std::size_t at = 0;
    for (int j = low; j <= high; ++j)
      for (int i = left; i <= right; ++i) write(i, j, made[at++]);
  }

  Dilation dilation_;
  std::size_t across_;
  std::vector<std::atomic<Block*>> blocks_;
  std::atomic<std::size_t> made_{0}, bytes_{0};
};

}  // namespace telenano::physics
