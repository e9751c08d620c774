#pragma once

#include <array>
#include <vector>

#include "common/base/vec3.h"
#include "nve_server/physics/height_grid.h"

namespace telenano::physics {

/// Finds the samples of a height grid that are near to a point, by branch and bound: the samples in blocks of
/// 4×4, those in blocks of 4×4 blocks, each block bounded from below by its highest sample. Nothing that is
/// farther than the limit is ever opened.
class SampleTops {
 public:
  explicit SampleTops(const HeightGrid& grid);

  /// A part of the plane around a foot that is known already.
  struct Disc {
    double x_nm = 0;
    double y_nm = 0;
    double radius_nm = 0;
  };
  struct Sample {
    int column = 0;
    int row = 0;
    double distance_sq = 0;
  };
  /// At most so many; where there are more, farther ones are left out, never the nearest.
  static constexpr int kMaxNear = 24;
  struct Near {
    std::array<Sample, kMaxNear> samples;  // in no order
    int count = 0;
  };

  /// Samples nearer than `limit_nm`; of those in the disc only the ones nearer than `known_nm` <= limit_nm.
  void near(const Vec3& point_w_nm, double limit_nm, double known_nm, const Disc& disc,
            Near& out) const noexcept;
  /// None of the eight neighbours is nearer to the point.
  bool is_local_minimum(const Vec3& point_w_nm, const Sample& sample) const noexcept;

  /// A sample's new height: in constant time.
  void set(int column, int row, double z_nm) noexcept;

  double x_nm(int column) const noexcept { return x_first_ + column * dx_; }
  double y_nm(int row) const noexcept { return y_first_ + row * dy_; }
  double height_nm(int column, int row) const noexcept { return z_[index(column, row)]; }

  double highest_nm() const noexcept { return highest_; }  ///< at least: not lowered by set()
  double lowest_nm() const noexcept { return lowest_; }

 private:
  static constexpr int kBlock = 4;
  // Block by block, so that a block is two cache lines.
  std::size_t index(int column, int row) const noexcept {
    const int block = (row / kBlock) * block_columns_ + column / kBlock;
    return static_cast<std::size_t>(block * kBlock * kBlock + (row % kBlock) * kBlock + column % kBlock);
  }
  void open(const Vec3& point, int block_column, int block_row, double limit_sq, double known_sq,
            const Disc& disc, Near& out) const noexcept;

  int columns_, rows_;
  double dx_, dy_, inv_dx_, inv_dy_, x_first_, y_first_;
  double lowest_, highest_;
  int block_columns_, block_rows_, super_columns_, super_rows_;
  std::vector<double> z_;  // by blocks, −infinity beyond the rim
  std::vector<double> block_top_, super_top_;
};

}  // namespace telenano::physics
