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

constexpr double kNothing = -std::numeric_limits<double>::infinity();

// max(d, 0)², without a branch.
double positive_sq(double d) {
  const double twice = d + std::abs(d);
  return 0.25 * twice * twice;
}

// From x to the interval of n samples from `first` on, squared.
double outside_sq(double x, double first, double n, double spacing) {
  const double half = 0.5 * (n - 1.0) * spacing;
  return positive_sq(std::abs(x - (first + half)) - half);
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
      super_columns_(blocks_of(grid.columns, kGroup)),
      super_rows_(blocks_of(grid.rows, kGroup)),
      z_(product(super_columns_, super_rows_) * kGroup * kGroup, kNothing),
      block_top_(product(super_columns_, super_rows_) * kGroup, kNothing),
      super_top_(product(super_columns_, super_rows_), kNothing) {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const double z = grid.z_nm[product(row, columns_) + static_cast<std::size_t>(column)];
      z_[index(column, row)] = z;
      double& block = block_top_[block_of(column, row)];
      double& super = super_top_[super_of(column, row)];
      block = std::max(block, z);
      super = std::max(super, z);
    }
  }
}

void SampleTops::set(int column, int row, double z_nm) noexcept {
  z_[index(column, row)] = z_nm;
  lowest_ = std::min(lowest_, z_nm);
  highest_ = std::max(highest_, z_nm);
  const std::size_t block = block_of(column, row);
  const double* z = &z_[block * kGroup];
  block_top_[block] = *std::max_element(z, z + kGroup);
  const std::size_t super = super_of(column, row);
  const double* top = &block_top_[super * kGroup];
  super_top_[super] = *std::max_element(top, top + kGroup);
}

void SampleTops::open_block(const Query& query, int first_column, int first_row, Near& out) const noexcept {
  const double* z = &z_[block_of(first_column, first_row) * kGroup];
  double sq[kGroup], x_sq[kBlock];
  for (int c = 0; c < kBlock; ++c) {
    const double x = x_nm(first_column + c) - query.point.x();
    x_sq[c] = x * x;
  }
  for (int r = 0; r < kBlock; ++r) {
    const double y = y_nm(first_row + r) - query.point.y();
    const double y_sq = y * y;
    for (int c = 0; c < kBlock; ++c) {
      const double h = query.point.z() - z[r * kBlock + c];
      sq[r * kBlock + c] = x_sq[c] + y_sq + h * h;
    }
  }
  for (int i = 0; i < kGroup; ++i) {
    if (!(sq[i] < query.limit_sq)) continue;
    const Sample sample{first_column + i % kBlock, first_row + i / kBlock, sq[i]};
    if (sq[i] >= query.known_sq) {
      const double ex = x_nm(sample.column) - query.disc.x_nm;
      const double ey = y_nm(sample.row) - query.disc.y_nm;
      if (ex * ex + ey * ey < query.disc.radius_nm * query.disc.radius_nm) continue;
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

void SampleTops::open_super(const Query& query, int first_column, int first_row, Near& out) const noexcept {
  const double* top = &block_top_[super_of(first_column, first_row) * kGroup];
  double sq[kGroup], x_sq[kBlock];
  for (int c = 0; c < kBlock; ++c) {
    x_sq[c] = outside_sq(query.point.x(), x_nm(first_column + c * kBlock), kBlock, dx_);
  }
  for (int r = 0; r < kBlock; ++r) {
    const double y_sq = outside_sq(query.point.y(), y_nm(first_row + r * kBlock), kBlock, dy_);
    for (int c = 0; c < kBlock; ++c) {
      // Nothing is below −infinity: an empty block is infinitely far.
      sq[r * kBlock + c] = x_sq[c] + y_sq + positive_sq(query.point.z() - top[r * kBlock + c]);
    }
  }
  for (int i = 0; i < kGroup; ++i) {
    if (sq[i] < query.limit_sq) {
      open_block(query, first_column + i % kBlock * kBlock, first_row + i / kBlock * kBlock, out);
    }
  }
}

void SampleTops::near(const Vec3& point, double limit_nm, double known_nm, const Disc& disc,
                      Near& out) const noexcept {
  out.count = 0;
  const double limit_sq = limit_nm * limit_nm;
  const double reach_sq = limit_sq - positive_sq(point.z() - highest_);
  if (!(reach_sq > 0.0)) return;
  const double reach = std::sqrt(reach_sq);
  const IndexRange columns = within(point.x(), reach, x_first_, inv_dx_, columns_);
  const IndexRange rows = within(point.y(), reach, y_first_, inv_dy_, rows_);
  if (columns.last < columns.first || rows.last < rows.first) return;

  const Query query{point, limit_sq, known_nm * known_nm, disc};
  for (int super_row = rows.first / kGroup; super_row <= rows.last / kGroup; ++super_row) {
    const double y_sq = outside_sq(point.y(), y_nm(super_row * kGroup), kGroup, dy_);
    for (int super_column = columns.first / kGroup; super_column <= columns.last / kGroup; ++super_column) {
      const double top =
          super_top_[product(super_row, super_columns_) + static_cast<std::size_t>(super_column)];
      const double x_sq = outside_sq(point.x(), x_nm(super_column * kGroup), kGroup, dx_);
      if (x_sq + y_sq + positive_sq(point.z() - top) >= limit_sq) continue;
      open_super(query, super_column * kGroup, super_row * kGroup, out);
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
