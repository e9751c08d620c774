#include "telenano/nve_server/fit/fit_notes.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>

#include "telenano/nve_server/fit/decompositions.h"

namespace telenano::fit {
namespace {

std::string number(double value, int digits = 3) {
  std::ostringstream text;
  text.precision(digits);
  text << value;
  return text.str();
}

/// What a polynomial of degree 8 through the contact of each way leaves, with no physics in it: rms, 0 where there are
/// too few points. A smooth law that leaves less does not exist, whatever its parameters.
double smooth_floor_nm(const PreparedCurve& curve) {
  constexpr Eigen::Index kTerms = 9;
  double squares = 0;
  double freedom = 0;
  for (const PreparedSegment* segment : {&curve.approach, &curve.retract}) {
    const bool in = segment == &curve.approach;
    const std::size_t n = segment->z_nm.size();
    std::size_t begin = 0;
    std::size_t end = n;
    if (segment->leap) {
      (in ? begin : end) = in ? segment->leap->after : segment->leap->before + 1;
    } else {
      while (in && begin < n && segment->z_nm[begin] > curve.touch_z_nm) ++begin;
      while (!in && end > 0 && segment->z_nm[end - 1] > curve.touch_z_nm) --end;
    }
    if (end < begin + 40) continue;
    const auto [low, high] = std::minmax_element(segment->z_nm.begin() + static_cast<std::ptrdiff_t>(begin),
                                                 segment->z_nm.begin() + static_cast<std::ptrdiff_t>(end));
    const double middle = 0.5 * (*low + *high);
    const double half = std::max(0.5 * (*high - *low), 1e-9);
    const auto points = static_cast<Eigen::Index>(end - begin);
    Matrix design(points, kTerms);
    Vector measured(points);
    for (Eigen::Index i = 0; i < points; ++i) {
      const std::size_t at = begin + static_cast<std::size_t>(i);
      const double t = (segment->z_nm[at] - middle) / half;
      // Chebyshev's, by their recursion.
      design(i, 0) = 1;
      design(i, 1) = t;
      for (Eigen::Index k = 2; k < kTerms; ++k) design(i, k) = 2 * t * design(i, k - 1) - design(i, k - 2);
      measured[i] = segment->deflection_nm[at];
    }
    const Vector left = measured - design * solve_of_any_rank(design, measured);
    squares += left.squaredNorm();
    freedom += static_cast<double>(points - kTerms);
  }
  return freedom > 0 ? std::sqrt(squares / freedom) : 0;
}

}  // namespace

std::string best_known(const Matrix& normal, const std::vector<int>& shown,
                       const std::vector<Estimate>& names, double reduced) {
  const auto n = static_cast<Eigen::Index>(shown.size());
  std::vector<Eigen::Index> rest;
  for (Eigen::Index i = 0; i < normal.rows(); ++i)
    if (std::find(shown.begin(), shown.end(), static_cast<int>(i)) == shown.end()) rest.push_back(i);
  const auto m = static_cast<Eigen::Index>(rest.size());
  Matrix own(n, n);
  Matrix with(m, n);
  Matrix theirs(m, m);
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b < n; ++b)
      own(a, b) = normal(shown[static_cast<std::size_t>(a)], shown[static_cast<std::size_t>(b)]);
    for (Eigen::Index b = 0; b < m; ++b)
      with(b, a) = normal(rest[static_cast<std::size_t>(b)], shown[static_cast<std::size_t>(a)]);
  }
  for (Eigen::Index a = 0; a < m; ++a)
    for (Eigen::Index b = 0; b < m; ++b)
      theirs(a, b) = normal(rest[static_cast<std::size_t>(a)], rest[static_cast<std::size_t>(b)]);
  const Vector scale = theirs.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * theirs * scale.asDiagonal();
  const Matrix left = scale.asDiagonal() * with;
  const Matrix information = own - left.transpose() * solve_of_any_rank(scaled, left);
  const std::optional<EigenPair> best = greatest_eigen_pair(information);
  if (!best || !(best->value > 0)) return {};
  Vector direction = best->direction;
  Eigen::Index largest = 0;
  direction.cwiseAbs().maxCoeff(&largest);
  const double factor = direction[largest];
  direction /= factor;
  const double error = std::sqrt(std::max(reduced, 1.0) / best->value) / std::abs(factor);
  std::string text;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (std::abs(direction[i]) < 0.02) continue;
    text += (text.empty() ? "" : " ") + names[static_cast<std::size_t>(i)].name;
    if (i != largest) text += "^" + number(direction[i], 2);
  }
  return text + " is known to +- " + number(196.0 * error, 2) + " %";
}

void say_what_is_not_known(CurveFit& fit, const PreparedCurve& curve, const FitSetup& setup) {
  const auto say = [&](const std::string& text) { fit.notes.push_back(text); };
  say("k, K, w and the Hamaker constant scale together: no quasi-static curve determines the lever's "
      "stiffness, and an error in it changes all of them");
  if (setup.law.model == physics::ContactLaw::kHertz || setup.law.model == physics::ContactLaw::kDmt)
    say("with this law the curve determines only K times the root of R: an error in R changes E");
  for (const Estimate& e : fit.estimates) {
    if (!e.low || !e.high) {
      say(e.name + " is open " +
          (!e.low && !e.high ? "to both sides"
           : e.low           ? "upwards"
                             : "downwards") +
          ": the curve does not bound it");
    }
    if (e.name == "E" && (e.value < 1.01 * setup.modulus_min_gpa || e.value > 0.99 * setup.modulus_max_gpa)) {
      say("E is at the end of the range that a scene accepts (" + number(setup.modulus_min_gpa) + " to " +
          number(setup.modulus_max_gpa) + " GPa): check the tip's radius");
    }
    if (e.name == "E" && std::abs(e.sensitivity_invols) > 5) {
      say("E and the deflection sensitivity can hardly be separated on such a stiff sample: 1 % of InvOLS "
          "changes E by " +
          number(std::abs(e.sensitivity_invols)) + " %");
    }
    if (e.name == "R" && fit.lambda > 0 && !(fit.lambda >= 0.1 && fit.lambda <= 5.0)) {
      say("R can be separated from K and w only for lambda 0.1 to 5, and here lambda = " +
          number(fit.lambda) + ": give R with --tip-radius-nm");
    }
  }
  if (setup.stiffness_error > 0) {
    say("the intervals include the uncertainty of the lever's stiffness, " +
        number(100 * setup.stiffness_error) + " % (standard deviation)");
  }
  for (const Estimate& e : fit.estimates) {
    if (e.name != "H" || (e.low && e.high)) continue;
    say("H follows from the attraction before contact: a snap-in or noise hides it");
  }
  for (const Estimate& e : fit.estimates) {
    if ((e.name != "humidity" && e.name != "film") || (e.low && e.high)) continue;
    say(e.name + " follows from " +
        (e.name == "film" ? "where the bridge forms on the way in"
                          : "how far the bridge reaches on the way out") +
        ": a lever that jumps there hides it");
  }
  if (curve.deepest_slope > 1.02) {
    say("the deflection grows faster than the base goes down (slope " + number(curve.deepest_slope, 4) +
        "): the deflection's sensitivity is wrong");
  }
  if (setup.law.model != physics::ContactLaw::kHertz && !curve.retract.leap && !curve.approach.leap)
    say("no jump in either direction: w follows from the shape of the contact alone");
  if (fit.rms_nm > 1.2 * fit.noise_nm) {
    say("residuals are " + number(fit.rms_nm / fit.noise_nm) +
        " times the free part's noise: the model or the calibration misses something, and the intervals do "
        "not include it");
    const double floor_nm = smooth_floor_nm(curve);
    if (floor_nm > 1.5 * fit.noise_nm) {
      say("in contact even a polynomial of degree 8 through each direction leaves " +
          number(floor_nm / fit.noise_nm) +
          " times that noise: the measurement itself is noisier there, and no smooth law can fit better");
    }
  }
  if (std::abs(fit.left_correlation) > 0.2)
    say("residuals are still correlated after the noise's own correlation is taken out (" +
        number(fit.left_correlation, 2) + ")");
}

}  // namespace telenano::fit
