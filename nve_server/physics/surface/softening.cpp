#include "telenano/nve_server/physics/surface/softening.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {

constexpr double kOnset = 0.1;  // ξ0, nm

double fourth_root(double x) {
  return std::sqrt(std::sqrt(x));
}

}  // namespace

SofteningRule softening_rule(double radius_nm, double work_of_adhesion_n_per_m, double modulus_gpa,
                             double range_nm) noexcept {
  constexpr double kPi = 3.14159265358979323846;
  const double k = 4.0 / 3.0 * modulus_gpa;
  const double w = kPi * work_of_adhesion_n_per_m / k;
  const double x = det_cbrt(w * w * radius_nm) / range_nm;
  const double wanted = range_nm * (0.36 + 0.47 * x * x / (x + 2.65));
  SofteningRule rule;
  rule.coarsest_nm = 0.25 * radius_nm;
  // At least one octave is left below R/4, so that growing has somewhere to go.
  const double most = 0.5 * rule.coarsest_nm;
  const double ratio = wanted / most;
  rule.finest_nm = wanted / fourth_root(1.0 + ratio * ratio * ratio * ratio);
  rule.dead_zone_nm = 2.0 * range_nm;
  rule.pressed_onset_nm = 0.3 * range_nm;
  return rule;
}

SofteningLevel softening_level(const SofteningRule& rule, double v0_nm) noexcept {
  const bool pressed = v0_nm < 0.0;
  const double xi = pressed ? -v0_nm - rule.pressed_onset_nm : v0_nm - rule.dead_zone_nm;
  if (!(xi > 0.0)) return {};
  const double side = pressed ? -1.0 : 1.0;
  const double growth = pressed ? rule.pressed_growth : rule.gap_growth;
  // s = ξ − ξ ξ0²/(ξ² + ξ0²)
  constexpr double o2 = kOnset * kOnset;
  const double inv = 1.0 / (xi * xi + o2);
  const double s = xi * xi * xi * inv;
  const double s1 = xi * xi * (xi * xi + 3.0 * o2) * inv * inv;
  const double s2 = 2.0 * o2 * xi * (3.0 * o2 - xi * xi) * inv * inv * inv;
  const double q = growth * s;
  const double q1 = side * growth * s1;
  const double q2 = growth * s2;
  // level = ½ log₂(1 + c²), c = q_c/t0; q_c = q m^(−1/4), m = 1 + (q/q_m)⁴: q_c' = q' m^(−5/4),
  // q_c'' = q'' m^(−5/4) − 5 q'² q³/q_m⁴ m^(−9/4).
  const double t0 = rule.finest_nm;
  const double qm2 = rule.coarsest_nm * rule.coarsest_nm - t0 * t0;
  const double r2 = q * q / qm2;
  const double m = 1.0 + r2 * r2;
  const double root = 1.0 / fourth_root(m);
  const double c = q * root / t0;
  const double by_q = root / m / t0;
  const double c1 = q1 * by_q;
  const double c2 = q2 * by_q - 5.0 * q1 * q1 * (r2 * q / qm2) * by_q / m;
  const double d = 1.0 + c * c;
  const double inv_d = 1.0 / d;
  const double slope = c * c1 * inv_d;
  SofteningLevel level;
  level.level = 0.5 / kLn2 * det_log(d);
  level.slope_per_nm = slope / kLn2;
  level.bend_per_nm2 = ((c1 * c1 + c * c2) * inv_d - 2.0 * slope * slope) / kLn2;
  return level;
}

double level_of_softening(const SofteningRule& rule, double softening_nm) noexcept {
  const double ratio = softening_nm / rule.finest_nm;
  return ratio > 1.0 ? det_log(ratio) / kLn2 : 0.0;
}

int level_count(const SofteningRule& rule) noexcept {
  const int levels = 2 + static_cast<int>(level_of_softening(rule, rule.coarsest_nm));
  return std::clamp(levels, 3, kMaxLevels);
}

LevelBlend blend_levels(double level, int count) noexcept {
  LevelBlend blend;
  const double last = count - 1.0;
  double e = level;
  double live = 1.0;
  if (!(e > 0.0)) return blend;
  if (e >= last) {  // only a fixed softening comes here: growing ends at t_m, below the last level's
    e = last;
    live = 0.0;
  }
  if (e < 0.5) {
    blend.weight[0] = 1.0 - e;
    blend.weight[1] = e;
    blend.slope[0] = -1.0;
    blend.slope[1] = 1.0;
    return blend;
  }
  // Centred at k: ½(½ − u)², ¾ − u², ½(½ + u)² for k − 1, k, k + 1, u = e − k in [−½, ½].
  const int k = static_cast<int>(e + 0.5);  // NOLINT(bugprone-incorrect-roundings): e >= 0.5
  const double u = e - k;
  const double a = 0.5 - u, b = 0.5 + u;
  blend.first = k - 1;
  blend.weight[0] = 0.5 * a * a;
  blend.weight[1] = 0.75 - u * u;
  blend.weight[2] = 0.5 * b * b;
  blend.slope[0] = -a * live;
  blend.slope[1] = -2.0 * u * live;
  blend.slope[2] = b * live;
  blend.bend[0] = live;
  blend.bend[1] = -2.0 * live;
  blend.bend[2] = live;
  if (blend.first + 2 >= count) {  // the last stands for the one beyond it
    blend.first = count - 3;
    const auto shift = [](double(&w)[3]) {
      w[2] += w[1];
      w[1] = w[0];
      w[0] = 0.0;
    };
    shift(blend.weight);
    shift(blend.slope);
    shift(blend.bend);
  }
  return blend;
}

}  // namespace telenano::physics
