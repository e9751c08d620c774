#pragma once

#include <array>
#include <memory>

#include "telenano/nve_server/physics/particle/particle_parameters.h"
#include "telenano/nve_server/physics/particle/particle_state.h"
#include "telenano/nve_server/physics/potential/tip_potential.h"
#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// Where a contact rests without load: in contact, where the force changes its sign.
struct ZeroLoad {
  TipSampleState law;
  double overlap_nm = 0;
  double contact_radius_nm = 0;
  double potential_aj = 0;
};
/// For set-up, not for loops.
ZeroLoad zero_load(const TipSampleLaw& law, double radius_nm) noexcept;

/// The ground as one potential for each of the two spheres, of fields made for its radius and of the law of
/// its contact.
struct ParticleGround {
  std::shared_ptr<const TipPotential> tip;
  std::shared_ptr<const TipPotential> particle;
};

/// What does not change: the bodies, their laws and the surface.
struct ParticleModel {
  /// Throws UserError unless radii and drag are positive, the frictions make sense, both grounds are there,
  /// and adhesion alone does not draw the particle into sample or tip by a radius (where no contact theory
  /// holds).
  ParticleModel(std::shared_ptr<const Surface> surface, const ParticleParameters& parameters,
                const ParticleGround& ground);

  std::shared_ptr<const Surface> surface;
  /// Of tip and sample, of particle and sample.
  std::array<std::shared_ptr<const TipPotential>, kParticleContacts> ground;
  ParticleParameters parameters;
  std::array<TipSampleLaw, kParticleContacts> laws;
  std::array<ContactFriction, kParticleContacts> friction;
  // At one radius, from which they are scaled.
  std::array<double, kParticleContacts> nominal_radius_nm{};
  /// Of a contact at a radius: how the law's numbers become nm and nN, a₀, and the radius over the nominal one.
  struct AtRadius {
    ContactScales scales;
    double zero_load_radius_nm = 0;
    double relative = 1;
  };
  AtRadius at_radius(int contact, double radius_nm) const noexcept;
  /// On level ground each evaluation has this ρ: what follows from it is found once.
  struct LevelGround {
    double log_radius = 0;
    double radius_nm = 0;  ///< e^ρ, not quite the nominal one
    AtRadius at;
  };
  std::array<LevelGround, kParticleContacts> level;
  std::array<double, kParticleContacts> pull_off_nn{};
  std::array<double, kParticleContacts> zero_load_radius_nm{};  ///< a₀
};

}  // namespace telenano::physics
