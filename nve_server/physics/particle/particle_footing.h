#pragma once

#include <array>

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

inline constexpr int kMaxParticleFeet = 3;

/// Which feet a sphere leans on; part of the state between steps.
struct ParticleFeet {
  std::array<FootMemory, kMaxParticleFeet> feet;
  int count = 0;
};

/// The overlap of a sphere with the surface as a smooth field of its centre.
///
/// One foot: overlap δ = R − distance, ∇δ = −n, ∇²δ = −N. In an edge, a groove or a pit up to three feet
/// share the largest overlap, whose maximum has a kink there: it is taken smooth,
///   δ = ε ln Σ exp(δ_i/ε),   α_i = exp((δ_i − δ)/ε),   ∇δ = −Σ α_i n_i,
///   ∇²δ = −Σ α_i N_i + (Σ α_i n_i n_iᵀ − n̄n̄ᵀ)/ε,
/// ε = kKinkWidth_nm; too large by ε ln 3 at most, exact where one foot is deeper than the others by some 40
/// ε. So force and energy are those of one contact at the largest overlap, divided among the feet.
struct Footing {
  double overlap_nm = 0;
  Vec3 normal_w = Vec3::UnitZ();      ///< n̄ = Σ α_i n_i: −∇δ
  Mat3 bend_1_per_nm = Mat3::Zero();  ///< −Σ α_i N_i, the part of ∇²δ that the surface's curvature makes
  Mat3 kink_1_per_nm = Mat3::Zero();  ///< the rest: positive semidefinite, 0 on one foot
  double radius_nm = 0;               ///< effective, Σ α_i R_i
  bool outside = false;
  bool clamped = false;
};

inline constexpr double kKinkWidth_nm = 1e-3;

/// Follows the feet to this centre.
Footing stand(const Surface& surface, const Vec3& centre_w_nm, double radius_nm, ParticleFeet& feet) noexcept;

/// Searches the whole surface. True if there is a foot deeper than the known ones, which has then been taken
/// in. Feet that are no longer near the largest overlap are dropped.
bool look_around(const Surface& surface, const Vec3& centre_w_nm, ParticleFeet& feet) noexcept;

}  // namespace telenano::physics
