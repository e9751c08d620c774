#include "telenano/nve_server/fit/fit_minimum.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"

namespace telenano::fit {
namespace {

constexpr double kLeastHumidity = 1.0;  // %
constexpr double kGreatestHumidity = 98.9;
constexpr double kLeastFilm_nm = 0.01;
constexpr double kGreatestFilm_nm = 100.0;

double power(double base, double exponent) {
  return det_exp(exponent * det_log(base));
}

struct Start {
  double modulus_gpa;
  double work_n_m;
};

std::vector<Start> starts_of(const PreparedCurve& curve, const FitSetup& setup, bool adhesion) {
  const double stiffness = 1.0 / setup.compliance_nm_nn;
  double work = setup.law.work_of_adhesion_n_m;
  if (curve.retract.leap) work = stiffness * curve.retract.leap->height_nm / (1.75 * kPi * setup.radius_nm);
  work = std::clamp(work, 1e-6, 20.0);
  // Hertz at the deepest part: S = dF/dδ = (3/2) K^(2/3) (R F)^(1/3), and d(deflection)/d(−z) = S/(S + k).
  const double slope = std::clamp(curve.deepest_slope, 0.01, 0.99);
  const double contact = stiffness * slope / (1.0 - slope);
  const std::vector<double>& d = curve.approach.deflection_nm;
  const double push = std::max(stiffness * (d.back() - curve.offset_nm[0]), stiffness * curve.noise_nm) +
                      (adhesion ? 2.0 * kPi * work * setup.radius_nm : 0.0);
  const double modulus_k = power(contact / 1.5, 1.5) / std::sqrt(setup.radius_nm * push);
  const double left = 4.0 / 3.0 / modulus_k - setup.tip_compliance_per_gpa;
  const double poisson = 1.0 - setup.sample_poisson * setup.sample_poisson;
  const double modulus = left > 0 ? poisson / left : setup.sample_modulus_gpa;
  std::vector<Start> starts;
  for (const double factor : {1.0, 0.2, 5.0, 0.04}) starts.push_back({modulus * factor, work});
  starts.push_back({setup.sample_modulus_gpa, work});
  starts.push_back({modulus, 2.0 * work});
  for (Start& start : starts)
    start.modulus_gpa =
        std::clamp(start.modulus_gpa, setup.modulus_min_gpa * 1.01, setup.modulus_max_gpa * 0.99);
  return starts;
}

Vector first_guess(const Start& start, const ParameterLayout& at, const PreparedCurve& curve,
                   const FitSetup& setup) {
  Vector p = Vector::Zero(at.count);
  p[at.modulus] = det_log(start.modulus_gpa);
  if (at.work >= 0) p[at.work] = det_log(start.work_n_m);
  if (at.radius >= 0) p[at.radius] = det_log(setup.radius_nm);
  if (at.distance >= 0) p[at.distance] = det_log(setup.law.equilibrium_distance_nm);
  if (at.hamaker >= 0) {
    const double z0 = setup.law.equilibrium_distance_nm;
    p[at.hamaker] = det_log(setup.hamaker_aj.value_or(12.0 * kPi * z0 * z0 * start.work_n_m));
  }
  const physics::CapillaryParameters& water = setup.law.long_range.capillary;
  if (at.humidity >= 0) p[at.humidity] = det_log(std::max(water.humidity_percent, kLeastHumidity));
  if (at.film >= 0) p[at.film] = det_log(std::max(water.film_nm, kLeastFilm_nm));
  p[at.touch] = curve.touch_z_nm;
  p[at.offsets] = curve.offset_nm[0];
  p[at.offsets + 1] = curve.offset_nm[1];
  p[at.offsets + 2] = curve.tilt[0];
  p[at.offsets + 3] = curve.tilt[1];
  return p;
}

/// Where the lever leaps over what tells humidity and film, several valleys are as good as the best: an interval
/// holds all of them.
void look_for_modes(FitSearch& search, const ParameterLayout& at, Minimum& out) {
  const Vector from = out.best.p;
  for (const double humidity : {0.0, 25.0, 45.0, 65.0, 85.0}) {
    if (humidity > 0 && at.humidity < 0) continue;
    for (const double film_nm : {0.0, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0}) {
      if (film_nm > 0 && at.film < 0) continue;
      Vector p = from;
      if (humidity > 0) p[at.humidity] = det_log(humidity);
      if (film_nm > 0) p[at.film] = det_log(film_nm);
      Found found = search.descend(p, 5);
      ++out.starts;
      if (!found.good || found.cost > 40.0 * out.best.cost) continue;
      found = search.descend(found.p, 40);
      out.modes.push_back(found);
      if (found.cost < out.best.cost) out.best = found;
    }
  }
}

/// Each point that passes a leap makes a small step of the cost, before which a descent may stop.
void look_beyond_steps(FitSearch& search, const ParameterLayout& at, Found& best) {
  for (int i = 0; i < at.laws; ++i) {
    for (const double way : {-0.01, 0.01}) {
      Vector p = best.p;
      p[i] += way;
      const Found found = search.descend(p, 40);
      if (found.good && found.cost < best.cost) best = found;
    }
  }
}

}  // namespace

Bounds bounds_of(const ParameterLayout& at, const FitSetup& setup) {
  Bounds bounds{Vector::Constant(at.count, -1e12), Vector::Constant(at.count, 1e12)};
  const auto bound = [&](int i, double low, double high) {
    if (i < 0) return;
    bounds.low[i] = det_log(low);
    bounds.high[i] = det_log(high);
  };
  bound(at.modulus, setup.modulus_min_gpa, setup.modulus_max_gpa);
  bound(at.work, 1e-6, 20.0);
  bound(at.radius, kLeastRadius_nm, kGreatestRadius_nm);
  bound(at.distance, kLeastDistance_nm, kGreatestDistance_nm);
  bound(at.hamaker, 1e-7, 1e4);
  bound(at.humidity, kLeastHumidity, kGreatestHumidity);
  bound(at.film, kLeastFilm_nm, kGreatestFilm_nm);
  return bounds;
}

Minimum find_minimum(FitSearch& search, const ParameterLayout& at, const PreparedCurve& curve,
                     const FitSetup& setup) {
  Minimum out;
  std::vector<double> ends;
  for (const Start& start : starts_of(curve, setup, at.work >= 0)) {
    const Found found = search.descend(first_guess(start, at, curve, setup), 40);
    ++out.starts;
    if (!found.good) continue;
    ends.push_back(found.cost);
    if (found.cost < out.best.cost) out.best = found;
  }
  if (!out.best.good) return out;
  if (moves_steps(at)) look_for_modes(search, at, out);
  out.best = search.descend(out.best.p, 40);
  if (moves_steps(at)) look_beyond_steps(search, at, out.best);
  for (const double end : ends) out.starts_agree += end <= 1.01 * out.best.cost + 0.1 ? 1 : 0;
  return out;
}

}  // namespace telenano::fit
