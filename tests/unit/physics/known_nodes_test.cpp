// Nodes that are made once, a few at a time: the same bits as all at once, on gentle ground and on ground so steep that parts of a
// tile have references of their own.
#include "telenano/nve_server/physics/surface/known_nodes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <thread>
#include <vector>

namespace telenano::physics {
namespace {

constexpr double kRadius = 20, kSoftening = 0.09;

struct Ground {
  explicit Ground(double relief_nm) {
    std::mt19937 random(5);
    grid.columns = grid.rows = 90;
    grid.dx_nm = grid.dy_nm = 1;
    for (int k = 0; k < grid.columns * grid.rows; ++k)
      grid.z_nm.push_back(relief_nm * 0x1p-32 * static_cast<double>(random()));
  }
  Dilation dilation(const BicubicSpline& height) const {
    const auto [low, high] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
    return {height, dilation_lattice(height, 0.9, 0.65 * std::sqrt(kRadius * kSoftening)), kRadius,
            kSoftening, *high - *low};
  }
  surface::HeightGrid grid;
};

bool same(const DilatedNode& a, const DilatedNode& b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

TEST(KnownNodes, AreTheSameBitsInWhateverPieces) {
  for (const double relief_nm : {1.0, 12.0, 90.0}) {
    const Ground ground(relief_nm);
    const BicubicSpline height = BicubicSpline::interpolating(ground.grid);
    const Dilation whole = ground.dilation(height);
    const std::vector<DilatedNode> all = whole.make_all();
    const int columns = whole.lattice().columns, rows = whole.lattice().rows;
    KnownNodes known(ground.dilation(height));
    std::mt19937 random(7);
    std::vector<DilatedNode> some;
    for (int n = 0; n < 60; ++n) {
      const int i0 = static_cast<int>(random() % static_cast<unsigned>(columns - 1));
      const int j0 = static_cast<int>(random() % static_cast<unsigned>(rows - 1));
      const int nx = 1 + static_cast<int>(random() % static_cast<unsigned>(std::min(30, columns - i0)));
      const int ny = 1 + static_cast<int>(random() % static_cast<unsigned>(std::min(30, rows - j0)));
      known.get(i0, j0, nx, ny, some);
      ASSERT_EQ(some.size(), static_cast<std::size_t>(nx * ny));
      for (int j = 0; j < ny; ++j) {
        for (int i = 0; i < nx; ++i) {
          const auto at = static_cast<std::size_t>((j0 + j) * columns + i0 + i);
          ASSERT_TRUE(same(some[static_cast<std::size_t>(j * nx + i)], all[at]))
              << relief_nm << ": " << i0 + i << ", " << j0 + j;
        }
      }
    }
  }
}

// Tiles of 16 along a strip, each with two nodes on either side: no node is made twice.
TEST(KnownNodes, OfAStripEachIsMadeOnce) {
  const Ground ground(3);
  const BicubicSpline height = BicubicSpline::interpolating(ground.grid);
  KnownNodes known(ground.dilation(height));
  std::vector<DilatedNode> some;
  for (const int row : {16, 32}) {
    for (int column = 16; column <= 64; column += 16) known.get(column - 2, row - 2, 20, 20, some);
  }
  EXPECT_EQ(known.made(), 68u * 36u);
  known.get(14, 14, 68, 36, some);
  EXPECT_EQ(known.made(), 68u * 36u) << "all are there";
}

TEST(KnownNodes, AreMadeByManyThreads) {
  const Ground ground(12);
  const BicubicSpline height = BicubicSpline::interpolating(ground.grid);
  const std::vector<DilatedNode> all = ground.dilation(height).make_all();
  KnownNodes known(ground.dilation(height));
  const int columns = dilation_lattice(height, 0.9, 0.65 * std::sqrt(kRadius * kSoftening)).columns;
  std::atomic<int> different{0};
  std::vector<std::thread> threads;
  for (unsigned seed = 0; seed < 4; ++seed) {
    threads.emplace_back([&, seed] {
      std::mt19937 random(seed / 2);  // two go the same way
      std::vector<DilatedNode> some;
      for (int n = 0; n < 40; ++n) {
        const int i0 = static_cast<int>(random() % 70), j0 = static_cast<int>(random() % 70);
        known.get(i0, j0, 20, 20, some);
        for (int j = 0; j < 20; ++j)
          for (int i = 0; i < 20; ++i)
            different += !same(some[static_cast<std::size_t>(20 * j + i)],
                               all[static_cast<std::size_t>((j0 + j) * columns + i0 + i)]);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(different.load(), 0);
}

}  // namespace
}  // namespace telenano::physics
