#pragma once

#include <cmath>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"

/// Tips and samples from the whole range that a scene may ask for.
namespace telenano::testing {

inline double log_uniform(Random& random, double low, double high) {
  return low * std::exp(random.uniform() * std::log(high / low));
}

/// A material and tip, and Maugis' scales of it by his own formulas.
struct Sample {
  physics::TipSampleParameters parameters;
  double radius_nm = 0;
  double lambda = 0, overlap_nm = 0, force_nn = 0;

  Sample(double e_gpa, double w, double r, bool van_der_waals) : radius_nm(r) {
    parameters.contact_modulus_gpa = 4.0 / 3.0 * e_gpa;
    parameters.work_of_adhesion_n_m = w;
    parameters.van_der_waals = van_der_waals;
    const double k = parameters.contact_modulus_gpa;
    const double sigma0 = 16 / (9 * std::sqrt(3.0)) * w / parameters.equilibrium_distance_nm;
    overlap_nm = std::cbrt(M_PI * M_PI * w * w * r / (k * k));
    force_nn = M_PI * w * r;
    lambda = 2 * sigma0 * std::cbrt(r / (M_PI * w * k * k));
  }
};

inline Sample random_sample(Random& random, bool van_der_waals) {
  const double e = log_uniform(random, 1e-3, 1e3);
  const double w = log_uniform(random, 1e-3, 1);
  return Sample(e, w, log_uniform(random, 1, 1e4), van_der_waals);
}

}  // namespace telenano::testing
