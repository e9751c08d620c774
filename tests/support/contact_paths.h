#pragma once

#include <cmath>

#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::testing {

using physics::Equilibrium;
using physics::TipSampleLaw;
using physics::TipSampleParameters;
using physics::TipSampleState;

/// A silicon tip (160 GPa, 0.27, 0.2 J/m^2) on a sample: w = 2 sqrt(gamma1 gamma2), K = 4E*/3.
inline TipSampleParameters silicon_on(double e_gpa, double gamma, double nu, bool van_der_waals) {
  TipSampleParameters p;
  p.contact_modulus_gpa = 4.0 / 3.0 / ((1 - 0.27 * 0.27) / 160 + (1 - nu * nu) / e_gpa);
  p.work_of_adhesion_n_m = 2 * std::sqrt(0.2 * gamma);
  p.van_der_waals = van_der_waals;
  return p;
}

/// w = 0.1 N/m and the modulus that gives `lambda` at R = 20 nm.
inline TipSampleParameters material_of(double lambda, bool van_der_waals) {
  TipSampleParameters p;
  p.work_of_adhesion_n_m = 0.1;
  p.van_der_waals = van_der_waals;
  // lambda = (2/pi) (sigma0/w) u_delta, u_delta^3 = pi^2 w^2 R/K^2
  const double u_delta = lambda * M_PI / 2 * p.equilibrium_distance_nm * 9 * std::sqrt(3.0) / 16;
  p.contact_modulus_gpa = M_PI * 0.1 * std::sqrt(20.0 / (u_delta * u_delta * u_delta));
  return p;
}

inline double stored_aj(const Equilibrium& e, double compliance) {
  return e.potential_aj + 0.5 * compliance * e.force_nn * e.force_nn;
}

/// Integral of F dZ from `from` (where `state` is) to `to`, by Gauss–Legendre with halving until two levels
/// agree or the interval is at the last bits of Z. Knows nothing of folds, branches or potentials: it only
/// asks for forces.
class WorkIntegral {
 public:
  WorkIntegral(const TipSampleLaw& law, double compliance, double radius_nm)
      : law_(law), compliance_(compliance), radius_nm_(radius_nm) {}

  double run(double from, double to, const TipSampleState& state, double tolerance, int depth = 0) const {
    const double whole = gauss(from, to, state);
    const double mid = 0.5 * (from + to);
    TipSampleState at_mid = state;
    const int jumps_first = law_.advance(mid, compliance_, radius_nm_, at_mid).jumps;
    TipSampleState at_end = at_mid;
    const int jumps = jumps_first + law_.advance(to, compliance_, radius_nm_, at_end).jumps;
    // Between the last node and the end of an interval a jump or a kink (touch) would not be seen.
    const bool smooth = jumps == 0 && same_piece(state, at_mid) && same_piece(at_mid, at_end);
    const double halves = gauss(from, mid, state) + gauss(mid, to, at_mid);
    if (depth >= 48 || (depth > 7 && smooth && std::fabs(whole - halves) <= tolerance)) return halves;
    return run(from, mid, state, tolerance, depth + 1) + run(mid, to, at_mid, tolerance, depth + 1);
  }

 private:
  static bool same_piece(const TipSampleState& a, const TipSampleState& b) {
    return a.branch == b.branch && a.bridge.present == b.bridge.present &&
           (a.overlap_nm >= 0) == (b.overlap_nm >= 0);
  }

  double gauss(double from, double to, const TipSampleState& state) const {
    constexpr double kNode[3] = {0.23861918608319690863, 0.66120938646626451366, 0.93246951420315202781};
    constexpr double kWeight[3] = {0.46791393457269104739, 0.36076157304813860757, 0.17132449237917034504};
    const double centre = 0.5 * (from + to);
    const double half = 0.5 * (to - from);
    double sum = 0;
    for (int i = 0; i < 3; ++i) {
      for (const double side : {-1.0, 1.0}) {
        TipSampleState at = state;
        sum +=
            kWeight[i] * law_.advance(centre + side * half * kNode[i], compliance_, radius_nm_, at).force_nn;
      }
    }
    return sum * half;
  }

  const TipSampleLaw& law_;
  double compliance_;
  double radius_nm_;
};

}  // namespace telenano::testing
