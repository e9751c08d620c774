#include "nve_server/physics/sample_tops.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::physics {
namespace {

int blocks_of(int count, int block) {
  return (count + block - 1) / block;
}

std::size_t product(int a, int b) {
  return static_cast<std::size_t>(a) * static_cast<std::size_t>(b);
}

// Distance from x to the interval [lo, hi], squared.
double outside_sq(double x, double lo, double hi) {
  const double d = std::max({lo - x, x - hi, 0.0});
  return d * d;
}

double above_sq(double z, double top) {
  const double d = std::max(z - top, 0.0);
  return d * d;
}

struct IndexRange {
  int first;
  int last;  // last < first: empty
};

// Samples with |x − (x_first + i·dx)| <= reach.
IndexRange within(double x, double reach, double x_first, double inv_dx, int count) {
  const double centre = (x - x_first) * inv_dx;
  const double half = reach * inv_dx;
  const double limit = static_cast<double>(count - 1);
  return {static_cast<int>(std::ceil(std::clamp(centre - half, 0.0, limit + 1))),
          static_cast<int>(std::floor(std::clamp(centre + half, -1.0, limit)))};
}

}  // namespace

SampleTops::SampleTops(const HeightGrid& grid)
    : columns_(grid.columns),
      rows_(grid.rows),
      dx_(grid.dx_nm),
      dy_(grid.dy_nm),
      inv_dx_(1.0 / grid.dx_nm),
      inv_dy_(1.0 / grid.dy_nm),
      x_first_(grid.x_first_nm),
      y_first_(grid.y_first_nm),
      lowest_(*std::min_element(grid.z_nm.begin(), grid.z_nm.end())),
      highest_(*std::max_element(grid.z_nm.begin(), grid.z_nm.end())),
      block_columns_(blocks_of(grid.columns, kBlock)),
      block_rows_(blocks_of(grid.rows, kBlock)),
      super_columns_(blocks_of(block_columns_, kBlock)),
      super_rows_(blocks_of(block_rows_, kBlock)),
      z_(product(block_columns_, block_rows_) * kBlock * kBlock, -std::numeric_limits<double>::infinity()),
      block_top_(product(block_columns_, block_rows_), -std::numeric_limits<double>::infinity()),
      super_top_(product(super_columns_, super_rows_), -std::numeric_limits<double>::infinity()) {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const double z = grid.z_nm[product(row, columns_) + static_cast<std::size_t>(column)];
      z_[index(column, row)] = z;
      double& block =
          block_top_[product(row / kBlock, block_columns_) + static_cast<std::size_t>(column / kBlock)];
      double& super = super_top_[product(row / (kBlock * kBlock), super_columns_) +
                                 static_cast<std::size_t>(column / (kBlock * kBlock))];
      block = std::max(block, z);
      super = std::max(super, z);
    }
  }
}

void SampleTops::set(int column, int row, double z_nm) noexcept {
  z_[index(column, row)] = z_nm;
  lowest_ = std::min(lowest_, z_nm);
  highest_ = std::max(highest_, z_nm);
  const int bc = column / kBlock, br = row / kBlock;
  const std::size_t block = product(br, block_columns_) + static_cast<std::size_t>(bc);
  const double* z = &z_[block * kBlock * kBlock];
  block_top_[block] = *std::max_element(z, z + kBlock * kBlock);
  double top = -std::numeric_limits<double>::infinity();
  const int row_end = std::min((br / kBlock + 1) * kBlock, block_rows_);
  const int column_end = std::min((bc / kBlock + 1) * kBlock, block_columns_);
  for (int r = br / kBlock * kBlock; r < row_end; ++r) {
    for (int c = bc / kBlock * kBlock; c < column_end; ++c) {
      top = std::max(top, block_top_[product(r, block_columns_) + static_cast<std::size_t>(c)]);
    }
  }
  super_top_[product(br / kBlock, super_columns_) + static_cast<std::size_t>(bc / kBlock)] = top;
}

void SampleTops::open(const Vec3& point, int block_column, int block_row, double limit_sq, double known_sq,
                      const Disc& disc, Near& out) const noexcept {
  const double* z =
      &z_[(product(block_row, block_columns_) + static_cast<std::size_t>(block_column)) * kBlock * kBlock];
  double sq[kBlock * kBlock], x_sq[kBlock];
  for (int c = 0; c < kBlock; ++c) {
    const double x = x_nm(block_column * kBlock + c) - point.x();
    x_sq[c] = x * x;
  }
  double least = limit_sq;
  for (int r = 0; r < kBlock; ++r) {
    const double y = y_nm(block_row * kBlock + r) - point.y();
    for (int c = 0; c < kBlock; ++c) {
      const double h = point.z() - z[r * kBlock + c];
      sq[r * kBlock + c] = x_sq[c] + y * y + h * h;
    }
  }
  for (int i = 0; i < kBlock * kBlock; ++i) least = std::min(least, sq[i]);
  if (!(least < limit_sq)) return;
  for (int i = 0; i < kBlock * kBlock; ++i) {
    if (!(sq[i] < limit_sq)) continue;
    const Sample sample{block_column * kBlock + i % kBlock, block_row * kBlock + i / kBlock, sq[i]};
    if (sq[i] >= known_sq) {
      const double ex = x_nm(sample.column) - disc.x_nm;
      const double ey = y_nm(sample.row) - disc.y_nm;
      if (ex * ex + ey * ey < disc.radius_nm * disc.radius_nm) continue;
    }
    if (out.count < kMaxNear) {
      out.samples[static_cast<std::size_t>(out.count++)] = sample;
      continue;
    }
    Sample& farthest =
        *std::max_element(out.samples.begin(), out.samples.end(),
                          [](const Sample& a, const Sample& b) { return a.distance_sq < b.distance_sq; });
    if (sample.distance_sq < farthest.distance_sq) farthest = sample;
  }
}

void SampleTops::near(const Vec3& point, double limit_nm, double known_nm, const Disc& disc,
                      Near& out) const noexcept {
  out.count = 0;
  const double limit_sq = limit_nm * limit_nm;
  const double known_sq = known_nm * known_nm;
  const double reach_sq = limit_sq - above_sq(point.z(), highest_);
  if (!(reach_sq > 0.0)) return;
  const double reach = std::sqrt(reach_sq);
  const IndexRange columns = within(point.x(), reach, x_first_, inv_dx_, columns_);
  const IndexRange rows = within(point.y(), reach, y_first_, inv_dy_, rows_);
  if (columns.last < columns.first || rows.last < rows.first) return;

  constexpr int kSuper = kBlock * kBlock;
  for (int super_row = rows.first / kSuper; super_row <= rows.last / kSuper; ++super_row) {
    const double super_y_sq =
        outside_sq(point.y(), y_nm(super_row * kSuper), y_nm(super_row * kSuper + kSuper - 1));
    for (int super_column = columns.first / kSuper; super_column <= columns.last / kSuper; ++super_column) {
      const double top =
          super_top_[product(super_row, super_columns_) + static_cast<std::size_t>(super_column)];
      const double super_x_sq =
          outside_sq(point.x(), x_nm(super_column * kSuper), x_nm(super_column * kSuper + kSuper - 1));
      if (super_x_sq + super_y_sq + above_sq(point.z(), top) >= limit_sq) continue;
      const int last_block_row = std::min(super_row * kBlock + kBlock - 1, rows.last / kBlock);
      const int last_block_column = std::min(super_column * kBlock + kBlock - 1, columns.last / kBlock);
      for (int br = std::max(super_row * kBlock, rows.first / kBlock); br <= last_block_row; ++br) {
        const double y_sq = outside_sq(point.y(), y_nm(br * kBlock), y_nm(br * kBlock + kBlock - 1));
        for (int bc = std::max(super_column * kBlock, columns.first / kBlock); bc <= last_block_column;
             ++bc) {
          const double block_top = block_top_[product(br, block_columns_) + static_cast<std::size_t>(bc)];
          const double x_sq = outside_sq(point.x(), x_nm(bc * kBlock), x_nm(bc * kBlock + kBlock - 1));
          if (x_sq + y_sq + above_sq(point.z(), block_top) >= limit_sq) continue;
          open(point, bc, br, limit_sq, known_sq, disc, out);
        }
      }
    }
  }
}

bool SampleTops::is_local_minimum(const Vec3& point, const Sample& sample) const noexcept {
  for (int row = std::max(sample.row - 1, 0); row <= std::min(sample.row + 1, rows_ - 1); ++row) {
    const double y = y_nm(row) - point.y();
    for (int column = std::max(sample.column - 1, 0); column <= std::min(sample.column + 1, columns_ - 1);
         ++column) {
      const double x = x_nm(column) - point.x();
      const double h = point.z() - height_nm(column, row);
      if (x * x + y * y + h * h < sample.distance_sq) return false;
    }
  }
  return true;
}

}  // namespace telenano::physics
