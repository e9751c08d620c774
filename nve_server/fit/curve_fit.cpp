#include "telenano/nve_server/fit/curve_fit.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/fit/fit_notes.h"
#include "telenano/nve_server/fit/fit_problem.h"
#include "telenano/nve_server/fit/fit_search.h"

namespace telenano::fit {
namespace {

constexpr double kQuantile = 3.841458820694124;  // χ² of one degree of freedom, 95 %
constexpr double kLeastHumidity = 1.0;           // %
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

CurveFit fit_with_its_leaps(const PreparedCurve& curve, const FitSetup& setup, double& cost) {
  CurveFit fit;
  fit.error = curve.error;
  if (!fit.error.empty()) return fit;
  FitProblem problem(curve, setup);
  const ParameterLayout& at = problem.at();
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
  FitSearch search(problem, bounds);

  Found best;
  std::vector<double> ends;
  for (const Start& start : starts_of(curve, setup, at.work >= 0)) {
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
    const Found found = search.descend(p, 40);
    ++fit.starts;
    if (!found.good) continue;
    ends.push_back(found.cost);
    if (found.cost < best.cost) best = found;
  }
  if (!best.good) {
    fit.error =
        "cannot be fitted: tip and lever have no balance from any start; check the tip radius, the stiffness "
        "and the law of the scene";
    return fit;
  }
  // Both move steps of the curve, to which no slope leads from afar. Where the lever leaps over what tells them,
  // several valleys are as good as the best: an interval holds all of them.
  std::vector<Found> modes;
  if (at.humidity >= 0 || at.film >= 0) {
    const Vector from = best.p;
    for (const double humidity : {0.0, 25.0, 45.0, 65.0, 85.0}) {
      if (humidity > 0 && at.humidity < 0) continue;
      for (const double film_nm : {0.0, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0}) {
        if (film_nm > 0 && at.film < 0) continue;
        Vector p = from;
        if (humidity > 0) p[at.humidity] = det_log(humidity);
        if (film_nm > 0) p[at.film] = det_log(film_nm);
        Found found = search.descend(p, 5);
        ++fit.starts;
        if (!found.good || found.cost > 40.0 * best.cost) continue;
        found = search.descend(found.p, 40);
        modes.push_back(found);
        if (found.cost < best.cost) best = found;
      }
    }
  }
  best = search.descend(best.p, 40);
  // Each point that passes a leap makes a small step of the cost, before which a descent may stop.
  const bool steps = at.humidity >= 0 || at.film >= 0;
  for (int i = 0; steps && i < at.laws; ++i) {
    for (const double way : {-0.01, 0.01}) {
      Vector p = best.p;
      p[i] += way;
      const Found found = search.descend(p, 40);
      if (found.good && found.cost < best.cost) best = found;
    }
  }
  for (const double end : ends) fit.starts_agree += end <= 1.01 * best.cost + 0.1 ? 1 : 0;

  search.evaluate(best.p, cost);
  const std::vector<char> used = search.used();
  const Vector residual = search.residual();
  Matrix j;
  search.jacobian(best.p, used, residual, j);
  double sum = 0;
  double count = 0;
  double lagged = 0;
  double squares = 0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const double e = std::clamp(residual[i], -kHuber, kHuber);
    sum += e * e;
    count += used[static_cast<std::size_t>(i)] != 0 ? 1 : 0;
    squares += e * e;
    if (i > 0) lagged += e * std::clamp(residual[i - 1], -kHuber, kHuber);
  }
  fit.reduced = sum / std::max(count - at.count, 1.0);
  fit.left_correlation = squares > 0 ? lagged / squares : 0;
  const Vector weight = weights_of(residual);
  const Matrix normal = j.transpose() * weight.asDiagonal() * j;
  // By columns of equal size: nm, logarithms and a tilt stand side by side.
  const Vector scale = normal.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Matrix inverse = pseudo_inverse(scaled);
  const Matrix covariance = scale.asDiagonal() * inverse * scale.asDiagonal();

  // What an error of a calibration does: the fit moves by −(JᵀWJ)⁻¹ JᵀW ∂r.
  const auto moved = [&](const Vector& change) -> Vector {
    return -covariance * (j.transpose() * weight.cwiseProduct(change));
  };
  const auto by_setup = [&](const FitSetup& other) -> Vector {
    FitProblem again(curve, other);
    Vector r;
    if (!again.residuals(best.p, used, r)) return Vector::Zero(at.count);
    return moved((r - residual) / kLogStep);
  };
  FitSetup stiffer = setup;
  stiffer.compliance_nm_nn /= 1.0 + kLogStep;
  FitSetup wider = setup;
  wider.radius_nm *= 1.0 + kLogStep;
  const Vector by_stiffness = by_setup(stiffer);
  const Vector by_radius = by_setup(wider);
  std::vector<double> bent[2] = {curve.approach.deflection_nm, curve.retract.deflection_nm};
  for (std::size_t segment = 0; segment < 2; ++segment)
    for (double& d : bent[segment]) d -= curve.offset_nm[segment];
  Vector larger;
  problem.whiten(bent[0], bent[1], used, larger);
  const Vector by_invols = moved(larger);

  const double rise = 0.5 * kQuantile * std::max(fit.reduced, 1.0);
  const std::vector<Found> valleys = apart(modes, best, at.laws, rise);
  const auto estimate = [&](int i, const char* name, const char* unit, double to_unit) {
    if (i < 0) return;
    Estimate e;
    e.name = name;
    e.unit = unit;
    e.value = to_unit * det_exp(best.p[i]);
    const double error = std::sqrt(std::max(covariance(i, i), 0.0) * std::max(fit.reduced, 1.0));
    std::optional<double> low = profile_end(search, best, i, -1.0, error, rise);
    std::optional<double> high = profile_end(search, best, i, 1.0, error, rise);
    // So may a profile: to the one side it ends no nearer than to the other, if the curvature says so, too.
    if (steps && low && high) {
      const double wide = std::min(1.96 * error, std::max(best.p[i] - *low, *high - best.p[i]));
      low = std::min(*low, best.p[i] - wide);
      high = std::max(*high, best.p[i] + wide);
    }
    for (const Found& valley : valleys) {
      const double left = rise - (valley.cost - best.cost);
      if (low && valley.p[i] < *low) low = profile_end(search, valley, i, -1.0, error, left);
      if (high && valley.p[i] > *high) high = profile_end(search, valley, i, 1.0, error, left);
    }
    if (low) e.low = to_unit * det_exp(*low);
    if (high) e.high = to_unit * det_exp(*high);
    e.sensitivity_stiffness = by_stiffness[i];
    e.sensitivity_invols = by_invols[i];
    e.sensitivity_radius = at.radius < 0 ? by_radius[i] : 0.0;
    // The lever's own error is independent of the curve's noise: their squares add.
    const double of_lever = 1.96 * std::abs(e.sensitivity_stiffness) * setup.stiffness_error;
    const auto widened = [&](std::optional<double>& end) {
      if (!end || !(of_lever > 0)) return;
      const double way = *end < e.value ? -1.0 : 1.0;
      end = e.value * det_exp(way * std::hypot(det_log(*end / e.value), of_lever));
    };
    widened(e.low);
    widened(e.high);
    fit.estimates.push_back(e);
  };
  estimate(at.modulus, "E", "GPa", 1.0);
  estimate(at.work, "w", "mJ/m2", 1e3);
  estimate(at.radius, "R", "nm", 1.0);
  estimate(at.distance, "z0", "nm", 1.0);
  estimate(at.hamaker, "H", "aJ", 1.0);
  estimate(at.humidity, "humidity", "%", 1.0);
  estimate(at.film, "film", "nm", 1.0);
  std::vector<int> shown{at.modulus};
  for (const int i : {at.work, at.radius, at.distance, at.hamaker, at.humidity, at.film})
    if (i >= 0) shown.push_back(i);
  for (const int a : shown) {
    std::vector<double> row;
    for (const int b : shown) {
      const double product = std::sqrt(covariance(a, a) * covariance(b, b));
      row.push_back(product > 0 ? covariance(a, b) / product : 0.0);
    }
    fit.correlation.push_back(row);
  }

  bool mixed = false;
  for (const Estimate& e : fit.estimates) mixed = mixed || !e.low || !e.high;
  for (std::size_t a = 0; a < shown.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) mixed = mixed || std::abs(fit.correlation[a][b]) > 0.9;
  if (mixed && shown.size() > 1) {
    const std::string known = best_known(normal, shown, fit.estimates, fit.reduced);
    if (!known.empty())
      fit.notes.push_back("the values are known less well one by one than together: the combination " +
                          known);
  }

  const physics::TipSampleParameters law = problem.law(best.p);
  fit.modulus_gpa = det_exp(best.p[at.modulus]);
  fit.radius_nm = problem.radius_nm(best.p);
  fit.contact_modulus_gpa = law.contact_modulus_gpa;
  fit.distance_nm = law.equilibrium_distance_nm;
  fit.humidity_percent = law.long_range.capillary.humidity_percent;
  fit.film_nm = law.long_range.capillary.film_nm;
  if (at.work >= 0) {
    fit.work_n_m = law.work_of_adhesion_n_m;
    fit.lambda = physics::TipSampleLaw(law).lambda(fit.radius_nm);
    // nm²·N/m = 1e-18 J = aJ
    if (law.van_der_waals) fit.hamaker_aj = 12.0 * kPi * fit.distance_nm * fit.distance_nm * fit.work_n_m;
  }
  fit.touch_z_nm = best.p[at.touch];
  fit.shift_nm = at.shift < 0 ? 0.0 : best.p[at.shift];
  fit.noise_nm = curve.noise_nm;
  double misfit = 0;
  double points = 0;
  std::size_t row = 0;
  for (const bool approach : {true, false}) {
    FitSegment& segment = approach ? fit.approach : fit.retract;
    const std::vector<double>& d = (approach ? curve.approach : curve.retract).deflection_nm;
    problem.model_nm(best.p, approach, segment.model_nm);
    for (std::size_t i = 0; i < d.size(); ++i, ++row) {
      segment.residual_nm.push_back(d[i] - segment.model_nm[i]);
      segment.used.push_back(used[row]);
      if (used[row] == 0) continue;
      misfit += segment.residual_nm.back() * segment.residual_nm.back();
      points += 1;
    }
  }
  fit.rms_nm = std::sqrt(misfit / std::max(points, 1.0));
  fit.evaluations = problem.evaluations();
  say_what_is_not_known(fit, curve, setup);
  return fit;
}

}  // namespace

CurveFit fit_curve(const PreparedCurve& curve, const FitSetup& setup) {
  double cost = 1e300;
  CurveFit fit = fit_with_its_leaps(curve, setup, cost);
  if (!curve.approach.step) return fit;
  // What looked like the bridge's step may be a bend of the curve.
  PreparedCurve smooth = curve;
  smooth.approach.step.reset();
  double without = 1e300;
  CurveFit other = fit_with_its_leaps(smooth, setup, without);
  return other.error.empty() && without < cost ? other : fit;
}

}  // namespace telenano::fit
