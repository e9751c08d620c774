#include "telenano/nve_server/physics/law/pull_off.h"

#include <algorithm>

namespace telenano::physics {
namespace {

// In units of the law's lengths: u_delta, of a soft contact's neck, and the cut-off distance, of what acts
// across a gap. A Maugis contact of any lambda without load lies below 1.4 u_delta; the fold above -1 u_delta
// - 1 a0; with a meniscus the load is 0 deeper, which moves no maximum.
constexpr double kIn = 3.0;
constexpr double kOut = -3.0;
constexpr double kStep = 0.01;
constexpr double kApproachSteps = 20;
constexpr int kHalvings = 60;
constexpr double kGolden = 0.6180339887498949;

}  // namespace

double total_pull_off_nn(const TipSampleLaw& law, double radius_nm) noexcept {
  const double length = law.scales(radius_nm).overlap_nm + law.parameters().equilibrium_distance_nm;
  TipSampleState state;
  for (int i = 0; i <= kApproachSteps; ++i) {
    law.advance(length * (10.0 * kOut + (kIn - 10.0 * kOut) * i / kApproachSteps), 0.0, radius_nm, state);
  }
  TipSampleState before = state;  // one step before the greatest so far
  TipSampleState last = state;
  double most = 0;
  double at = kIn;
  for (double x = kIn; x >= kOut; x -= kStep) {
    last = state;
    const double attraction = -law.advance(x * length, 0.0, radius_nm, state).force_nn;
    if (!(attraction > most)) continue;
    most = attraction;
    at = x;
    before = last;
  }
  // Between the neighbours of the greatest.
  const auto attraction_at = [&](double x) {
    TipSampleState there = before;
    return -law.advance(x * length, 0.0, radius_nm, there).force_nn;
  };
  double low = at - kStep;
  double high = at + kStep;
  double a = high - kGolden * (high - low);
  double b = low + kGolden * (high - low);
  double at_a = attraction_at(a);
  double at_b = attraction_at(b);
  for (int i = 0; i < kHalvings; ++i) {
    most = std::max({most, at_a, at_b});
    if (at_a < at_b) {
      low = a;
      a = b;
      at_a = at_b;
      b = low + kGolden * (high - low);
      at_b = attraction_at(b);
    } else {
      high = b;
      b = a;
      at_b = at_a;
      a = high - kGolden * (high - low);
      at_a = attraction_at(a);
    }
  }
  return most;
}

}  // namespace telenano::physics
