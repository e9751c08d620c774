#include "nve_server/physics/sample_tops.h"

#include <algorithm>
#include <cmath>

namespace telenano::physics {
namespace {

int blocks_of(int count, int block) { return (count + block - 1) / block; }

// Highest of each block×block group of `in`.
std::vector<double> tops(const std::vector<double>& in, int columns, int rows, int block) {
  const int block_columns = blocks_of(columns, block);
  std::vector<double> out(static_cast<std::size_t>(block_columns) * static_cast<std::size_t>(blocks_of(rows, block)));
  for (std::size_t b = 0; b < out.size(); ++b) {
    const int first_column = static_cast<int>(b) % block_columns * block;
    const int first_row = static_cast<int>(b) / block_columns * block;
    double top = in[static_cast<std::size_t>(first_row) * columns + first_column];
    for (int row = first_row; row < std::min(first_row + block, rows); ++row) {
      for (int column = first_column; column < std::min(first_column + block, columns); ++column) {
        top = std::max(top, in[static_cast<std::size_t>(row) * columns + column]);
      }
    }
    out[b] = top;
  }
  return out;
}

// Distance from x to the interval [lo, hi], squared.
double outside_sq(double x, double lo, double hi) {
  const double d = x < lo ? lo - x : (x > hi ? x - hi : 0.0);
  return d * d;
}

double above_sq(double z, double top) { return z > top ? (z - top) * (z - top) : 0.0; }

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
    : grid_(grid),
      inv_dx_(1.0 / grid.dx_nm),
      inv_dy_(1.0 / grid.dy_nm),
      lowest_(*std::min_element(grid.z_nm.begin(), grid.z_nm.end())),
      highest_(*std::max_element(grid.z_nm.begin(), grid.z_nm.end())),
      block_columns_(blocks_of(grid.columns, kBlock)),
      block_rows_(blocks_of(grid.rows, kBlock)),
      super_columns_(blocks_of(block_columns_, kBlock)),
      super_rows_(blocks_of(block_rows_, kBlock)),
      block_top_(tops(grid.z_nm, grid.columns, grid.rows, kBlock)),
      super_top_(tops(block_top_, block_columns_, block_rows_, kBlock)) {}

SampleTops::Sample SampleTops::nearest(const Vec3& point, double limit_nm, double known_nm, const Disc* discs,
                                       int disc_count) const noexcept {
  Sample best;
  double best_sq = limit_nm * limit_nm;
  const double known_sq = known_nm * known_nm;
  const double reach_sq = best_sq - above_sq(point.z(), highest_);
  if (!(reach_sq > 0.0)) return best;
  const double reach = std::sqrt(reach_sq);
  const IndexRange columns = within(point.x(), reach, grid_.x_first_nm, inv_dx_, grid_.columns);
  const IndexRange rows = within(point.y(), reach, grid_.y_first_nm, inv_dy_, grid_.rows);
  if (columns.last < columns.first || rows.last < rows.first) return best;

  const auto x_of = [&](int i) { return grid_.x_first_nm + i * grid_.dx_nm; };
  const auto y_of = [&](int i) { return grid_.y_first_nm + i * grid_.dy_nm; };
  const auto bound_sq = [&](int column, int row, int size, double top) {
    return outside_sq(point.x(), x_of(column), x_of(column + size - 1)) +
           outside_sq(point.y(), y_of(row), y_of(row + size - 1)) + above_sq(point.z(), top);
  };

  constexpr int kSuper = kBlock * kBlock;
  for (int super_row = rows.first / kSuper; super_row <= rows.last / kSuper; ++super_row) {
    for (int super_column = columns.first / kSuper; super_column <= columns.last / kSuper; ++super_column) {
      const double super_top = super_top_[static_cast<std::size_t>(super_row) * super_columns_ + super_column];
      if (bound_sq(super_column * kSuper, super_row * kSuper, kSuper, super_top) >= best_sq) continue;
      const int last_block_row = std::min(super_row * kBlock + kBlock - 1, rows.last / kBlock);
      const int last_block_column = std::min(super_column * kBlock + kBlock - 1, columns.last / kBlock);
      for (int br = std::max(super_row * kBlock, rows.first / kBlock); br <= last_block_row; ++br) {
        for (int bc = std::max(super_column * kBlock, columns.first / kBlock); bc <= last_block_column; ++bc) {
          const double top = block_top_[static_cast<std::size_t>(br) * block_columns_ + bc];
          if (bound_sq(bc * kBlock, br * kBlock, kBlock, top) >= best_sq) continue;
          const int row_end = std::min(br * kBlock + kBlock, grid_.rows);
          const int column_end = std::min(bc * kBlock + kBlock, grid_.columns);
          for (int row = br * kBlock; row < row_end; ++row) {
            const double y = y_of(row) - point.y();
            const double* z = &grid_.z_nm[static_cast<std::size_t>(row) * grid_.columns];
            for (int column = bc * kBlock; column < column_end; ++column) {
              const double x = x_of(column) - point.x();
              const double height = point.z() - z[column];
              const double sq = x * x + y * y + height * height;
              if (sq >= best_sq) continue;
              bool known = false;
              for (int i = 0; i < disc_count && sq >= known_sq; ++i) {
                const double ex = x_of(column) - discs[i].x_nm;
                const double ey = y_of(row) - discs[i].y_nm;
                known = known || ex * ex + ey * ey < discs[i].radius_nm * discs[i].radius_nm;
              }
              if (known) continue;
              best_sq = sq;
              best.found = true;
              best.x_nm = x_of(column);
              best.y_nm = y_of(row);
            }
          }
        }
      }
    }
  }
  best.distance_nm = std::sqrt(best_sq);
  return best;
}

}  // namespace telenano::physics
