#pragma once

#include <string>

namespace telenano::scene {

struct Material {
  std::string name;
  double youngs_modulus_gpa = 0;
  double poisson_ratio = 0;
  double surface_energy_j_m2 = 0;
  double hardness_gpa = 0;  ///< of the sample only; 0: never yields
};

/// K = 4E*/3 with 1/E* = (1 − ν₁²)/E₁ + (1 − ν₂²)/E₂, GPa.
double contact_modulus_gpa(const Material& a, const Material& b) noexcept;

/// w = 2√(γ₁γ₂), J/m².
double work_of_adhesion_j_m2(const Material& a, const Material& b) noexcept;

/// G* with 1/G* = (2 − ν₁)/G₁ + (2 − ν₂)/G₂, G = E/(2(1 + ν)), GPa: of tangential contact stiffness 8G*a.
double contact_shear_modulus_gpa(const Material& a, const Material& b) noexcept;

}  // namespace telenano::scene
