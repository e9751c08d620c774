#pragma once

#include <cmath>

#include "telenano/nve_server/physics/contact/joined_law.h"

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

/// A parameter near that of the stable state that holds z, from the last state: to second order in what z,
/// compliance and, where the law says how, lambda have changed. 0: none.
template <class Curve, class Cache>
double foreseen(const Curve& curve, const Cache& cache, double z, const Held& held) noexcept {
  const CurvePoint& last = cache.last;
  if (!(cache.u > 0)) return 0;
  const bool other_lambda = cache.lambda != curve.lambda();
  if (!cache.has_last || (other_lambda && last.overlap_by_lambda == 0)) return cache.u;
  const double grown =
      other_lambda ? 2.0 * (curve.lambda() - cache.lambda) / (curve.lambda() + cache.lambda) : 0.0;
  const double there =
      last.held(held) + grown * (held.overlap * last.overlap_by_lambda + held.load * last.load_by_lambda);
  const double rate = last.held_rate(held);
  if (!(rate > 0)) return cache.u;
  const double first = (z - there) / rate;
  const double second = -0.5 * last.held_bend(held) * first * first / rate;
  if (!(std::fabs(first) < 0.3 * cache.u && std::fabs(second) < 0.3 * std::fabs(first))) return cache.u;
  return cache.u + first + second;
}

/// The stable state on the curve that holds z, from the last one.
template <class Curve, class Cache>
CurveSolution solve_warm(const Curve& curve, const Cache& cache, double z, const Held& held) noexcept {
  return curve.solve(z, held, foreseen(curve, cache, z, held));
}

/// The same into `out`, in place where the curve can.
template <class Curve, class Cache>
void solve_warm(const Curve& curve, const Cache& cache, double z, const Held& held,
                CurveSolution& out) noexcept {
  if constexpr (requires { curve.solve(z, held, z, out); }) {
    curve.solve(z, held, foreseen(curve, cache, z, held), out);
  } else {
    out = solve_warm(curve, cache, z, held);
  }
}

template <class Curve, class Cache>
void remember(const Curve& curve, Cache& cache, const CurvePoint& p) noexcept {
  cache.lambda = curve.lambda();
  cache.u = p.contact ? p.parameter : 0;
  cache.has_last = p.contact;
  cache.last = p;
}

}  // namespace telenano::physics
