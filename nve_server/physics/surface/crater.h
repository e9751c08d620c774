#pragma once

#include <cmath>

namespace telenano::physics {

/// The shape of a mark: levels of a crater and its rim at (ξ, η), distances from its deepest point over the
/// radius of the crater's rim.
///
/// Crater: φ = (1 − ρ⁴)² within ρ < 1, nearly level over the inner half, because marks come as small
/// increments while the tip goes in, each with the contact's radius at that depth: an indenter lowers all
/// that it covers by the same amount. Its volume is kCraterShare of that of the cylinder of its rim and
/// depth.
inline constexpr double kCraterShare = 8.0 / 15.0;

inline double crater_level(double xi, double eta) noexcept {
  const double rho_sq = xi * xi + eta * eta;
  const double rest = 1.0 - rho_sq * rho_sq;
  return rho_sq < 1.0 ? rest * rest : 0.0;  // a choice, no branch: several at once
}

/// What is piled up round it: ((ρ² − 1)(4 − ρ²))² for 1 < ρ < 2, scaled by who uses it.
inline constexpr double kHeapReach = 2.0;
inline double heap_level(double xi, double eta) noexcept {
  const double rho_sq = xi * xi + eta * eta;
  if (!(rho_sq > 1.0 && rho_sq < kHeapReach * kHeapReach)) return 0.0;
  const double rise = (rho_sq - 1.0) * (kHeapReach * kHeapReach - rho_sq);
  return rise * rise;
}

/// Unknowns a, b, c of the fall φ(a + b ξ + c η) from three equations, by elimination. On the rim the slope
/// across is nil whatever is done: that equation is empty then, and its unknown left at 0.
inline void solve_crater(double (&m)[3][4], double (&out)[3]) noexcept {
  constexpr double kEmpty = 1e-9;
  bool used[3];
  for (int k = 0; k < 3; ++k) {
    used[k] = std::abs(m[k][k]) > kEmpty;
    if (!used[k]) continue;
    for (int i = k + 1; i < 3; ++i) {
      const double factor = m[i][k] / m[k][k];
      for (int j = k; j < 4; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  for (int k = 2; k >= 0; --k) {
    double sum = m[k][3];
    for (int j = k + 1; j < 3; ++j) sum -= m[k][j] * out[j];
    out[k] = used[k] ? sum / m[k][k] : 0.0;
  }
}

}  // namespace telenano::physics
