#pragma once

#include <array>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/surface/height_grid.h"

namespace telenano::physics {

/// Finds the samples of a height grid that are near to a point, by branch and bound: the samples in blocks of
/// 4×4, those in blocks of 4×4 blocks, each block bounded from below by its highest sample. Nothing that is
/// farther than the limit is ever opened.
///
/// Beyond the rim its height goes on outwards: for a point that is out there, a sample of the rim is taken to
/// be where that continuation is nearest, straight across from it.
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
    double x_nm = 0;
    double y_nm = 0;
    double distance_sq = 0;
  };
  /// At most so many; where there are more, farther ones are left out, never the nearest.
  static constexpr int kMaxNear = 24;
  struct Near {
    std::array<Sample, kMaxNear> samples;  // in no order
    int count = 0;
    void add(const Sample& sample) noexcept;
  };

  /// Samples nearer than `limit_nm`; of those in the disc only the ones nearer than `known_nm` <= limit_nm.
  void near(const Vec3& point_w_nm, double limit_nm, double known_nm, const Disc& disc,
            Near& out) const noexcept;
  /// A sample's new height: in constant time.
  void set(int column, int row, double z_nm) noexcept;

  double x_nm(int column) const noexcept { return x_first_ + column * dx_; }
  double y_nm(int row) const noexcept { return y_first_ + row * dy_; }
  double height_nm(int column, int row) const noexcept { return z_[index(column, row)]; }

  double highest_nm() const noexcept { return highest_; }  ///< at least: not lowered by set()
  double lowest_nm() const noexcept { return lowest_; }

 private:
  // Four by four samples are a block, four by four blocks a super-block, each group of sixteen side by side
  // in memory and filled up with −infinity beyond the rim: sixteen bounds at a time, without branches.
  static constexpr int kBlock = 4;
  static constexpr int kGroup = kBlock * kBlock;
  std::size_t super_of(int column, int row) const noexcept {
    return static_cast<std::size_t>(row / kGroup) * static_cast<std::size_t>(super_columns_) +
           static_cast<std::size_t>(column / kGroup);
  }
  static std::size_t in_group(int column, int row) noexcept {
    return std::size_t{kBlock} * static_cast<std::size_t>(row % kBlock) +
           static_cast<std::size_t>(column % kBlock);
  }
  std::size_t block_of(int column, int row) const noexcept {
    return super_of(column, row) * kGroup + in_group(column / kBlock, row / kBlock);
  }
  std::size_t index(int column, int row) const noexcept {
    return block_of(column, row) * kGroup + in_group(column, row);
  }
  struct Query {
    Vec3 point;
    Vec3 within;              // the nearest above the grid: bounds from there hold for the continuation too
    bool beyond_x, beyond_y;  // the point is not there itself
    double limit_sq, known_sq;
    struct {
      double x_nm, y_nm, radius_sq;
    } disc;
  };
  void open_super(const Query& query, int column, int row, Near& out) const noexcept;
  void open_block(const Query& query, int column, int row, Near& out) const noexcept;

  int columns_, rows_;
  double dx_, dy_, inv_dx_, inv_dy_, x_first_, y_first_;
  double lowest_, highest_;
  Eigen::Array4d across_;  // a block's columns from its first, nm
  int super_columns_, super_rows_;
  std::vector<double> z_, block_top_, super_top_;
};

}  // namespace telenano::physics
