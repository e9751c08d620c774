#pragma once

#include <memory>

#include "telenano/nve_server/physics/particle/particle_model.h"
#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/shape_fields.h"

/// Grounds for a tip and a particle, as a scene makes them.
namespace telenano::support {

/// `fields`(radius, law): of the ground, for a sphere of this radius with this law.
template <class Fields>
physics::ParticleGround ground_of(const physics::ParticleParameters& p, const Fields& fields) {
  const auto of = [&](double radius, const physics::TipSampleParameters& law) {
    return std::make_shared<physics::TipPotential>(
        fields(radius, law),
        std::make_shared<physics::BranchPotential>(physics::TipSampleLaw(law, radius), radius));
  };
  return {of(p.tip_radius_nm, p.tip_sample), of(p.particle_radius_nm, p.particle_sample)};
}

/// The plane z = 0.
inline physics::ParticleGround level_ground(const physics::ParticleParameters& p) {
  return ground_of(p, [](double radius, const physics::TipSampleParameters&) {
    return std::make_shared<physics::PlaneFields>(physics::PlaneSurface::Shape{}, radius);
  });
}

inline physics::ParticleGround ground_on(const physics::HeightGrid& grid,
                                         const physics::ParticleParameters& p) {
  return ground_of(p, [&](double radius, const physics::TipSampleParameters& law) {
    return std::make_shared<physics::ScanFields>(
        grid, radius,
        physics::softening_rule(radius, law.work_of_adhesion_n_m, 0.75 * law.contact_modulus_gpa,
                                law.equilibrium_distance_nm));
  });
}

}  // namespace telenano::support
