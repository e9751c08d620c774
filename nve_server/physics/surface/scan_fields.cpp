#include "telenano/nve_server/physics/surface/scan_fields.h"

#include <emmintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/surface/field_stencil.h"

namespace telenano::physics {
namespace {

// cubic_weights.h's of both axes at once.
inline void weights(double u_x, double u_y, double inv_x, double inv_y, CubicWeights& wx,
                    CubicWeights& wy) noexcept {
  const auto both = [](double a) { return _mm_set1_pd(a); };
  const __m128d u = _mm_set_pd(u_y, u_x), inv = _mm_set_pd(inv_y, inv_x);
  const __m128d v = _mm_sub_pd(both(1.0), u), sixth = both(1.0 / 6.0);
  const __m128d u2 = _mm_mul_pd(u, u), inv2 = _mm_mul_pd(inv, inv);
  const __m128d three_u = _mm_mul_pd(both(3.0), u);
  const auto put = [](__m128d w, double& x, double& y) {
    _mm_storel_pd(&x, w);
    _mm_storeh_pd(&y, w);
  };
  // v³/6, ((3u − 6) u² + 4)/6, (((3 − 3u) u + 3) u + 1)/6, u³/6
  const __m128d second = _mm_add_pd(_mm_mul_pd(_mm_sub_pd(three_u, both(6.0)), u2), both(4.0));
  const __m128d third = _mm_add_pd(
      _mm_mul_pd(_mm_add_pd(_mm_mul_pd(_mm_sub_pd(both(3.0), three_u), u), both(3.0)), u), both(1.0));
  put(_mm_mul_pd(sixth, _mm_mul_pd(_mm_mul_pd(v, v), v)), wx.value[0], wy.value[0]);
  put(_mm_mul_pd(sixth, second), wx.value[1], wy.value[1]);
  put(_mm_mul_pd(sixth, third), wx.value[2], wy.value[2]);
  put(_mm_mul_pd(sixth, _mm_mul_pd(u2, u)), wx.value[3], wy.value[3]);
  const __m128d half = _mm_mul_pd(both(0.5), inv);
  const __m128d falling = _mm_mul_pd(half, _mm_mul_pd(v, v)), rising = _mm_mul_pd(half, u2);
  const __m128d steep = _mm_mul_pd(both(1.5), u);
  put(_mm_sub_pd(_mm_setzero_pd(), falling), wx.slope[0], wy.slope[0]);
  put(_mm_mul_pd(inv, _mm_mul_pd(_mm_sub_pd(steep, both(2.0)), u)), wx.slope[1], wy.slope[1]);
  put(_mm_mul_pd(inv, _mm_add_pd(_mm_mul_pd(_mm_sub_pd(both(1.0), steep), u), both(0.5))), wx.slope[2],
      wy.slope[2]);
  put(rising, wx.slope[3], wy.slope[3]);
  put(_mm_mul_pd(inv2, v), wx.bend[0], wy.bend[0]);
  put(_mm_mul_pd(inv2, _mm_sub_pd(three_u, both(2.0))), wx.bend[1], wy.bend[1]);
  put(_mm_mul_pd(inv2, _mm_sub_pd(both(1.0), three_u)), wx.bend[2], wy.bend[2]);
  put(_mm_mul_pd(inv2, u), wx.bend[3], wy.bend[3]);
}

}  // namespace

double ScanFields::mirrored(double offset, double extent, bool& backwards) noexcept {
  backwards = false;
  if (offset >= 0.0 && offset <= extent) return offset;
  double u = offset / extent;
  u -= 2.0 * std::floor(0.5 * u);
  if (u > 1.0) {
    u = 2.0 - u;
    backwards = true;
  }
  if (!(u >= 0.0)) u = 0.0;  // no number
  return u * extent;
}

struct ScanFields::Place {
  double x, y;  // from the first node, mirrored
  bool back_x, back_y;
};

ScanFields::Place ScanFields::place(double x_nm, double y_nm) const noexcept {
  Place at{};
  at.x = mirrored(x_nm - x_first_, width_, at.back_x);
  at.y = mirrored(y_nm - y_first_, length_, at.back_y);
  return at;
}

/// The cell of a grid that a place is in, and the weights of the 4 × 4 coefficients that reach it.
struct ScanFields::Cell {
  int columns = 0, rows = 0;  // of the grid's nodes
  int column = 0, row = 0;
  CubicWeights along_x, along_y;

  Cell(const Place& at, const Grid& grid) noexcept : columns(grid.columns), rows(grid.rows) {
    const double across = at.x * grid.inv_dx;
    const double along = at.y * grid.inv_dy;
    column = std::min(static_cast<int>(across), columns - 2);
    row = std::min(static_cast<int>(along), rows - 2);
    weights(across - column, along - row, grid.inv_dx, grid.inv_dy, along_x, along_y);
  }
  /// Grids may share their nodes, and so their cells.
  bool is_of(const Grid& grid) const noexcept { return columns == grid.columns && rows == grid.rows; }
  StencilLevel level(const Grid& grid, int first_lane, const double* corner) const noexcept {
    return {corner, grid.stride(), grid.lanes, first_lane, &along_x, &along_y};
  }
  StencilLevel level(const Grid& grid, int first_lane) const noexcept {
    return level(grid, first_lane, grid.corner(column, row));
  }
  void jet(const StencilKernel& kernel, const Grid& grid, const double* lane_of_corner,
           double (&jet)[6]) const noexcept {
    kernel.one(lane_of_corner, grid.stride(), grid.lanes, along_x, along_y, jet);
  }
};

std::size_t ScanFields::bytes() const noexcept {
  std::size_t bytes = 0;
  if (tiled()) return bytes_of_tiles();
  for (const Grid& grid : grids_) bytes += grid.size() * sizeof(double);
  for (const Layer& layer : layers_) bytes += layer.grid.size() * sizeof(double);
  return bytes;
}

std::uint64_t ScanFields::hash() const {
  std::uint64_t hash = 14695981039346656037ull;
  const std::vector<std::span<const double>> all = coefficients();
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    for (const double c : all[g]) {
      std::uint64_t bits = std::bit_cast<std::uint64_t>(c);
      for (int byte = 0; byte < 8; ++byte, bits >>= 8) hash = (hash ^ (bits & 0xff)) * 1099511628211ull;
    }
  }
  return hash;
}

double ScanFields::touch_height_nm(double x_nm, double y_nm) const noexcept {
  const Grid& grid = grids_[0];
  const Cell cell(place(x_nm, y_nm), grid);
  double jet[6];
  cell.jet(*kernel_, grid, grid.corner(cell.column, cell.row), jet);
  return jet[kValue];
}

void ScanFields::ground_at(const Vec3& apex_w_nm, double& cosine,
                           double& unmarked_log_radius) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const double v0 = apex_w_nm.z() - touch_height_nm(apex_w_nm.x(), apex_w_nm.y());
  const LevelBlend blend = blend_levels(softening_.level(v0).level, levels_);
  cosine = unmarked_log_radius = 0;
  for (int k = 0; k < 3; ++k) {
    if (blend.weight[k] == 0.0) continue;
    const int level = blend.first + k;
    const Grid& grid = grids_[static_cast<std::size_t>(level / 2)];
    const Cell cell(at, grid);
    const double* const now = grid.corner(cell.column, cell.row);
    const double* const made =
        grid.made.get() + static_cast<std::ptrdiff_t>(cell.row) * grid.stride() + cell.column * kLanes;
    const int lane = 3 * (level % 2);
    double jet[6];
    cell.jet(*kernel_, grid, now + lane + 2, jet);
    cosine += blend.weight[k] * jet[kValue];
    cell.jet(*kernel_, grid, made + lane + 1, jet);
    unmarked_log_radius += blend.weight[k] * jet[kValue];
  }
}

namespace {

// δ = v c, v = H − z, and ρ.
void contact_of(const FieldRows& rows, double z, bool back_x, bool back_y, ContactJet& jet) noexcept {
  enum { kH, kRho, kC };
  const double v = rows[kAt][kH] - z;
  const double v_g[3] = {rows[kGx][kH], rows[kGy][kH], rows[kGz][kH] - 1.0};
  const double c_g[3] = {rows[kGx][kC], rows[kGy][kC], rows[kGz][kC]};
  const double c = rows[kAt][kC];
  jet.overlap_nm = v * c;
  jet.log_radius = rows[kAt][kRho];
  for (int i = 0; i < 3; ++i) {
    jet.overlap_grad[i] = c * v_g[i] + v * c_g[i];
    jet.log_radius_grad_per_nm[i] = rows[kGx + i][kRho];
  }
  const auto put = [&](int row, int i, int j) {
    const double h = c * rows[row][kH] + v * rows[row][kC] + (v_g[i] * c_g[j] + v_g[j] * c_g[i]);
    const double r = rows[row][kRho];
    jet.overlap_hess_per_nm(i, j) = h;
    jet.log_radius_hess_per_nm2(i, j) = r;
    if (i == j) return;
    jet.overlap_hess_per_nm(j, i) = h;
    jet.log_radius_hess_per_nm2(j, i) = r;
  };
  put(kHxx, 0, 0), put(kHxy, 0, 1), put(kHxz, 0, 2);
  put(kHyy, 1, 1), put(kHyz, 1, 2), put(kHzz, 2, 2);
  if (!(back_x || back_y)) return;
  const Vec3 way(back_x ? -1.0 : 1.0, back_y ? -1.0 : 1.0, 1.0);
  const Mat3 both = way * way.transpose();
  jet.overlap_grad = jet.overlap_grad.cwiseProduct(way);
  jet.overlap_hess_per_nm = jet.overlap_hess_per_nm.cwiseProduct(both);
  jet.log_radius_grad_per_nm = jet.log_radius_grad_per_nm.cwiseProduct(way);
  jet.log_radius_hess_per_nm2 = jet.log_radius_hess_per_nm2.cwiseProduct(both);
}

}  // namespace

void ScanFields::contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const double z = apex_w_nm.z();
  const Grid& grid = grids_[0];
  const Cell cell(at, grid);
  double finest[6];
  cell.jet(*kernel_, grid, grid.corner(cell.column, cell.row), finest);
  const SofteningLevel level = softening_.level(z - finest[kValue]);
  if (level.level <= 0.0) {
    FieldRows rows;
    kernel_->plain(cell.level(grid, 0), rows);
    contact_of(rows, z, at.back_x, at.back_y, jet);
    return;
  }
  blended(at, cell, finest, z, level, jet);
}

void ScanFields::growing_at(const Vec3& apex_w_nm, const SofteningRule& rule,
                            ContactJet& jet) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const double z = apex_w_nm.z();
  const Grid& grid = grids_[0];
  const Cell cell(at, grid);
  double finest[6];
  cell.jet(*kernel_, grid, grid.corner(cell.column, cell.row), finest);
  SofteningLevel level = softening_level(rule, z - finest[kValue]);
  level.level += level_of_softening(rule_, rule.finest_nm);
  blended(at, cell, finest, z, level, jet);
}

const ScanFields::Layer* ScanFields::layer_of(double softening_nm) const noexcept {
  for (const Layer& layer : layers_) {
    if (layer.softening_nm == softening_nm) return &layer;
  }
  return nullptr;
}

void ScanFields::at_softening(const Vec3& apex_w_nm, double softening_nm, ContactJet& jet) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  if (const Layer* layer = layer_of(softening_nm)) {
    FieldRows rows;
    kernel_->plain(Cell(at, layer->grid).level(layer->grid, 0), rows);
    contact_of(rows, apex_w_nm.z(), at.back_x, at.back_y, jet);
    return;
  }
  SofteningLevel fixed;
  fixed.level = level_of_softening(rule_, softening_nm);
  const double none[6] = {};
  blended(at, Cell(at, grids_[0]), none, apex_w_nm.z(), fixed, jet);
}

void ScanFields::values_at_softening(const Vec3& apex_w_nm, double softening_nm, double& overlap_nm,
                                     double& log_radius) const noexcept {
  const Layer* layer = layer_of(softening_nm);
  if (!layer) {
    ContactFields::values_at_softening(apex_w_nm, softening_nm, overlap_nm, log_radius);
    return;
  }
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const Grid& grid = layer->grid;
  const Cell cell(at, grid);
  const std::ptrdiff_t stride = (grid.columns + 2) * kLayerLanes;
  const double* corner = grid.corner(cell.column, cell.row);
  double height = 0, radius = 0, cosine = 0;
  for (int j = 0; j < 4; ++j) {
    double line[3] = {0, 0, 0};
    for (int i = 0; i < 4; ++i) {
      for (int k = 0; k < 3; ++k) line[k] += cell.along_x.value[i] * corner[j * stride + i * kLayerLanes + k];
    }
    height += cell.along_y.value[j] * line[0];
    radius += cell.along_y.value[j] * line[1];
    cosine += cell.along_y.value[j] * line[2];
  }
  overlap_nm = (height - apex_w_nm.z()) * cosine;
  log_radius = radius;
}

void ScanFields::blended(const Place& at, const Cell& finest_cell, const double (&finest)[6], double z_nm,
                         const SofteningLevel& level, ContactJet& jet) const noexcept {
  const LevelBlend blend = blend_levels(level.level, levels_);
  StencilLevel levels[3];
  std::optional<Cell> coarser[2];
  const Cell* cell = &finest_cell;
  const Grid* grid = nullptr;
  const double* corner = nullptr;
  int count = 0, cells = 0;
  for (int k = 0; k < 3; ++k) {
    if (blend.weight[k] == 0.0 && blend.slope[k] == 0.0) continue;
    const Grid& here = grids_[static_cast<std::size_t>((blend.first + k) / 2)];
    if (&here != grid) {
      grid = &here;
      if (!cell->is_of(here)) cell = &coarser[cells++].emplace(at, here);
      corner = here.corner(cell->column, cell->row);
    }
    StencilLevel& one = levels[count++];
    one = cell->level(here, (blend.first + k) % 2 == 0 ? 0 : 3, corner);
    one.weight = blend.weight[k];
    one.slope_per_nm = blend.slope[k] * level.slope_per_nm;
    one.bend_per_nm2 =
        blend.bend[k] * level.slope_per_nm * level.slope_per_nm + blend.slope[k] * level.bend_per_nm2;
  }
  FieldRows rows;
  kernel_->blend(levels, count, finest, rows);
  contact_of(rows, z_nm, at.back_x, at.back_y, jet);
}

double ScanFields::largest_log_radius() const noexcept {
  if (tiled()) return det_log(kMostRadii * radius_);
  double most = -HUGE_VAL;
  const auto look = [&](const Grid& grid) {
    const double* const all = grid.made.get();
    for (std::size_t i = 0; i < grid.size(); i += static_cast<std::size_t>(grid.lanes)) {
      most = std::max(most, all[i + 1]);
      if (grid.lanes == kLanes) most = std::max(most, all[i + 4]);
    }
  };
  for (const Grid& grid : grids_) look(grid);
  for (const Layer& layer : layers_) look(layer.grid);
  return most;
}

}  // namespace telenano::physics
