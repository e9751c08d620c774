#include "nve_server/physics/scan_fields.h"

#include <emmintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "common/base/det_math.h"
#include "common/base/error.h"
#include "nve_server/physics/cubic_weights.h"

namespace telenano::physics {
namespace {

const HeightGrid& checked(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule) {
  if (grid.columns < 2 || grid.rows < 2 ||
      grid.z_nm.size() != static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows)) {
    throw UserError("surface: expected at least 2×2 samples, as many heights as columns × rows");
  }
  if (!(grid.dx_nm > 0.0 && grid.dy_nm > 0.0 && std::isfinite(grid.dx_nm) && std::isfinite(grid.dy_nm) &&
        std::isfinite(grid.x_first_nm) && std::isfinite(grid.y_first_nm)) ||
      !std::all_of(grid.z_nm.begin(), grid.z_nm.end(), [](double z) { return std::isfinite(z); })) {
    throw UserError("surface: expected finite heights and borders and positive spacing");
  }
  if (!(tip_radius_nm > 0.0 && std::isfinite(tip_radius_nm))) {
    throw UserError("surface: expected a positive tip radius");
  }
  if (!(rule.finest_nm > 0.0 && rule.coarsest_nm > rule.finest_nm && std::isfinite(rule.coarsest_nm) &&
        rule.pressed_growth >= 0.0 && rule.gap_growth >= 0.0 && rule.dead_zone_nm >= 0.0)) {
    throw UserError("surface: expected a softening that is positive and grows");
  }
  return grid;
}

const std::vector<double>& checked(const std::vector<double>& softenings_nm) {
  for (const double t : softenings_nm) {
    if (!(t > 0.0 && std::isfinite(t))) throw UserError("surface: expected softenings that are positive");
  }
  return softenings_nm;
}

/// Value, ∂x, ∂y, ∂xx, ∂xy, ∂yy of one field.
enum { kValue, kX, kY, kXx, kXy, kYy };

using Weights = CubicWeights;

// cubic_weights.h's of both axes at once.
inline void weights(double u_x, double u_y, double inv_x, double inv_y, Weights& wx, Weights& wy) noexcept {
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

/// Jets of `Pairs` pairs of lanes from `first` on: jets[lane][derivative].
template <int kPairs, int lanes>
inline void stencil(const double* corner, std::ptrdiff_t stride, const Weights& wx, const Weights& wy,
                    double (*jets)[6]) noexcept {
  for (int pair = 0; pair < kPairs; ++pair) {
    __m128d out[6];
    for (int i = 0; i < 4; ++i) {
      const double* c = corner + i * lanes + 2 * pair;
      const __m128d c0 = _mm_loadu_pd(c), c1 = _mm_loadu_pd(c + stride), c2 = _mm_loadu_pd(c + 2 * stride),
                    c3 = _mm_loadu_pd(c + 3 * stride);
      const auto along = [&](const double(&w)[4]) {
        return _mm_add_pd(_mm_add_pd(_mm_mul_pd(c0, _mm_set1_pd(w[0])), _mm_mul_pd(c1, _mm_set1_pd(w[1]))),
                          _mm_add_pd(_mm_mul_pd(c2, _mm_set1_pd(w[2])), _mm_mul_pd(c3, _mm_set1_pd(w[3]))));
      };
      const __m128d value = along(wy.value), slope = along(wy.slope), bend = along(wy.bend);
      const __m128d x0 = _mm_set1_pd(wx.value[i]), x1 = _mm_set1_pd(wx.slope[i]),
                    x2 = _mm_set1_pd(wx.bend[i]);
      if (i == 0) {
        out[kValue] = _mm_mul_pd(value, x0);
        out[kX] = _mm_mul_pd(value, x1);
        out[kY] = _mm_mul_pd(slope, x0);
        out[kXx] = _mm_mul_pd(value, x2);
        out[kXy] = _mm_mul_pd(slope, x1);
        out[kYy] = _mm_mul_pd(bend, x0);
      } else {
        out[kValue] = _mm_add_pd(out[kValue], _mm_mul_pd(value, x0));
        out[kX] = _mm_add_pd(out[kX], _mm_mul_pd(value, x1));
        out[kY] = _mm_add_pd(out[kY], _mm_mul_pd(slope, x0));
        out[kXx] = _mm_add_pd(out[kXx], _mm_mul_pd(value, x2));
        out[kXy] = _mm_add_pd(out[kXy], _mm_mul_pd(slope, x1));
        out[kYy] = _mm_add_pd(out[kYy], _mm_mul_pd(bend, x0));
      }
    }
    for (int d = 0; d < 6; ++d) {
      _mm_storel_pd(&jets[2 * pair][d], out[d]);
      _mm_storeh_pd(&jets[2 * pair + 1][d], out[d]);
    }
  }
}

/// One lane alone.
template <int lanes>
inline void stencil_of_one(const double* corner, std::ptrdiff_t stride, const Weights& wx, const Weights& wy,
                           double (&jet)[6]) noexcept {
  for (double& d : jet) d = 0;
  for (int i = 0; i < 4; ++i) {
    const double* c = corner + i * lanes;
    const auto along = [&](const double(&w)[4]) {
      return (c[0] * w[0] + c[stride] * w[1]) + (c[2 * stride] * w[2] + c[3 * stride] * w[3]);
    };
    const double value = along(wy.value), slope = along(wy.slope), bend = along(wy.bend);
    jet[kValue] += value * wx.value[i];
    jet[kX] += value * wx.slope[i];
    jet[kY] += slope * wx.value[i];
    jet[kXx] += value * wx.bend[i];
    jet[kXy] += slope * wx.slope[i];
    jet[kYy] += bend * wx.value[i];
  }
}

}  // namespace

double ScanFields::mirrored(double offset, double extent, bool& backwards) noexcept {
  double u = offset / extent;
  backwards = false;
  if (!(u >= 0.0 && u <= 1.0)) {
    u -= 2.0 * std::floor(0.5 * u);
    if (u > 1.0) {
      u = 2.0 - u;
      backwards = true;
    }
    if (!(u >= 0.0)) u = 0.0;  // no number
    return u * extent;
  }
  return offset;
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

namespace {

struct Cell {
  int column, row;
  Weights wx, wy;
};

inline Cell cell_of(double x, double y, int columns, int rows, double inv_dx, double inv_dy) noexcept {
  const double across = x * inv_dx;
  const double along = y * inv_dy;
  Cell cell;
  cell.column = std::min(static_cast<int>(across), columns - 2);
  cell.row = std::min(static_cast<int>(along), rows - 2);
  weights(across - cell.column, along - cell.row, inv_dx, inv_dy, cell.wx, cell.wy);
  return cell;
}

// Growing t must not turn the overlap back. Pressed, with level e and ξ = −v0,
//   −∂δ/∂z = c (1 + (H_e + v c_e/c) e'(ξ)),  e' = (α s'/(t ln 2)) √(1 − (t0/t)²) <= 1.125 α/(t ln 2).
// dH/dt = 1 − var φ/t², which is below −1 where much lies just under the top. H_e is between the differences
// H_{k+1} − H_k to either side, linear over e, t = t0 2^e; a chord between two points of −2^e is below it by
// 6 % at most. So differences of at least −0.53 t_k leave 1 − 0.45; and since v e' <= 1.5 or so, cosines that
// fall by at most e^−0.13 a level take 0.2 more.
constexpr double kMostFall = 0.53;
constexpr double kLeastCosineRatio = 0.878;  // e^−0.13

/// How far a field is below what it must be at least, and the rise that mends it.
double missing_height(double coarse, double fine, double fine_t) {
  return fine - kMostFall * fine_t - coarse;
}
double missing_cosine(double coarse, double fine) {
  return fine * kLeastCosineRatio - coarse;
}

}  // namespace

ScanFields::ScanFields(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule,
                       const std::vector<double>& fixed_softenings_nm,
                       const std::function<void(double)>& made)
    : rule_(rule), radius_(tip_radius_nm) {
  checked(grid, tip_radius_nm, rule);
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  const auto [lowest, highest] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  // The spline may overshoot its samples by a seventh of a step.
  const double relief = 1.3 * (*highest - *lowest);
  const DilationLattice top = lay_out(grid, height, checked(fixed_softenings_nm));
  const auto quasi = [](double before, double here, double after) {
    return (8.0 * here - before - after) / 6.0;
  };
  // A node costs about the same at every level.
  double all = 0, done = 0;
  for (const Grid& fields : grids_) all += 2.0 * fields.columns * fields.rows;
  for (const Layer& layer : layers_) all += static_cast<double>(layer.grid.columns) * layer.grid.rows;
  // H, ρ, c at softening t into three lanes from `lane` on.
  const auto fill = [&](Grid& fields, int lane, double t) {
    fields.made->resize(fields.size());
    DilationLattice lattice = top;
    lattice.columns = fields.columns;
    lattice.rows = fields.rows;
    lattice.node_dx_nm = width_ / (fields.columns - 1);
    lattice.node_dy_nm = length_ / (fields.rows - 1);
    lattice.m = sub_samples(lattice, 0.65 * std::sqrt(tip_radius_nm * t));
    const std::vector<DilatedNode> nodes = Dilation(height, lattice, tip_radius_nm, t, relief).make_all();
    const auto fold = [](int i, int count) { return i < 0 ? -i : (i < count ? i : 2 * count - 2 - i); };
    const auto node = [&](int i, int j) -> const DilatedNode& {
      return nodes[static_cast<std::size_t>(fold(j, fields.rows)) * static_cast<std::size_t>(fields.columns) +
                   static_cast<std::size_t>(fold(i, fields.columns))];
    };
    for (int j = -1; j <= fields.rows; ++j) {
      for (int i = -1; i <= fields.columns; ++i) {
        const int ci = fold(i, fields.columns), cj = fold(j, fields.rows);
        double line[3][3];
        double least = INFINITY, most = 0;
        for (int r = -1; r <= 1; ++r) {
          const DilatedNode& a = node(ci - 1, cj + r);
          const DilatedNode& b = node(ci, cj + r);
          const DilatedNode& c = node(ci + 1, cj + r);
          line[r + 1][0] = quasi(a.height_nm, b.height_nm, c.height_nm);
          line[r + 1][1] = quasi(a.log_radius, b.log_radius, c.log_radius);
          line[r + 1][2] = quasi(a.cosine, b.cosine, c.cosine);
          least = std::min({least, a.cosine, b.cosine, c.cosine});
          most = std::max({most, a.cosine, b.cosine, c.cosine});
        }
        double* at = fields.made->data() + static_cast<std::ptrdiff_t>(j + 1) * fields.stride() +
                     (i + 1) * fields.lanes + lane;
        for (int k = 0; k < 3; ++k) at[k] = quasi(line[0][k], line[1][k], line[2][k]);
        at[2] = std::clamp(at[2], least, most);
      }
    }
    done += static_cast<double>(fields.columns) * fields.rows;
    if (made) made(done / all);
  };
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    Grid& fields = grids_[g];
    for (int half = 0; half < 2; ++half) {
      const double t = rule.finest_nm * (1 << std::min(2 * static_cast<int>(g) + half, levels_ - 1));
      fill(fields, 3 * half, t);
      if (half == 0 && g > 0) hold_growth(grids_[g - 1], fields, 0.5 * t);
    }
    hold_growth(fields, rule.finest_nm * (1 << (2 * g)));
  }
  for (Layer& layer : layers_) fill(layer.grid, 0, layer.softening_nm);
}

DilationLattice ScanFields::lay_out(const HeightGrid& grid, const BicubicSpline& height,
                                    const std::vector<double>& fixed_softenings_nm) {
  x_first_ = grid.x_first_nm;
  y_first_ = grid.y_first_nm;
  width_ = (grid.columns - 1) * grid.dx_nm;
  length_ = (grid.rows - 1) * grid.dy_nm;
  levels_ = level_count(rule_);
  const int grids = (levels_ + 1) / 2;
  // The finest grid has half a pixel, but need not be finer than a foot of radius R at t0, unless the area is
  // small: over a groove, where two feet meet, the fields have creases t0 over the difference of their slopes
  // wide, which a finer grid rounds off less. The others are twice as wide each from the third on, so that
  // their nodes are nodes of the finer ones.
  constexpr double kSmallNodes = 131072;
  const double half_pixel = 0.5 * std::min(grid.dx_nm, grid.dy_nm);
  const double foot = std::sqrt(radius_ * rule_.finest_nm) / 1.2;
  const double finest = std::clamp(std::sqrt(width_ * length_ / kSmallNodes),
                                   std::max(half_pixel, 0.25 * foot), std::max(half_pixel, foot));
  const int doublings = std::max(0, grids - 2);
  const DilationLattice top = dilation_lattice(height, finest * (1 << doublings), INFINITY);
  const auto grid_at = [&](int g, int lanes) {
    Grid fields;
    const int split = 1 << (doublings - std::max(0, g - 1));
    fields.lanes = lanes;
    fields.columns = (top.columns - 1) * split + 1;
    fields.rows = (top.rows - 1) * split + 1;
    fields.inv_dx = (fields.columns - 1) / width_;
    fields.inv_dy = (fields.rows - 1) / length_;
    return fields;
  };
  for (int g = 0; g < grids; ++g) grids_.push_back(grid_at(g, kLanes));
  for (const double t : fixed_softenings_nm) {
    const int g = std::min(grids - 1, static_cast<int>(level_of_softening(rule_, t)) / 2);
    layers_.push_back({t, grid_at(g, kLayerLanes)});
  }
  return top;
}

std::vector<std::span<const double>> ScanFields::coefficients() const {
  std::vector<std::span<const double>> all;
  for (const Grid& grid : grids_) all.emplace_back(*grid.made);
  for (const Layer& layer : layers_) all.emplace_back(*layer.grid.made);
  return all;
}

std::optional<ScanFields> ScanFields::restored(const HeightGrid& grid, double tip_radius_nm,
                                               const SofteningRule& rule,
                                               const std::vector<double>& fixed_softenings_nm,
                                               std::vector<std::vector<double>> coefficients) {
  checked(grid, tip_radius_nm, rule);
  ScanFields fields;
  fields.rule_ = rule;
  fields.radius_ = tip_radius_nm;
  fields.lay_out(grid, BicubicSpline::interpolating(grid), checked(fixed_softenings_nm));
  if (coefficients.size() != fields.grids_.size() + fields.layers_.size()) return {};
  const auto [lowest, highest] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  // A spline's coefficients are within some times its values; the dilated ground is higher than the scan by
  // less than R(1/kConeCosine − 1), at most.
  const double room = 3.0 * (*highest - *lowest) + 10.0 * tip_radius_nm;
  constexpr double kMostLogRatio = 30.0;
  const double log_radius = det_log(tip_radius_nm);
  for (std::size_t g = 0; g < coefficients.size(); ++g) {
    const std::size_t grids = fields.grids_.size();
    Grid& one = g < grids ? fields.grids_[g] : fields.layers_[g - grids].grid;
    const std::vector<double>& c = coefficients[g];
    if (c.size() != one.size()) return {};
    bool good = true;
    const std::size_t step = one.lanes == kLanes ? 3 : kLayerLanes;
    for (std::size_t k = 0; k < c.size(); k += step) {
      good = good && c[k] > *lowest - room && c[k] < *highest + room &&
             std::abs(c[k + 1] - log_radius) < kMostLogRatio && c[k + 2] > 0.01 && c[k + 2] < 1.01;
    }
    if (!good) return {};
    *one.made = std::move(coefficients[g]);
  }
  return fields;
}

// Of two levels on one grid: where each coefficient is high enough the fields are everywhere.
void ScanFields::hold_growth(Grid& grid, double fine_t) {
  for (std::size_t k = 0; k < grid.made->size(); k += kLanes) {
    double* c = &(*grid.made)[k];
    c[3] += std::max(0.0, missing_height(c[3], c[0], fine_t));
    c[5] += std::max(0.0, missing_cosine(c[5], c[2]));
  }
}

// Of the even level of a grid over the odd one of the finer grid before: looked at on the finer one's nodes,
// and where it is too low the coefficients that weigh most there are raised. At a node common to both the 3 ×
// 3 around it have the whole weight, half way between nodes the nearest two of a line 23/24 of it.
void ScanFields::hold_growth(const Grid& finer, Grid& coarse, double fine_t) {
  const std::ptrdiff_t fine_stride = (finer.columns + 2) * kLanes;
  const int columns = coarse.columns + 2, rows = coarse.rows + 2;
  const std::ptrdiff_t stride = columns * kLanes;
  std::vector<double> rise(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows) * 2);
  struct Line {
    double weight[3];
    int count;
    double share;  // of the whole weight; the outermost two of a half-way place are left out
  };
  constexpr Line kNode{{1.0 / 6, 4.0 / 6, 1.0 / 6}, 3, 1.0};
  constexpr Line kHalfWay{{23.0 / 48, 23.0 / 48, 0.0}, 2, 23.0 / 24};
  if (finer.columns == coarse.columns) {
    for (std::size_t k = 0; k < coarse.made->size(); k += kLanes) {
      double* c = &(*coarse.made)[k];
      c[0] += std::max(0.0, missing_height(c[0], (*finer.made)[k + 3], fine_t));
      c[2] += std::max(0.0, missing_cosine(c[2], (*finer.made)[k + 5]));
    }
    return;
  }
  for (int j = 0; j < finer.rows; ++j) {
    for (int i = 0; i < finer.columns; ++i) {
      const double* fine = &(*finer.made)[static_cast<std::size_t>((j + 1) * fine_stride + (i + 1) * kLanes)];
      const auto fine_value = [&](int lane) {
        const auto line = [&](const double* c) {
          return c[lane - kLanes] + 4.0 * c[lane] + c[lane + kLanes];
        };
        return (line(fine - fine_stride) + 4.0 * line(fine) + line(fine + fine_stride)) / 36.0;
      };
      // The coarse spline there, all four coefficients a line.
      const auto weights_of = [](int k, int& first, double(&w)[4]) {
        first = k / 2;  // of the padded coefficients: node k/2 is at first + 1
        if (k % 2 == 0) {
          w[0] = w[2] = 1.0 / 6, w[1] = 4.0 / 6, w[3] = 0.0;
        } else {
          w[0] = w[3] = 1.0 / 48, w[1] = w[2] = 23.0 / 48;
        }
      };
      int ci, cj;
      double wi[4], wj[4];
      weights_of(i, ci, wi);
      weights_of(j, cj, wj);
      double height = 0, cosine = 0;
      for (int r = 0; r < 4; ++r) {
        for (int k = 0; k < 4; ++k) {
          if (wj[r] * wi[k] == 0.0) continue;
          const double* c = &(*coarse.made)[static_cast<std::size_t>((cj + r) * stride + (ci + k) * kLanes)];
          height += wj[r] * wi[k] * c[0];
          cosine += wj[r] * wi[k] * c[2];
        }
      }
      const double by_height = missing_height(height, fine_value(3), fine_t);
      const double by_cosine = missing_cosine(cosine, fine_value(5));
      if (!(by_height > 0.0 || by_cosine > 0.0)) continue;
      const Line& across = i % 2 == 0 ? kNode : kHalfWay;
      const Line& along = j % 2 == 0 ? kNode : kHalfWay;
      const double share = across.share * along.share;
      const int from_i = ci + (i % 2), from_j = cj + (j % 2);
      for (int r = 0; r < along.count; ++r) {
        for (int k = 0; k < across.count; ++k) {
          double* up = &rise[static_cast<std::size_t>((from_j + r) * columns + from_i + k) * 2];
          up[0] = std::max(up[0], by_height / share);
          up[1] = std::max(up[1], by_cosine / share);
        }
      }
    }
  }
  // Mirrored ends stay mirrored: a coefficient rises with its image.
  const auto image = [](int i, int count) { return i == 0 ? 2 : (i == count - 1 ? count - 3 : i); };
  const auto from = [&](int i, int j) { return &rise[static_cast<std::size_t>(j * columns + i) * 2]; };
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      // image() of the inner one beside the rim: the two share the greater rise.
      const int mi = i == 2 ? 0 : (i == columns - 3 ? columns - 1 : image(i, columns));
      const int mj = j == 2 ? 0 : (j == rows - 3 ? rows - 1 : image(j, rows));
      double* c = &(*coarse.made)[static_cast<std::size_t>(j * stride + i * kLanes)];
      const double* all[4] = {from(i, j), from(mi, j), from(i, mj), from(mi, mj)};
      double height = 0, cosine = 0;
      for (const double* one : all) {
        height = std::max(height, one[0]);
        cosine = std::max(cosine, one[1]);
      }
      c[0] += height;
      c[2] = std::min(1.0, c[2] + cosine);
    }
  }
}

std::size_t ScanFields::bytes() const noexcept {
  std::size_t bytes = 0;
  for (const Grid& grid : grids_) bytes += grid.made->size() * sizeof(double);
  for (const Layer& layer : layers_) bytes += layer.grid.made->size() * sizeof(double);
  return bytes;
}

std::uint64_t ScanFields::hash() const noexcept {
  std::uint64_t hash = 14695981039346656037ull;
  for (const Grid& grid : grids_) {
    for (const double c : *grid.made) {
      std::uint64_t bits = std::bit_cast<std::uint64_t>(c);
      for (int byte = 0; byte < 8; ++byte, bits >>= 8) hash = (hash ^ (bits & 0xff)) * 1099511628211ull;
    }
  }
  return hash;
}

double ScanFields::touch_height_nm(double x_nm, double y_nm) const noexcept {
  const Place at = place(x_nm, y_nm);
  const Grid& grid = grids_[0];
  const Cell cell = cell_of(at.x, at.y, grid.columns, grid.rows, grid.inv_dx, grid.inv_dy);
  const std::ptrdiff_t stride = (grid.columns + 2) * kLanes;
  double jet[6];
  stencil_of_one<kLanes>(grid.corner(cell.column, cell.row), stride, cell.wx, cell.wy, jet);
  return jet[kValue];
}

void ScanFields::ground_at(const Vec3& apex_w_nm, double& cosine,
                           double& unmarked_log_radius) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const double v0 = apex_w_nm.z() - touch_height_nm(apex_w_nm.x(), apex_w_nm.y());
  const LevelBlend blend = blend_levels(softening_level(rule_, v0).level, levels_);
  cosine = unmarked_log_radius = 0;
  for (int k = 0; k < 3; ++k) {
    if (blend.weight[k] == 0.0) continue;
    const int level = blend.first + k;
    const Grid& grid = grids_[static_cast<std::size_t>(level / 2)];
    const Cell cell = cell_of(at.x, at.y, grid.columns, grid.rows, grid.inv_dx, grid.inv_dy);
    const std::ptrdiff_t stride = grid.stride();
    const double* const now = grid.corner(cell.column, cell.row);
    const double* const made = grid.made->data() + cell.row * stride + cell.column * kLanes;
    const int lane = 3 * (level % 2);
    double jet[6];
    stencil_of_one<kLanes>(now + lane + 2, stride, cell.wx, cell.wy, jet);
    cosine += blend.weight[k] * jet[kValue];
    stencil_of_one<kLanes>(made + lane + 1, stride, cell.wx, cell.wy, jet);
    unmarked_log_radius += blend.weight[k] * jet[kValue];
  }
}

namespace {

/// A field of (x, y, u) with u = v0: all derivatives that its Hessian in the apex needs.
struct Blended {
  double value = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  double u = 0, ux = 0, uy = 0, uu = 0;

  void add(const double (&jet)[6], double w, double w1, double w2) noexcept {
    value += w * jet[kValue];
    x += w * jet[kX];
    y += w * jet[kY];
    xx += w * jet[kXx];
    xy += w * jet[kXy];
    yy += w * jet[kYy];
    u += w1 * jet[kValue];
    ux += w1 * jet[kX];
    uy += w1 * jet[kY];
    uu += w2 * jet[kValue];
  }
};

/// Gradient and Hessian (xx, xy, xz, yy, yz, zz) in the apex.
struct Space {
  double value;
  double g[3];
  double h[6];
};

// F(x, y, u(x, y, z)), u = z − H_0: ∇u = (−H_x, −H_y, 1), ∇∇u = −∇∇H_0.
Space in_space(const Blended& f, const double (&h0)[6]) noexcept {
  const double a = -h0[kX], b = -h0[kY];
  return {f.value,
          {f.x + f.u * a, f.y + f.u * b, f.u},
          {f.xx + 2.0 * f.ux * a + f.uu * a * a - f.u * h0[kXx],
           f.xy + f.ux * b + f.uy * a + f.uu * a * b - f.u * h0[kXy], f.ux + f.uu * a,
           f.yy + 2.0 * f.uy * b + f.uu * b * b - f.u * h0[kYy], f.uy + f.uu * b, f.uu}};
}

Space level_in_space(const double (&jet)[6]) noexcept {
  return {jet[kValue], {jet[kX], jet[kY], 0.0}, {jet[kXx], jet[kXy], 0.0, jet[kYy], 0.0, 0.0}};
}

// δ = v c, v = H − z.
void contact_of(const Space& height, const Space& radius, const Space& cosine, double z, bool back_x,
                bool back_y, ContactJet& jet) noexcept {
  const double v = height.value - z;
  const double v_g[3] = {height.g[0], height.g[1], height.g[2] - 1.0};
  const double c = cosine.value;
  double g[3], h[6];
  for (int i = 0; i < 3; ++i) g[i] = c * v_g[i] + v * cosine.g[i];
  constexpr int kFirst[6] = {0, 0, 0, 1, 1, 2}, kSecond[6] = {0, 1, 2, 1, 2, 2};
  for (int k = 0; k < 6; ++k) {
    const int i = kFirst[k], j = kSecond[k];
    h[k] = c * height.h[k] + v * cosine.h[k] + (v_g[i] * cosine.g[j] + v_g[j] * cosine.g[i]);
  }
  const double sx = back_x ? -1.0 : 1.0, sy = back_y ? -1.0 : 1.0;
  const auto set = [&](const double(&from_g)[3], const double(&from_h)[6], Vec3& grad, Mat3& hess) {
    grad << sx * from_g[0], sy * from_g[1], from_g[2];
    const double xy = sx * sy * from_h[1], xz = sx * from_h[2], yz = sy * from_h[4];
    hess << from_h[0], xy, xz, xy, from_h[3], yz, xz, yz, from_h[5];
  };
  jet.overlap_nm = v * c;
  set(g, h, jet.overlap_grad, jet.overlap_hess_per_nm);
  jet.log_radius = radius.value;
  set(radius.g, radius.h, jet.log_radius_grad_per_nm, jet.log_radius_hess_per_nm2);
}

}  // namespace

void ScanFields::contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const double z = apex_w_nm.z();
  const Grid& finest = grids_[0];
  const Cell cell = cell_of(at.x, at.y, finest.columns, finest.rows, finest.inv_dx, finest.inv_dy);
  const std::ptrdiff_t stride = (finest.columns + 2) * kLanes;
  const double* corner = finest.corner(cell.column, cell.row);
  double fine[6][6];
  stencil_of_one<kLanes>(corner, stride, cell.wx, cell.wy, fine[0]);
  const SofteningLevel level = softening_level(rule_, z - fine[0][kValue]);
  if (level.level <= 0.0) {
    stencil<2, kLanes>(corner, stride, cell.wx, cell.wy, fine);
    contact_of(level_in_space(fine[0]), level_in_space(fine[1]), level_in_space(fine[2]), z, at.back_x,
               at.back_y, jet);
    return;
  }
  const LevelBlend blend = blend_levels(level.level, levels_);
  blended(at, blend, fine[0], z, level, jet);
}

void ScanFields::growing_at(const Vec3& apex_w_nm, const SofteningRule& rule,
                            ContactJet& jet) const noexcept {
  const Place at = place(apex_w_nm.x(), apex_w_nm.y());
  const double z = apex_w_nm.z();
  const Grid& finest = grids_[0];
  const Cell cell = cell_of(at.x, at.y, finest.columns, finest.rows, finest.inv_dx, finest.inv_dy);
  const std::ptrdiff_t stride = (finest.columns + 2) * kLanes;
  double fine[6];
  stencil_of_one<kLanes>(finest.corner(cell.column, cell.row), stride, cell.wx, cell.wy, fine);
  SofteningLevel level = softening_level(rule, z - fine[kValue]);
  level.level += level_of_softening(rule_, rule.finest_nm);
  blended(at, blend_levels(level.level, levels_), fine, z, level, jet);
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
    const Grid& grid = layer->grid;
    const Cell cell = cell_of(at.x, at.y, grid.columns, grid.rows, grid.inv_dx, grid.inv_dy);
    const std::ptrdiff_t stride = (grid.columns + 2) * kLayerLanes;
    double jets[4][6];
    stencil<2, kLayerLanes>(grid.corner(cell.column, cell.row), stride, cell.wx, cell.wy, jets);
    contact_of(level_in_space(jets[0]), level_in_space(jets[1]), level_in_space(jets[2]), apex_w_nm.z(),
               at.back_x, at.back_y, jet);
    return;
  }
  const LevelBlend blend = blend_levels(level_of_softening(rule_, softening_nm), levels_);
  const double none[6] = {};
  blended(at, blend, none, apex_w_nm.z(), SofteningLevel{}, jet);
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
  const Cell cell = cell_of(at.x, at.y, grid.columns, grid.rows, grid.inv_dx, grid.inv_dy);
  const std::ptrdiff_t stride = (grid.columns + 2) * kLayerLanes;
  const double* corner = grid.corner(cell.column, cell.row);
  double height = 0, radius = 0, cosine = 0;
  for (int j = 0; j < 4; ++j) {
    double line[3] = {0, 0, 0};
    for (int i = 0; i < 4; ++i) {
      for (int k = 0; k < 3; ++k) line[k] += cell.wx.value[i] * corner[j * stride + i * kLayerLanes + k];
    }
    height += cell.wy.value[j] * line[0];
    radius += cell.wy.value[j] * line[1];
    cosine += cell.wy.value[j] * line[2];
  }
  overlap_nm = (height - apex_w_nm.z()) * cosine;
  log_radius = radius;
}

void ScanFields::blended(const Place& at, const LevelBlend& blend, const double (&first_jet)[6], double z_nm,
                         const SofteningLevel& level, ContactJet& jet) const noexcept {
  Blended height, radius, cosine;
  int k = 0;
  while (k < 3) {
    const int g = (blend.first + k) / 2;
    const Grid& grid = grids_[static_cast<std::size_t>(g)];
    const Cell cell = cell_of(at.x, at.y, grid.columns, grid.rows, grid.inv_dx, grid.inv_dy);
    const std::ptrdiff_t stride = (grid.columns + 2) * kLanes;
    const double* corner = grid.corner(cell.column, cell.row);
    double jets[6][6];
    const bool odd = (blend.first + k) % 2 == 1;
    const bool both = !odd && k < 2;
    int lane = 0;
    if (both) {
      stencil<3, kLanes>(corner, stride, cell.wx, cell.wy, jets);
    } else if (odd) {
      stencil<2, kLanes>(corner + 2, stride, cell.wx, cell.wy, jets);
      lane = 1;
    } else {
      stencil<2, kLanes>(corner, stride, cell.wx, cell.wy, jets);
    }
    for (int level_of_grid = 0; level_of_grid < (both ? 2 : 1); ++level_of_grid, ++k, lane += 3) {
      const double w = blend.weight[k];
      const double w1 = blend.slope[k] * level.slope_per_nm;
      const double w2 =
          blend.bend[k] * level.slope_per_nm * level.slope_per_nm + blend.slope[k] * level.bend_per_nm2;
      height.add(jets[lane], w, w1, w2);
      radius.add(jets[lane + 1], w, w1, w2);
      cosine.add(jets[lane + 2], w, w1, w2);
    }
    if (k == 2 && blend.weight[2] == 0.0 && blend.slope[2] == 0.0) break;  // at the fine end two levels
  }
  contact_of(in_space(height, first_jet), in_space(radius, first_jet), in_space(cosine, first_jet), z_nm,
             at.back_x, at.back_y, jet);
}

}  // namespace telenano::physics
