#pragma once

#include <Eigen/Geometry>
#include <array>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/physics/potential/tip_potential.h"

namespace telenano::physics {

/// The three contacts of a tip, a particle and a sample; also the index into arrays of them.
enum ParticleContact : int { kTipSample = 0, kTipParticle = 1, kParticleSample = 2 };
inline constexpr int kParticleContacts = 3;

/// What one contact remembers: the branch of its law, and how far its bristles are bent.
struct ParticleContactMemory {
  TipSampleState law;
  PotentialBranch place;  ///< on a ground of one potential, where of `law` the branch and overlap alone count
  CurveHint hint;         ///< the same
  double contact_radius_nm = 0;
  Vec3 normal_w = Vec3::UnitZ();  ///< from the lower body to the upper: sample, then tip, then particle
  Vec3 slide_nm = Vec3::Zero();
  Vec3 roll_rad = Vec3::Zero();
  Vec3 spin_rad = Vec3::Zero();
  double slide_stiffness = 0;  ///< that the deflection belongs to
  double roll_stiffness = 0;
  double spin_stiffness = 0;
};

/// A particle that rests, as it was when it was last balanced.
struct ParticleSleep {
  bool asleep = false;
  Equilibrium law;  ///< of its contact with the sample
  Vec3 normal_w = Vec3::UnitZ();
  double radius_nm = 0;
  Vec3 push_w_nn = Vec3::Zero();  ///< without friction
  Vec3 slide_force_w_nn = Vec3::Zero();
  Vec3 roll_torque_w_nn_nm = Vec3::Zero();
  Vec3 spin_torque_w_nn_nm = Vec3::Zero();
  double potential_aj = 0;  ///< of that contact and its bristles
};

/// What is remembered from one accepted step to the next. Begin with ParticleEquilibrium::place().
struct ParticleState {
  std::array<ParticleContactMemory, kParticleContacts> contacts;
  bool started = false;  ///< false: the tip has not been brought in yet
  Vec3 tip_centre_w_nm = Vec3::Zero();
  Vec3 tip_force_w_nn = Vec3::Zero();
  Vec3 particle_centre_w_nm = Vec3::Zero();
  Vec3 turned_w_rad = Vec3::Zero();  ///< sum of the small turns so far: the path, not the orientation
  Eigen::Quaterniond orientation_w = Eigen::Quaterniond::Identity();
  double potential_aj = 0;  ///< contacts and bristles, without the springs of the tip
  ParticleSleep sleep;
};

}  // namespace telenano::physics
