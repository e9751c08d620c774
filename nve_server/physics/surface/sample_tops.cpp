#include "telenano/nve_server/physics/surface/sample_tops.h"

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
  int first, last;
};

// Groups that samples with |x − (x_first + i·dx)| <= reach can be in, x within the grid.
IndexRange groups_within(double x, double reach, double x_first, double inv_dx, int count, int group) {
  const double centre = (x - x_first) * inv_dx;
  const double half = reach * inv_dx;
  return {static_cast<int>(std::max(centre - half, 0.0)) / group,
          static_cast<int>(std::min(centre + half, static_cast<double>(count - 1))) / group};
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
      across_(0.0, grid.dx_nm, 2.0 * grid.dx_nm, 3.0 * grid.dx_nm),
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

// A top is looked for only where the sample was it and falls.
void SampleTops::set(int column, int row, double z_nm) noexcept {
  double& sample = z_[index(column, row)];
  const double before = sample;
  sample = z_nm;
  lowest_ = std::min(lowest_, z_nm);
  highest_ = std::max(highest_, z_nm);
  const std::size_t block = block_of(column, row);
  double& block_top = block_top_[block];
  const double block_before = block_top;
  if (z_nm >= block_before) {
    block_top = z_nm;
  } else if (before >= block_before) {
    const double* z = &z_[block * kGroup];
    block_top = *std::max_element(z, z + kGroup);
  } else {
    return;
  }
  const std::size_t super = super_of(column, row);
  double& super_top = super_top_[super];
  if (block_top >= super_top) {
    super_top = block_top;
  } else if (block_before >= super_top) {
    const double* top = &block_top_[super * kGroup];
    super_top = *std::max_element(top, top + kGroup);
  }
}

void SampleTops::open_block(const Query& query, int first_column, int first_row, Near& out) const noexcept {
  const double* z = &z_[block_of(first_column, first_row) * kGroup];
  Eigen::Array4d x = across_ + x_nm(first_column);
  if (query.beyond_x) {
    const int rim = query.point.x() < x_first_ ? 0 : columns_ - 1;
    if (rim >= first_column && rim < first_column + kBlock) x[rim - first_column] = query.point.x();
  }
  const Eigen::Array4d x_sq = (x - query.point.x()).square();
  for (int r = 0; r < kBlock; ++r) {
    const int row = first_row + r;
    const bool across_rim = query.beyond_y && row == (query.point.y() < y_first_ ? 0 : rows_ - 1);
    const double y = across_rim ? query.point.y() : y_nm(row);
    const double y_sq = (y - query.point.y()) * (y - query.point.y());
    const Eigen::Array4d h = query.point.z() - Eigen::Map<const Eigen::Array4d>(z + r * kBlock);
    const Eigen::Array4d sq = x_sq + h.square() + y_sq;
    if (!(sq.minCoeff() < query.limit_sq)) continue;
    const double ey = y - query.disc.y_nm;
    for (int c = 0; c < kBlock; ++c) {
      if (!(sq[c] < query.limit_sq)) continue;
      const double ex = x[c] - query.disc.x_nm;
      if (sq[c] >= query.known_sq && ex * ex + ey * ey < query.disc.radius_sq) continue;
      out.add({x[c], y, sq[c]});
    }
  }
}

void SampleTops::Near::add(const Sample& sample) noexcept {
  if (count < kMaxNear) {
    samples[static_cast<std::size_t>(count++)] = sample;
    return;
  }
  Sample& farthest = *std::max_element(samples.begin(), samples.end(), [](const Sample& a, const Sample& b) {
    return a.distance_sq < b.distance_sq;
  });
  if (sample.distance_sq < farthest.distance_sq) farthest = sample;
}

// Sixteen bounds as in open_block: the distance to each block's rectangle below its top.
void SampleTops::open_super(const Query& query, int first_column, int first_row, Near& out) const noexcept {
  const double* top = &block_top_[super_of(first_column, first_row) * kGroup];
  const double half_x = 0.5 * (kBlock - 1) * dx_, half_y = 0.5 * (kBlock - 1) * dy_;
  const auto positive_squares = [](const Eigen::Array4d& d) -> Eigen::Array4d {
    return (0.5 * (d + d.abs())).square();
  };
  const Eigen::Array4d x_sq =
      positive_squares((kBlock * across_ + (x_nm(first_column) + half_x - query.within.x())).abs() - half_x);
  const double y_first = y_nm(first_row) + half_y - query.within.y();
  for (int r = 0; r < kBlock; ++r) {
    const double y_sq = positive_sq(std::abs(y_first + r * kBlock * dy_) - half_y);
    // Nothing is below −infinity: an empty block is infinitely far.
    const Eigen::Array4d sq =
        x_sq + y_sq + positive_squares(query.point.z() - Eigen::Map<const Eigen::Array4d>(top + r * kBlock));
    if (!(sq.minCoeff() < query.limit_sq)) continue;
    for (int c = 0; c < kBlock; ++c) {
      if (sq[c] < query.limit_sq) open_block(query, first_column + c * kBlock, first_row + r * kBlock, out);
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
  const Vec3 within(std::clamp(point.x(), x_first_, x_nm(columns_ - 1)),
                    std::clamp(point.y(), y_first_, y_nm(rows_ - 1)), point.z());
  const IndexRange columns = groups_within(within.x(), reach, x_first_, inv_dx_, columns_, kGroup);
  const IndexRange rows = groups_within(within.y(), reach, y_first_, inv_dy_, rows_, kGroup);

  const Query query{point,
                    within,
                    within.x() != point.x(),
                    within.y() != point.y(),
                    limit_sq,
                    known_nm * known_nm,
                    {disc.x_nm, disc.y_nm, disc.radius_nm * disc.radius_nm}};
  for (int row = rows.first; row <= rows.last; ++row) {
    const double y_sq = outside_sq(within.y(), y_nm(row * kGroup), kGroup, dy_);
    for (int column = columns.first; column <= columns.last; ++column) {
      const double x_sq = outside_sq(within.x(), x_nm(column * kGroup), kGroup, dx_);
      const double top = super_top_[product(row, super_columns_) + static_cast<std::size_t>(column)];
      if (x_sq + y_sq + positive_sq(point.z() - top) >= limit_sq) continue;
      open_super(query, column * kGroup, row * kGroup, out);
    }
  }
}

}  // namespace telenano::physics
