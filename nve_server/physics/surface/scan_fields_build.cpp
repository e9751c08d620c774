// How the fields of a scan are made; scan_fields.cpp reads them.
#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/scan_tiles.h"

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
        rule.pressed_growth >= 0.0 && rule.gap_growth >= 0.0 && rule.dead_zone_nm >= 0.0 &&
        rule.pressed_onset_nm >= 0.0)) {
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

// The finest grid has half a pixel, but need not be finer than a foot of radius R at t0, unless the area is
// small: over a groove, where two feet meet, the fields have creases t0 over the difference of their slopes
// wide, which a finer grid rounds off less.
double finest_spacing_nm(const HeightGrid& grid, double radius, const SofteningRule& rule) noexcept {
  constexpr double kSmallNodes = 131072;
  const double half_pixel = 0.5 * std::min(grid.dx_nm, grid.dy_nm);
  const double foot = std::sqrt(radius * rule.finest_nm) / 1.2;
  const double area = (grid.columns - 1) * grid.dx_nm * ((grid.rows - 1) * grid.dy_nm);
  return std::clamp(std::sqrt(area / kSmallNodes), std::max(half_pixel, 0.25 * foot),
                    std::max(half_pixel, foot));
}

// The spline may overshoot its samples by a seventh of a step.
double relief_of(const HeightGrid& grid) noexcept {
  const auto [lowest, highest] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  return 1.3 * (*highest - *lowest);
}

}  // namespace

bool ScanFields::is_large(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule) noexcept {
  constexpr double kMostNodes = 2e6;  // some 5 s and 200 MB
  const double spacing = finest_spacing_nm(grid, tip_radius_nm, rule);
  return (grid.columns - 1) * grid.dx_nm / spacing * ((grid.rows - 1) * grid.dy_nm / spacing) > kMostNodes;
}

ScanFields::ScanFields(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule,
                       const std::vector<double>& fixed_softenings_nm,
                       const std::function<void(double)>& made,
                       std::shared_ptr<const RetractionKernel> pull_off)
    : rule_(rule), radius_(tip_radius_nm) {
  checked(grid, tip_radius_nm, rule);
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  const DilationLattice top = lay_out(grid, height, checked(fixed_softenings_nm));
  // A node costs about the same at every level.
  double all = 0, done = 0;
  const double most_log_radius = det_log(kMostRadii * radius_);
  for (const Grid& fields : grids_) all += 2.0 * fields.columns * fields.rows;
  for (const Layer& layer : layers_) all += static_cast<double>(layer.grid.columns) * layer.grid.rows;
  const auto fill = [&](Grid& fields, int lane, double t, const RetractionKernel* kernel) {
    if (!fields.made) {
      const auto memory = std::make_shared<std::vector<double>>(fields.size());
      fields.made = {memory, memory->data()};
    }
    const double here = static_cast<double>(fields.columns) * fields.rows;
    const std::vector<DilatedNode> nodes = Dilation(height, lattice_of(fields, top, t), tip_radius_nm, t,
                                                    relief_of(grid), widest_lanes(), kernel)
                                               .make_all([&](double part) {
                                                 if (made) made((done + part * here) / all);
                                               });
    interpolate(fields, nodes, 0, 0, fields.columns, most_log_radius, whole(fields), lane);
    done += here;
  };
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    Grid& fields = grids_[g];
    for (int half = 0; half < 2; ++half) {
      const double t = softening_of_level(2 * static_cast<int>(g) + half);
      fill(fields, 3 * half, t, g == 0 && half == 0 ? pull_off.get() : nullptr);
      if (half == 0 && g > 0)
        hold_growth(grids_[g - 1], whole(grids_[g - 1]), fields, whole(fields), whole(fields), 0.5 * t);
    }
    hold_growth(whole(fields), rule.finest_nm * (1 << (2 * g)));
  }
  for (Layer& layer : layers_) fill(layer.grid, 0, layer.softening_nm, nullptr);
}

ScanFields ScanFields::by_tiles(const HeightGrid& grid, std::shared_ptr<const BicubicSpline> height,
                                double tip_radius_nm, const SofteningRule& rule,
                                const std::vector<double>& fixed_softenings_nm,
                                std::shared_ptr<const RetractionKernel> pull_off) {
  checked(grid, tip_radius_nm, rule);
  ScanFields fields;
  fields.rule_ = rule;
  fields.radius_ = tip_radius_nm;
  const DilationLattice top = fields.lay_out(grid, *height, checked(fixed_softenings_nm));
  fields.tiles_ =
      std::make_shared<Tiles>(fields, std::move(height), top, relief_of(grid), std::move(pull_off));
  return fields;
}

DilationLattice ScanFields::lattice_of(const Grid& grid, DilationLattice top,
                                       double softening_nm) const noexcept {
  top.columns = grid.columns;
  top.rows = grid.rows;
  top.node_dx_nm = width_ / (grid.columns - 1);
  top.node_dy_nm = length_ / (grid.rows - 1);
  top.m = sub_samples(top, 0.65 * std::sqrt(radius_ * softening_nm));
  return top;
}

void ScanFields::interpolate(const Grid& grid, const std::vector<DilatedNode>& nodes, int i0, int j0, int nx,
                             double most_log_radius, const Patch& to, int lane) noexcept {
  // A spline's values at its nodes are (1 + δ²/6) of its coefficients; 1 − δ²/6 + δ⁴/36 undoes that up to sixth differences. With 1 − δ²/6
  // alone, nodes as far apart as what they show is wide (foot) miss it by some per cent.
  const auto coefficient = [](const double(&f)[5]) {
    return (54.0 * f[2] - 10.0 * (f[1] + f[3]) + (f[0] + f[4])) / 36.0;
  };
  const auto node = [&](int i, int j) -> const DilatedNode& {
    return nodes[static_cast<std::size_t>(folded(j, grid.rows) - j0) * static_cast<std::size_t>(nx) +
                 static_cast<std::size_t>(folded(i, grid.columns) - i0)];
  };
  for (int j = to.low; j <= to.high; ++j) {
    for (int i = to.left; i <= to.right; ++i) {
      const int ci = folded(i - 1, grid.columns), cj = folded(j - 1, grid.rows);
      double line[3][5];
      double least = INFINITY, most = 0;
      for (int r = 0; r < 5; ++r) {
        double height[5], log_radius[5], cosine[5];
        for (int k = 0; k < 5; ++k) {
          const DilatedNode& n = node(ci + k - 2, cj + r - 2);
          height[k] = n.height_nm;
          log_radius[k] = n.log_radius;
          cosine[k] = n.cosine;
          least = std::min(least, n.cosine);
          most = std::max(most, n.cosine);
        }
        line[0][r] = coefficient(height);
        line[1][r] = coefficient(log_radius);
        line[2][r] = coefficient(cosine);
      }
      double* const at = to.at(i, j) + lane;
      for (int k = 0; k < 3; ++k) at[k] = coefficient(line[k]);
      at[1] = std::min(at[1], most_log_radius);
      at[2] = std::clamp(at[2], least, most);
    }
  }
}

DilationLattice ScanFields::lay_out(const HeightGrid& grid, const BicubicSpline& height,
                                    const std::vector<double>& fixed_softenings_nm) {
  x_first_ = grid.x_first_nm;
  y_first_ = grid.y_first_nm;
  width_ = (grid.columns - 1) * grid.dx_nm;
  length_ = (grid.rows - 1) * grid.dy_nm;
  levels_ = level_count(rule_);
  softening_ = SofteningTable(rule_);
  const int grids = (levels_ + 1) / 2;
  // The others are twice as wide each from the third on, so that their nodes are nodes of the finer ones.
  const double finest = finest_spacing_nm(grid, radius_, rule_);
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
  for (std::size_t n = 0; n < grids_.size() + layers_.size(); ++n)
    grid_of(static_cast<std::uint32_t>(n))->grid_number = static_cast<int>(n);
  return top;
}

std::vector<std::span<const double>> ScanFields::coefficients() const {
  std::vector<std::span<const double>> all;
  const auto add = [&](const Grid& grid) {
    grid.need(0, grid.columns + 1, 0, grid.rows + 1);
    all.emplace_back(grid.made.get(), grid.size());
  };
  for (const Grid& grid : grids_) add(grid);
  for (const Layer& layer : layers_) add(layer.grid);
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
    const auto memory = std::make_shared<std::vector<double>>(std::move(coefficients[g]));
    one.made = {memory, memory->data()};
  }
  return fields;
}

// Of two levels on one grid: where each coefficient is high enough the fields are everywhere.
void ScanFields::hold_growth(const Patch& fields, double fine_t) noexcept {
  for (int j = fields.low; j <= fields.high; ++j) {
    for (int i = fields.left; i <= fields.right; ++i) {
      double* const c = fields.at(i, j);
      c[3] += std::max(0.0, missing_height(c[3], c[0], fine_t));
      c[5] += std::max(0.0, missing_cosine(c[5], c[2]));
    }
  }
}

/// How far the coefficients of a grid's even level rise over the odd one of the finer grid before.
class ScanFields::Rises {
 public:
  Rises(const Grid& coarse, const Patch& raised)
      : columns_(coarse.columns + 2),
        rows_(coarse.rows + 2),
        across_(risen_span(raised.left, raised.right, columns_)),
        along_(risen_span(raised.low, raised.high, rows_)),
        rise_(static_cast<std::size_t>(across_.count()) * static_cast<std::size_t>(along_.count()) * 2) {}

  void look(const Grid& finer, const Patch& fine, const Patch& raw, double fine_t) noexcept;
  void raise(const Patch& raw, const Patch& raised) const noexcept;

 private:
  static double fine_value(const Patch& fine, int i, int j, int lane) noexcept;
  static void coarse_value(const Patch& raw, int i, int j, double& height, double& cosine) noexcept;
  void ask(int i, int j, double by_height, double by_cosine) noexcept;
  std::size_t index(int i, int j) const noexcept {
    return static_cast<std::size_t>((j - along_.first) * across_.count() + i - across_.first) * 2;
  }

  int columns_, rows_;
  Span across_, along_;
  std::vector<double> rise_;  // height and cosine of each coefficient
};

// The finer spline at one of its nodes.
double ScanFields::Rises::fine_value(const Patch& fine, int i, int j, int lane) noexcept {
  const auto line = [&](int row) {
    return fine.at(i, row)[lane] + 4.0 * fine.at(i + 1, row)[lane] + fine.at(i + 2, row)[lane];
  };
  return (line(j) + 4.0 * line(j + 1) + line(j + 2)) / 36.0;
}

// The coarse spline at a node of the finer grid, by all four coefficients a line.
void ScanFields::Rises::coarse_value(const Patch& raw, int i, int j, double& height,
                                     double& cosine) noexcept {
  const auto weights_of = [](int k, double(&w)[4]) {
    if (k % 2 == 0) {
      w[0] = w[2] = 1.0 / 6, w[1] = 4.0 / 6, w[3] = 0.0;
    } else {
      w[0] = w[3] = 1.0 / 48, w[1] = w[2] = 23.0 / 48;
    }
  };
  double wi[4], wj[4];
  weights_of(i, wi);
  weights_of(j, wj);
  height = cosine = 0;
  for (int r = 0; r < 4; ++r) {
    for (int k = 0; k < 4; ++k) {
      if (wj[r] * wi[k] == 0.0) continue;
      const double* c = raw.at(i / 2 + k, j / 2 + r);  // of the padded ones: node i/2 is at i/2 + 1
      height += wj[r] * wi[k] * c[0];
      cosine += wj[r] * wi[k] * c[2];
    }
  }
}

// Asks those coefficients to rise that weigh most at a node of the finer grid, by so much that it rises by this.
void ScanFields::Rises::ask(int i, int j, double by_height, double by_cosine) noexcept {
  struct Line {
    int count;
    double share;  // of the whole weight; the outermost two of a half-way place are left out
  };
  constexpr Line kNode{3, 1.0};
  constexpr Line kHalfWay{2, 23.0 / 24};
  const Line& across = i % 2 == 0 ? kNode : kHalfWay;
  const Line& along = j % 2 == 0 ? kNode : kHalfWay;
  const double share = across.share * along.share;
  const int from_i = i / 2 + (i % 2), from_j = j / 2 + (j % 2);
  for (int r = 0; r < along.count; ++r) {
    for (int k = 0; k < across.count; ++k) {
      if (!across_.has(from_i + k) || !along_.has(from_j + r)) continue;
      double* up = &rise_[index(from_i + k, from_j + r)];
      up[0] = std::max(up[0], by_height / share);
      up[1] = std::max(up[1], by_cosine / share);
    }
  }
}

// Looks at the nodes of the finer grid where the coarser one is too low.
void ScanFields::Rises::look(const Grid& finer, const Patch& fine, const Patch& raw, double fine_t) noexcept {
  const Span nodes_x = nodes_that_raise(across_, finer.columns);
  const Span nodes_y = nodes_that_raise(along_, finer.rows);
  for (int j = nodes_y.first; j <= nodes_y.last; ++j) {
    for (int i = nodes_x.first; i <= nodes_x.last; ++i) {
      double height, cosine;
      coarse_value(raw, i, j, height, cosine);
      const double by_height = missing_height(height, fine_value(fine, i, j, 3), fine_t);
      const double by_cosine = missing_cosine(cosine, fine_value(fine, i, j, 5));
      if (by_height > 0.0 || by_cosine > 0.0) ask(i, j, by_height, by_cosine);
    }
  }
}

// Mirrored ends stay mirrored: a coefficient rises with its image.
void ScanFields::Rises::raise(const Patch& raw, const Patch& raised) const noexcept {
  // The image of a coefficient at the rim; of the inner one beside it the rim's: the two share the greater rise.
  const auto image = [](int i, int count) {
    if (i == 0 || i == 2) return 2 - i;
    return i == count - 1 || i == count - 3 ? 2 * count - 4 - i : i;
  };
  for (int j = raised.low; j <= raised.high; ++j) {
    for (int i = raised.left; i <= raised.right; ++i) {
      const int mi = image(i, columns_), mj = image(j, rows_);
      double* const c = raw.at(i, j);
      const std::size_t all[4] = {index(i, j), index(mi, j), index(i, mj), index(mi, mj)};
      double height = 0, cosine = 0;
      for (const std::size_t one : all) {
        height = std::max(height, rise_[one]);
        cosine = std::max(cosine, rise_[one + 1]);
      }
      c[0] += height;
      c[2] = std::min(1.0, c[2] + cosine);
    }
  }
}

// Of the even level of a grid over the odd one of the finer grid before: looked at on the finer one's nodes,
// and where it is too low the coefficients that weigh most there are raised. At a node common to both the 3 ×
// 3 around it have the whole weight, half way between nodes the nearest two of a line 23/24 of it.
// `raised`: in place; what reaches them must be in `raw` and `fine` (reach_of_growth).
void ScanFields::hold_growth(const Grid& finer, const Patch& fine_fields, const Grid& coarse,
                             const Patch& raw, const Patch& raised, double fine_t) {
  if (finer.columns == coarse.columns) {
    for (int j = raised.low; j <= raised.high; ++j) {
      for (int i = raised.left; i <= raised.right; ++i) {
        const double* const fine = fine_fields.at(i, j);
        double* const c = raw.at(i, j);
        c[0] += std::max(0.0, missing_height(c[0], fine[3], fine_t));
        c[2] += std::max(0.0, missing_cosine(c[2], fine[5]));
      }
    }
    return;
  }
  Rises rises(coarse, raised);
  rises.look(finer, fine_fields, raw, fine_t);
  rises.raise(raw, raised);
}

}  // namespace telenano::physics
