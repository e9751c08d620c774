#pragma once

#include <cmath>

#include "nve_server/physics/joined_law.h"

namespace telenano::physics {

/// What the steps of a tip–sample law share: handover and parting once a radius, and guesses from the last
/// states.

/// The handover at the curve's lambda, guessed from the last two.
template <class Curve, class Cache>
const Handover& cached_handover(const Curve& curve, Cache& cache) noexcept {
  if (cache.has_handover) return cache.handover;
  const double lambda = curve.lambda();
  double* at = cache.handover_lambda;
  double* ratio = cache.handover_ratio;
  double guess = ratio[0];
  if (ratio[1] > 0 && at[0] != at[1]) guess += (ratio[0] - ratio[1]) / (at[0] - at[1]) * (lambda - at[0]);
  if (!(std::fabs(lambda - at[0]) < 0.1 * at[0])) guess = 0;
  cache.handover = find_handover(curve, cache.outside, guess * lambda * lambda);
  cache.has_handover = true;
  at[1] = at[0];
  ratio[1] = ratio[0];
  at[0] = lambda;
  ratio[0] = cache.handover.inside.contact ? cache.handover.inside.parameter / (lambda * lambda) : 0;
  return cache.handover;
}

template <class Curve, class Cache>
const Parting& cached_parting(const Curve& curve, Cache& cache) noexcept {
  if (!cache.has_parting) {
    cache.parting = find_parting(curve, cache.outside);
    cache.has_parting = true;
  }
  return cache.parting;
}

/// The stable state on the curve that holds z, from the last one.
template <class Curve, class Cache>
CurveSolution solve_warm(const Curve& curve, const Cache& cache, double z, const Held& held) noexcept {
  double guess = cache.u;
  double curvature = 0;
  if (cache.compliance == held.load && cache.rate > 0) {
    const double first = (z - cache.z) / cache.rate;
    const double second = -0.5 * cache.curvature * first * first / cache.rate;
    if (std::fabs(first) < 0.3 * guess && std::fabs(second) < 0.3 * std::fabs(first)) {
      guess += first + second;
      if (std::fabs(first) < 0.03 * guess) curvature = cache.curvature;
    }
  }
  return curve.solve(z, held, guess, curvature);
}

template <class Curve, class Cache>
void remember(const Curve& curve, Cache& cache, double z, const Held& held, const CurvePoint& p) noexcept {
  const double rate = p.contact ? p.held_rate(held) : 0;
  const double u = p.contact ? p.parameter : 0;
  const bool comparable = cache.compliance == held.load && cache.rate > 0 && rate > 0 &&
                          cache.lambda == curve.lambda() && u != cache.u;
  cache.curvature = comparable ? (rate - cache.rate) / (u - cache.u) : 0;
  cache.lambda = curve.lambda();
  cache.compliance = held.load;
  cache.z = z;
  cache.u = u;
  cache.rate = rate;
}

}  // namespace telenano::physics
