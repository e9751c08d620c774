#include "telenano/nve_server/physics/potential/far_term.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"

namespace telenano::physics {
namespace {

// Steps of the table, and how far the mirrored ends must be away (their error falls to a quarter a node).
constexpr double kGapStep = 0.04;
constexpr double kRadiusStep = 0.1;
constexpr int kBeyond = 16;
constexpr double kFarthestGap_nm = 3e5;

// The four cubic B-splines of a cell at u and their derivatives in it.
struct Line {
  double value[4], slope[4], bend[4];
};

Line line_at(double u) noexcept {
  const double v = 1.0 - u;
  const double sixth = 1.0 / 6.0;
  return {{sixth * v * v * v, sixth * ((3.0 * u - 6.0) * u * u + 4.0),
           sixth * (((-3.0 * u + 3.0) * u + 3.0) * u + 1.0), sixth * u * u * u},
          {-0.5 * v * v, (1.5 * u - 2.0) * u, (-1.5 * u + 1.0) * u + 0.5, 0.5 * u * u},
          {v, 3.0 * u - 2.0, 1.0 - 3.0 * u, u}};
}

double sum(const double (&weight)[4], const double* c) noexcept {
  return (weight[0] * c[0] + weight[1] * c[1]) + (weight[2] * c[2] + weight[3] * c[3]);
}

using FarEnergy = std::function<double(double, double)>;

BicubicSpline table_of(const FarEnergy& energy_aj, double cut_off_nm, double first, double last) {
  HeightGrid grid;
  const double log_cut_off = det_log(cut_off_nm);
  grid.columns =
      static_cast<int>(std::ceil((det_log(kFarthestGap_nm) - log_cut_off) / kGapStep)) + 2 * kBeyond;
  grid.rows = static_cast<int>(std::ceil((last - first) / kRadiusStep)) + 2 * kBeyond;
  grid.dx_nm = kGapStep;
  grid.dy_nm = kRadiusStep;
  grid.x_first_nm = log_cut_off - kBeyond * kGapStep;
  grid.y_first_nm = first - kBeyond * kRadiusStep;
  grid.z_nm.resize(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
  for (int row = 0; row < grid.rows; ++row) {
    const double radius = det_exp(grid.y_first_nm + row * kRadiusStep);
    for (int column = 0; column < grid.columns; ++column) {
      const double gap = det_exp(grid.x_first_nm + column * kGapStep);
      grid.z_nm[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                static_cast<std::size_t>(column)] = energy_aj(gap, radius) / radius;
    }
  }
  return BicubicSpline::interpolating(grid);
}

}  // namespace

FarTerm::FarTerm(const FarEnergy& energy_aj, double cut_off_nm, double first, double last)
    : cut_off_nm_(cut_off_nm), spline_(table_of(energy_aj, cut_off_nm, first, last)) {
  // Column kBeyond is the gap a0; there value and slope of the spline are again splines over ρ.
  for (int row = -1; row <= spline_.rows(); ++row) {
    const double left = spline_.coefficient(kBeyond - 1, row);
    const double here = spline_.coefficient(kBeyond, row);
    const double right = spline_.coefficient(kBeyond + 1, row);
    touch_value_.push_back((left + 4.0 * here + right) / 6.0);
    touch_slope_.push_back((right - left) / (2.0 * kGapStep));
  }
}

void FarTerm::add(double overlap_nm, double log_radius, double radius, PotentialJet& jet) const noexcept {
  double value = 0, by_x = 0, by_x_twice = 0, by_r = 0, by_r_twice = 0, by_both = 0;
  double x_rate = 0, x_bend = 0;
  if (overlap_nm < 0) {
    const double per_gap = 1.0 / (cut_off_nm_ - overlap_nm);
    x_rate = -per_gap;
    x_bend = -per_gap * per_gap;
    const HeightJet t = spline_.jet(-det_log(per_gap), log_radius);
    value = t.z;
    by_x = t.zx;
    by_x_twice = t.zxx;
    by_r = t.zy;
    by_r_twice = t.zyy;
    by_both = t.zxy;
  } else {
    // The force at touch goes on: a line in the overlap, its two ends functions of ρ.
    const double at = std::clamp((log_radius - spline_.y_first_nm()) / kRadiusStep, 0.0,
                                 static_cast<double>(spline_.rows() - 2));
    const int cell = static_cast<int>(at);
    const Line w = line_at(at - cell);
    const double* end = &touch_value_[static_cast<std::size_t>(cell)];
    const double* rate = &touch_slope_[static_cast<std::size_t>(cell)];
    x_rate = -1.0 / cut_off_nm_;
    const double along = x_rate * overlap_nm;
    const double per_step = 1.0 / kRadiusStep;
    by_x = sum(w.value, rate);
    by_both = sum(w.slope, rate) * per_step;
    value = sum(w.value, end) + along * by_x;
    by_r = sum(w.slope, end) * per_step + along * by_both;
    by_r_twice = (sum(w.bend, end) + along * sum(w.bend, rate)) * (per_step * per_step);
  }
  jet.energy_aj += radius * value;
  jet.force_nn += radius * by_x * x_rate;
  jet.stiffness_n_m += radius * (by_x_twice * x_rate * x_rate + by_x * x_bend);
  jet.by_radius_aj += radius * (value + by_r);
  jet.mixed_nn += radius * (by_x + by_both) * x_rate;
  jet.by_radius_twice_aj += radius * (value + 2.0 * by_r + by_r_twice);
}

}  // namespace telenano::physics
