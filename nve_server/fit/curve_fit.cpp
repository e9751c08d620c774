#include "telenano/nve_server/fit/curve_fit.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/fit/fit_minimum.h"
#include "telenano/nve_server/fit/fit_notes.h"
#include "telenano/nve_server/fit/fit_problem.h"
#include "telenano/nve_server/fit/fit_search.h"
#include "telenano/nve_server/fit/fit_uncertainty.h"

namespace telenano::fit {
namespace {

/// Values, intervals and correlations, and which combination is known where the values are not.
void add_estimates(CurveFit& fit, const ParameterLayout& at, FitUncertainty& known) {
  std::vector<int> shown;
  const auto add = [&](int i, const char* name, const char* unit, double to_unit) {
    if (i < 0) return;
    fit.estimates.push_back(known.estimate(i, name, unit, to_unit));
    shown.push_back(i);
  };
  add(at.modulus, "E", "GPa", 1.0);
  add(at.work, "w", "mJ/m2", 1e3);
  add(at.radius, "R", "nm", 1.0);
  add(at.distance, "z0", "nm", 1.0);
  add(at.hamaker, "H", "aJ", 1.0);
  add(at.humidity, "humidity", "%", 1.0);
  add(at.film, "film", "nm", 1.0);
  fit.correlation = known.correlation(shown);

  bool mixed = false;
  for (const Estimate& e : fit.estimates) mixed = mixed || !e.low || !e.high;
  for (std::size_t a = 0; a < shown.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) mixed = mixed || std::abs(fit.correlation[a][b]) > 0.9;
  if (!mixed || shown.size() < 2) return;
  const std::string combination = best_known(known.normal(), shown, fit.estimates, fit.reduced);
  if (!combination.empty())
    fit.notes.push_back("the values are known less well one by one than together: the combination " +
                        combination);
}

void add_law(CurveFit& fit, const FitProblem& problem, const Vector& p) {
  const ParameterLayout& at = problem.at();
  const physics::TipSampleParameters law = problem.law(p);
  fit.modulus_gpa = det_exp(p[at.modulus]);
  fit.radius_nm = problem.radius_nm(p);
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
  fit.touch_z_nm = p[at.touch];
  fit.shift_nm = at.shift < 0 ? 0.0 : p[at.shift];
}

void add_segments(CurveFit& fit, FitProblem& problem, const Vector& p, const PreparedCurve& curve,
                  const std::vector<char>& used) {
  double misfit = 0;
  double points = 0;
  std::size_t row = 0;
  for (const bool approach : {true, false}) {
    FitSegment& segment = approach ? fit.approach : fit.retract;
    const std::vector<double>& d = (approach ? curve.approach : curve.retract).deflection_nm;
    problem.model_nm(p, approach, segment.model_nm);
    for (std::size_t i = 0; i < d.size(); ++i, ++row) {
      segment.residual_nm.push_back(d[i] - segment.model_nm[i]);
      segment.used.push_back(used[row]);
      if (used[row] == 0) continue;
      misfit += segment.residual_nm.back() * segment.residual_nm.back();
      points += 1;
    }
  }
  fit.rms_nm = std::sqrt(misfit / std::max(points, 1.0));
}

/// `cost`: at the end of the search.
CurveFit fit_with_its_leaps(const PreparedCurve& curve, const FitSetup& setup, double& cost) {
  CurveFit fit;
  fit.error = curve.error;
  if (!fit.error.empty()) return fit;
  FitProblem problem(curve, setup);
  const ParameterLayout& at = problem.at();
  FitSearch search(problem, bounds_of(at, setup));
  const Minimum minimum = find_minimum(search, at, curve, setup);
  fit.starts = minimum.starts;
  fit.starts_agree = minimum.starts_agree;
  if (!minimum.best.good) {
    fit.error =
        "cannot be fitted: tip and lever have no equilibrium from any start; check the tip radius, the "
        "stiffness and the law of the scene";
    return fit;
  }
  FitUncertainty known(curve, setup, problem, search, minimum);
  cost = known.cost();
  fit.reduced = known.reduced();
  fit.left_correlation = known.left_correlation();
  add_estimates(fit, at, known);
  add_law(fit, problem, minimum.best.p);
  fit.noise_nm = curve.noise_nm;
  add_segments(fit, problem, minimum.best.p, curve, known.used());
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
