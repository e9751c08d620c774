#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/numbers.h"
#include "telenano/nve_server/physics/numerics/sign_change.h"

namespace telenano::physics {
namespace {

constexpr double kGuessDone = 0.02;
constexpr double kTowardsOnset = 0.5;  // u below which the curve goes by sqrt(u)
constexpr double kHardlyBent = 1e-3;   // the root's series leaves out 1e-12 of the step
constexpr double kBent = 0.15;         // below, one parabola is nearly as good as the other
constexpr double kNearFold = 0.3;      // bent so much, half way to where the parabola ends
constexpr double kSmallStep = 1e-3;    // of u: where the law is its Taylor series
constexpr double kHalfPi = 1.57079632679489655800;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// atan on [0, 1]: nearest eighth by the addition theorem, then Taylor, |t| <= 1/16; the first term left out
/// is 2e-18.
double atan_to_one(double x) noexcept {
  static constexpr std::array<double, 9> kAtanEighths = {0.0,
                                                         0.12435499454676144,
                                                         0.24497866312686414,
                                                         0.35877067027057222,
                                                         0.46364760900080609,
                                                         0.55859931534356244,
                                                         0.64350110879328437,
                                                         0.71882999962162453,
                                                         0.78539816339744828};
  if (!(x >= 0 && x <= 1)) return std::numeric_limits<double>::quiet_NaN();
  const int i = static_cast<int>(8.0 * x + 0.5);
  const double centre = 0.125 * i;
  const double t = (x - centre) / (1.0 + x * centre);
  const double y = t * t;
  const double y2 = y * y;
  const double p =
      (-1.0 / 3 + y * (1.0 / 5)) + y2 * ((-1.0 / 7 + y * (1.0 / 9)) + y2 * (-1.0 / 11 + y * (1.0 / 13)));
  return kAtanEighths[static_cast<std::size_t>(i)] + (t + t * y * p);
}

/// What the contact formulas share at one u. With T = tan theta = 1/sqrt(u), atan(T)/T = 1 - T^2/3 + e2 T^4:
/// all that cancels at small theta (large lambda, deep contact) is kept in e2, from its series below T = 0.2.
struct Angle {
  double theta, sin, cos;
  double f1, f2;
  bool small;
  double t2, w, e, e2;  // small only: T^2, sqrt(1 + T^2), 1 - theta/T, e2
};

Angle angle_of(double u) noexcept {
  Angle g{};
  g.small = u >= 25.0;
  if (g.small) {
    const double y = 1.0 / u;
    const double t = std::sqrt(y);
    const double y2 = y * y;
    const double y4 = y2 * y2;
    // sum (-y)^k/(2k+5); y <= 0.04 and twelve terms leave out less than 1e-17 of it.
    g.e2 = ((1.0 / 5 - y * (1.0 / 7)) + y2 * (1.0 / 9 - y * (1.0 / 11))) +
           y4 * (((1.0 / 13 - y * (1.0 / 15)) + y2 * (1.0 / 17 - y * (1.0 / 19))) +
                 y4 * ((1.0 / 21 - y * (1.0 / 23)) + y2 * (1.0 / 25 - y * (1.0 / 27))));
    g.e = y * (1.0 / 3 - y * g.e2);
    g.t2 = y;
    g.w = std::sqrt(1.0 + y);
    g.theta = t * (1.0 - g.e);
    g.cos = 1.0 / g.w;
    g.sin = t * g.cos;
    g.f1 = t * (y + g.e * (1.0 - y)) * (g.cos * g.cos);
    g.f2 = y * g.cos * ((1.0 - g.e) - 1.0 / (1.0 + g.w));
  } else {
    const double root = std::sqrt(u);
    g.sin = 1.0 / std::sqrt(1.0 + u);
    g.cos = root * g.sin;
    g.theta = u > 1.0 ? atan_to_one(1.0 / root) : kHalfPi - atan_to_one(root);
    g.f1 = g.sin * g.cos - g.theta * (g.cos * g.cos - g.sin * g.sin);
    g.f2 = g.sin * (g.theta - g.sin / (1.0 + g.cos));
  }
  return g;
}

/// State and rates at u, without the energy; the bends, too, if asked for. With dC/dtheta = cos G (G =
/// slope_c), dA/dtheta = A1 = cos^2 G - C sin (slope_a), dDelta/dtheta = cos Q, dP/dtheta = cos S:
///   G' = G/theta + cos H,  H = -(G/r) dr/(cos dtheta) - (lambda theta/r) (G (2 C sin + 4/3 lambda) + 2 C (G
///   sin + C)), A1' = cos A2,  A2 = cos G' - 3 sin G - C, Q' = 2 cos (G A1 + C A2 - 4/3 lambda G) - 4/3
///   lambda sin G', S' = 3 (C A1^2 + A cos (G A1 + C A2)) - 2 lambda (cos G (G arc + A) + C (G' arc + 2 cos^2
///   G + A1)),
/// and d/du = -(sin^3/2)/cos d/dtheta once more: the bends go like 1/cos to the onset.
template <bool kBends>
void state_at(double lambda, double u, const Angle& g, CurvePoint& p) noexcept {
  const double third = (4.0 / 3.0) * lambda;
  const double b = third * lambda * g.f2;
  const double r = std::sqrt(b * b + 2.0 * lambda * g.f1);
  const double c = 2.0 / (b + r);
  const double per_r = 1.0 / r;
  const double a = c * g.cos;
  const double cs = c * g.sin;
  const double arc = g.theta + g.sin * g.cos;
  const double lc = lambda * c;
  p.contact = true;
  p.parameter = u;
  p.angle = g.theta;
  p.outer_radius = c;
  p.contact_radius = a;
  p.load = a * a * a - lc * c * arc;
  p.overlap = a * a - third * cs;
  // dC/dtheta = cos(theta) G; every rate has the same factor, so that d/du = -(sin^3/2) (d/dtheta)/cos stays
  // finite at the onset.
  const double reach = 2.0 * cs + third;
  const double slope_c_per_theta = -lc * reach * per_r;
  const double slope_c = g.theta * slope_c_per_theta;
  const double slope_a = g.cos * g.cos * slope_c - cs;
  const double sin_sq = g.sin * g.sin;
  const double factor = -0.5 * sin_sq * g.sin;
  const double slope_cs = slope_c * g.sin + c;
  const double slope_arc = slope_c * arc + a;
  const double ca = c * slope_a;
  const double q = 2.0 * ca - third * slope_cs;
  const double s = 3.0 * a * ca - 2.0 * lc * slope_arc;
  p.overlap_rate = factor * q;
  p.load_rate = factor * s;
  const double secant = 1.0 / g.cos;
  const double per_cos = factor * secant;  // dtheta/du
  p.contact_radius_rate = per_cos * slope_a;
  if constexpr (kBends) {
    const double h = -lambda * g.theta * per_r *
                     (slope_c * (reach + per_r * (b * third + 4.0 * g.sin)) + 2.0 * c * slope_cs);
    const double bend_c = g.cos * h + slope_c_per_theta;
    const double bend_a = g.cos * bend_c - 3.0 * g.sin * slope_c - c;
    const double both = slope_c * slope_a + c * bend_a;
    const double q_rate = 2.0 * g.cos * (both - third * slope_c) - third * g.sin * bend_c;
    const double s_rate = 3.0 * (ca * slope_a + a * g.cos * both) -
                          2.0 * (lambda * g.cos * slope_c * slope_arc +
                                 lc * (bend_c * arc + 2.0 * g.cos * g.cos * slope_c + slope_a));
    const double own = -1.5 * sin_sq * factor;  // of the factor
    const double other = per_cos * factor;
    p.overlap_bend = own * q + other * q_rate;
    p.load_bend = own * s + other * s_rate;
    p.angle_rate = per_cos;
    p.angle_bend = -per_cos * sin_sq * (1.0 + 0.5 * secant * secant);
    // At constant theta, from (lambda/2) F1 C^2 + b C = 1.
    const double c_by_lambda = -(1.0 + b * c) * per_r;
    p.overlap_by_lambda = 2.0 * a * g.cos * c_by_lambda - third * g.sin * (c + c_by_lambda);
    p.contact_radius_by_lambda = g.cos * c_by_lambda;
    p.load_by_lambda = 3.0 * a * a * g.cos * c_by_lambda - lc * arc * (c + 2.0 * c_by_lambda);
  }
}

/// Elastic energy E* int_0^c g^2 dt of g(t) = delta - t^2/R inside a and -(2 sigma0/E*) sqrt(c^2 - t^2) in
/// the annulus, less the surface energy w pi c^2, plus sigma0 times the volume of the gap in the annulus:
///   U = (2/5) A^5 - A^3 D + (3/4) A D^2 - C^2 + (4/3) lambda^2 C^3 x^2 (1 - x/3) + (lambda/2) C^3 (C v1 +
///   lambda v2), D = (4/3) lambda C sin, x = 1 - cos, v1 = sin cos/2 + cos^3 sin - theta (2 cos^2 - 1/2), v2
///   = (8/3) (theta sin + cos + cos^3/3 - 4/3).
/// The integrals are elementary; their terms of order 1 cancel by hand to v1 = (8/15) theta^5 + ..., v2 =
/// (4/9) theta^4
/// + ..., which are evaluated from e2 for small theta, so that nothing is lost at large lambda.
double contact_energy(double lambda, const CurvePoint& p, const Angle& g) noexcept {
  const double k = g.cos;
  const double k2 = k * k;
  double x = 0, v1 = 0, v2 = 0;
  if (g.small) {
    const double y = g.t2;
    const double t = std::sqrt(y);
    const double w1 = 1.0 / (1.0 + g.w);
    x = y * k * w1;
    v1 = 0.5 * t * y * y * ((5.0 / 3 - y / 3) - g.e2 * (3.0 + y * (2.0 - y))) * (k2 * k2);
    v2 = (8.0 / 3.0) * (y * k * (y * w1 * w1 - g.e) + x * x * (1.0 - x / 3.0));
  } else {
    x = g.sin * g.sin / (1.0 + k);
    v1 = g.sin * k * (0.5 + k2) - g.theta * (2.0 * k2 - 0.5);
    v2 = (8.0 / 3.0) * (g.theta * g.sin - x * (2.0 - x * (1.0 - x / 3.0)));
  }
  const double a = p.contact_radius;
  const double c = p.outer_radius;
  const double d = (4.0 / 3.0) * lambda * c * g.sin;
  const double c3 = c * c * c;
  return a * (a * a * (0.4 * a * a - d) + 0.75 * d * d) - c * c +
         lambda * c3 * ((4.0 / 3.0) * lambda * x * x * (1.0 - x / 3.0) + 0.5 * (c * v1 + lambda * v2));
}

/// d > 0 of d^2 (w + d) = k, w >= 0 and k > 0: Newton's method from above, where it is monotone.
double root_of_cubic(double w, double k) noexcept {
  double d = k < w * w * w ? std::sqrt(k / w) : det_cbrt(k);
  for (int i = 0; i < 3; ++i) d -= (d * (w + d) * d - k) / (d * (2.0 * w + 3.0 * d));
  return d;
}

/// Towards the onset Z is not a parabola in u but z0 + B t^2 + C t^3, t = sqrt(u): the parameter where that
/// of a point with this rate and bend falls by `residual`. B and C follow from Z' = B + 3/2 C t, Z'' = 3/4
/// C/t; C > 0. About its minimum t0 (= -2 B/3 C, or 0) it is min + C d^2 (w + d), w = 3/2 t0 (or B/C).
/// Negative: the minimum is higher.
double root_towards_onset(double u, double residual, double rate, double bend) noexcept {
  const double t = std::sqrt(u);
  const double c = (4.0 / 3.0) * t * bend;
  const double w = rate / c - 1.5 * t;  // B/C
  const double least = w < 0 ? -(2.0 / 3.0) * w : 0.0;
  const double from = t - least;
  const double width = std::fabs(w);
  const double k = from * from * (width + from) - residual / c;
  if (!(k > 0)) return -1;
  const double root = least + root_of_cubic(width, k);
  return root * root;
}

}  // namespace

MaugisDugdale::MaugisDugdale(double lambda) noexcept
    : lambda_(lambda), h0_(2.0 / (kPi * lambda)), q_((8.0 / (3.0 * kPi)) * lambda) {
  const double b = (4.0 / 3.0) * (kHalfPi - 1.0) * lambda * lambda;
  onset_radius_ = 2.0 / (b + std::sqrt(b * b + kPi * lambda));
}

double MaugisDugdale::onset_load() const noexcept {
  return -kHalfPi * lambda_ * onset_radius_ * onset_radius_;
}

CurvePoint MaugisDugdale::noncontact(double outer_radius) const noexcept {
  const double c = outer_radius;
  CurvePoint p;
  p.parameter = c - onset_radius_;
  p.angle = kHalfPi;
  p.outer_radius = c;
  p.overlap = c * (0.5 * c - q_) - h0_;
  p.load = -kHalfPi * lambda_ * c * c;
  p.overlap_rate = c - q_;
  p.load_rate = -kPi * lambda_ * c;
  p.overlap_by_lambda = h0_ - q_ * c;
  p.load_by_lambda = p.load;
  p.energy = -kHalfPi * lambda_ * c * c * c * (0.25 * c - q_ / 3.0);
  return p;
}

CurvePoint MaugisDugdale::contact(double u) const noexcept {
  const Angle g = angle_of(u);
  CurvePoint p;
  state_at<true>(lambda_, u, g, p);
  p.energy = contact_energy(lambda_, p, g);
  return p;
}

double MaugisDugdale::radius_moment(const CurvePoint& p) const noexcept {
  // Before contact lambda C^2 = -2P/pi, theta = pi/2.
  if (!p.contact) return -p.load * p.load / (2.0 * kPi * lambda_);
  const double u = p.parameter;
  const double a = p.contact_radius;
  const double per = 1.0 / (1.0 + u);
  const double sin_cos = std::sqrt(u) * per;
  const double a3 = a * a * a;
  // lambda C^2 from P towards the onset, from A far from it: where nothing cancels.
  const double lc2 = u < 1.0 ? (a3 - p.load) / (p.angle + sin_cos) : lambda_ * a * a * (1.0 + 1.0 / u);
  const double annulus = p.angle - sin_cos * ((u - 1.0) * per);
  return a3 * (0.5 * p.overlap - 0.3 * a * a) - 0.25 * lc2 * (lc2 / lambda_) * annulus;
}

double MaugisDugdale::fold_radius_rate(const CurvePoint& p) const noexcept {
  if (!p.contact) return -0.5 * q_ * q_;  // Delta = -q^2/2 - H0
  const Angle g = angle_of(p.parameter);
  const double third = (4.0 / 3.0) * lambda_;
  const double c = p.outer_radius;
  const double b = third * lambda_ * g.f2;
  const double slope = -(1.0 + b * c) / (lambda_ * g.f1 * c + b);
  const double rate = 2.0 * c * g.cos * g.cos * slope - third * g.sin * (c + slope);
  return (p.overlap + rate) / 3.0;
}

bool MaugisDugdale::fold_before_contact(const Held& held, double* outer_radius) const noexcept {
  // dZ/dC = overlap (C - q) - load pi lambda C
  const double e = held.overlap - kPi * lambda_ * held.load;
  if (!(e > 0)) return false;
  *outer_radius = held.overlap * q_ / e;
  return *outer_radius < onset_radius_;
}

/// The parameter u of the fold of overlap where it lies in contact, lambda > lambda* (0.938).
/// With w^2 = 1 - lambda*/lambda, g = sqrt(u)/(lambda w^2) is a smooth function on [0, 1], from the onset at
/// lambda* to JKR. Cubics through four of its values at a time are within 3e-6; Delta is stationary there, so
/// that this leaves 6e-16 of it.
class OverlapFolds {
 public:
  OverlapFolds() noexcept {
    for (int i = 0; i < kValues; ++i) {
      // The limits stand for themselves a little beside: g is even flatter there than the cubics are good.
      const double w = std::clamp(static_cast<double>(i) / kIntervals, 1e-3, 1.0 - 1e-9);
      const double lambda = kLeast / (1.0 - w * w);
      const double u = MaugisDugdale(lambda).search_fold({1.0, 0.0});
      g_[static_cast<std::size_t>(i)] = std::sqrt(u) / (lambda * w * w);
    }
  }

  double parameter(double lambda) const noexcept {
    const double w2 = 1.0 - kLeast / lambda;
    if (!(w2 > 0)) return 0;
    const double place = kIntervals * std::sqrt(w2);
    const int first = std::clamp(static_cast<int>(place) - 1, 0, kValues - 4);
    const double* y = &g_[static_cast<std::size_t>(first)];
    const double t = place - (first + 1);
    const double up = t + 1.0, down = t - 1.0, far = t - 2.0;
    const double g =
        0.5 * (up * far * (down * y[1] - t * y[2])) + (1.0 / 6.0) * (t * down * (up * y[3] - far * y[0]));
    const double root = g * lambda * w2;
    return root * root;
  }

 private:
  static constexpr double kLeast = 0.9379474572107123;  // (9 pi/(16 (pi - 1)))^(1/3)
  static constexpr int kIntervals = 512;
  static constexpr int kValues = kIntervals + 1;
  std::array<double, kValues> g_{};
};

CurvePoint MaugisDugdale::fold(const Held& held) const noexcept {
  static const OverlapFolds overlap_folds;
  double c = 0;
  if (fold_before_contact(held, &c)) return noncontact(c);
  return contact(held.load == 0 ? overlap_folds.parameter(lambda_) : search_fold(held));
}

double MaugisDugdale::search_fold(const Held& held) const noexcept {
  const auto rate = [&](double u) {
    CurvePoint p;
    state_at<false>(lambda_, u, angle_of(u), p);
    return p.held_rate(held);
  };
  double lo = 0;
  double rate_lo = rate(lo);
  if (rate_lo >= 0) return 0;
  double hi = lambda_ * lambda_ + 0.01;  // JKR: 0.37 lambda^2 (overlap held) to 0.76 lambda^2 (load held)
  double rate_hi = rate(hi);
  for (int i = 0; i < 60 && !(rate_hi > 0); ++i) {
    lo = hi;
    rate_lo = rate_hi;
    hi *= 2;
    rate_hi = rate(hi);
  }
  // Z is stationary here, so that 1e-9 of u, less after the last step, is far below rounding.
  SignChange fold{lo, rate_lo, hi, rate_hi};
  double last = hi;
  for (int i = 0; i < 100; ++i) {
    const double u = fold.between();
    if (std::fabs(u - last) <= 1e-9 * u) return u;
    last = u;
    const double r = rate(u);
    if (r == 0) return u;
    fold.take(u, r);
  }
  return fold.positive;
}

CurveSolution MaugisDugdale::solve(double z, const Held& held, double guess) const noexcept {
  double fold_radius = 0;
  // Where contact begins overlap and load are negative.
  if (z < 0 && z <= held.overlap * onset_overlap() + held.load * onset_load() &&
      fold_before_contact(held, &fold_radius)) {
    const double e = held.overlap - kPi * lambda_ * held.load;
    const double p = held.overlap * q_;
    const double discriminant = p * p + 2.0 * e * (z + held.overlap * h0_);
    if (discriminant < 0) return {CurveStatus::kNoState, noncontact(fold_radius), 0};
    return {CurveStatus::kOk, noncontact(std::min((p + std::sqrt(discriminant)) / e, onset_radius_)), 0};
  }
  return solve_contact(z, held, guess);
}

double MaugisDugdale::cold_guess(double z, const Held& held) const noexcept {
  // A from the law between DMT and JKR (closed_form_laws.h: Schwarz), Delta ~ A^2 - k sqrt(A), P ~ A^3 - 3/2
  // k A^1.5 - 2 (1 - t), k^2 = 8/3 t, t = 0 for DMT and 1 for JKR; then C ~ A in the equation of the annulus,
  // whose terms alone would give u = 2/3 A lambda^2 and, of x = lambda A^2, pi/4 x for small and (2/3
  // x)^(2/3) for large x.
  const double steep = 4.0 * lambda_ * std::sqrt(lambda_);
  const double t = steep / (1.0 + steep);
  const double k = std::sqrt(8.0 / 3.0 * t);
  const double target = z + 2.0 * (1.0 - t) * held.load;
  const double least = 0.4 * t;  // a little outside of the folds, A = 0.55 (overlap) and 1.14 (load) for JKR
  double a =
      2.0 + (held.overlap > 0 ? std::sqrt(std::max(0.0, target) / held.overlap) : std::max(0.0, target));
  for (int i = 0; i < 8; ++i) {
    const double root = std::sqrt(a);
    const double value = held.overlap * (a * a - k * root) + held.load * a * (a * a - 1.5 * k * root);
    const double rate =
        held.overlap * (2.0 * a - 0.5 * k / root) + held.load * (3.0 * a * a - 2.25 * k * root);
    if (!(rate > 0)) break;
    const double before = a;
    a = std::max(a - (value - target) / rate, std::max(least, 0.3 * a));
    if (std::fabs(a - before) < kGuessDone * a) break;
  }
  const double x = lambda_ * a * a;
  return (2.0 / 3.0) * a * lambda_ * lambda_ + 0.25 * kPi * x / det_cbrt(1.0 + 1.09 * x);
}

/// Newton's method with the curve's bend: the step is to the root of the parabola at u (convergence of third
/// order, and near a fold as fast as elsewhere). Where the parabola has none it is to its vertex, the fold.
CurveSolution MaugisDugdale::solve_contact(double z, const Held& held, double guess) const noexcept {
  CurveSolution out;
  double lo = 0;
  double hi = kInfinity;
  double u = guess > 0 ? guess : cold_guess(z, held);
  bool fold_known = false;
  for (out.evaluations = 1; out.evaluations <= 100; ++out.evaluations) {
    const Angle g = angle_of(u);
    CurvePoint& p = out.point;
    state_at<true>(lambda_, u, g, p);
    const double rate = p.held_rate(held);
    const double bend = p.held_bend(held);
    const double residual = p.held(held) - z;
    const double per_rate = 1.0 / rate;
    const double newton = -residual * per_rate;
    const double bent = -newton * bend * per_rate;
    // A parabola in u; towards the onset, if more than a little bent, what is one in sqrt(u).
    double step = newton;
    bool crosses = bent < 0.5;
    if (std::fabs(bent) < kHardlyBent) {
      step *= 1.0 + 0.5 * bent * (1.0 + bent * (1.0 + 1.25 * bent));
    } else if (crosses) {
      step *= 2.0 / (1.0 + std::sqrt(1.0 - 2.0 * bent));
    } else if (bend > 0) {
      step /= bent;
    }
    if (u < kTowardsOnset && bend > 0 && std::fabs(bent) > kBent) {
      const double root = root_towards_onset(u, residual, rate, bend);
      crosses = root > 0;
      if (crosses) step = root - u;
    }
    // It ends above z within reach: so does the curve, or nearly.
    bool ends = !crosses && bend > 0 && rate < kSmallStep * u * bend && !fold_known;
    // From nothing to near the fold, where that costs one evaluation: better from there.
    ends = ends ||
           (out.evaluations == 1 && !(guess > 0) && held.load == 0 && q_ > onset_radius_ && bent > kNearFold);
    if (!(p.overlap_rate > 0 && rate > 0) || ends) {
      // Beyond the fold. Is there a state at all? Then start from the parabola at the fold.
      if (fold_known) {  // at the fold to rounding
        p.energy = contact_energy(lambda_, p, g);
        return out;
      }
      const CurvePoint end = fold(held);
      fold_known = true;
      ++out.evaluations;
      const double above = z - end.held(held);
      if (above <= 0) {
        out.point = end;
        if (above < 0) out.status = CurveStatus::kNoState;
        return out;
      }
      lo = end.parameter;
      const double end_bend = end.held_bend(held);
      u = end_bend > 0 && end_bend < kInfinity ? root_towards_onset(lo, -above, 0.0, end_bend) : lo + above;
      continue;
    }
    const double scale = held.overlap * (p.contact_radius * p.contact_radius + std::fabs(p.overlap)) +
                         held.load * std::fabs(p.load);
    const double size = std::fabs(step);
    // The error after this step: a sixth of the third derivative, times the cube, over the rate. Delta and P
    // are made of powers of u from 1 to 3, so that u times the third derivative is of the size of the bends,
    // or where those cancel of the rate over u; no factor, for safety.
    const double bends = held.overlap * std::fabs(p.overlap_bend) + held.load * std::fabs(p.load_bend);
    const bool little_left = size * size * size * (bends * u + rate) <= kEpsilon * (u * u * u) * rate;
    const bool last = std::fabs(residual) <= kEpsilon * scale || size <= 4.0 * kEpsilon * u ||
                      (crosses && size < kSmallStep * u && little_left);
    if (last) {
      p.energy = contact_energy(lambda_, p, g);
      p.shift(std::max(step, -u));
      return out;
    }
    if (residual < 0) {
      lo = std::max(lo, u);
    } else {
      hi = std::min(hi, u);
    }
    double next = u + step;
    if (step > 2.0 * u + 1e-3 && hi == kInfinity) {
      next = std::min(next, std::max(cold_guess(z, held), 3.0 * u + 1e-3));
    }
    if (!(next < hi)) next = 0.5 * (u + hi);
    if (next < lo || next <= 0) next = 0.5 * (u + lo);
    if (next == u) {
      p.energy = contact_energy(lambda_, p, g);
      return out;
    }
    u = next;
  }
  out.status = CurveStatus::kNotConverged;
  return out;
}

}  // namespace telenano::physics
