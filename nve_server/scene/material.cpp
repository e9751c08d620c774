#include "telenano/nve_server/scene/material.h"

#include <cmath>

namespace telenano::scene {

double contact_modulus_gpa(const Material& a, const Material& b) noexcept {
  const auto compliance = [](const Material& m) {
    return (1.0 - m.poisson_ratio * m.poisson_ratio) / m.youngs_modulus_gpa;
  };
  return 4.0 / 3.0 / (compliance(a) + compliance(b));
}

double work_of_adhesion_j_m2(const Material& a, const Material& b) noexcept {
  return 2.0 * std::sqrt(a.surface_energy_j_m2 * b.surface_energy_j_m2);
}

double contact_shear_modulus_gpa(const Material& a, const Material& b) noexcept {
  const auto compliance = [](const Material& m) {
    return (2.0 - m.poisson_ratio) * 2.0 * (1.0 + m.poisson_ratio) / m.youngs_modulus_gpa;
  };
  return 1.0 / (compliance(a) + compliance(b));
}

}  // namespace telenano::scene
