#pragma once

#include <memory>

#include "telenano/nve_server/physics/particle_equilibrium.h"
#include "telenano/nve_server/physics/tip_equilibrium.h"

namespace telenano::physics {

/// The tip on a flat sample beside a particle that sleeps (particle_equilibrium.h): the tip's own balance
/// (TipEquilibrium), drawn by the particle where it lies. So such a step costs what it costs without the
/// particle, and one evaluation of the law between tip and particle.
///
/// Model     As ParticleBalance asleep: contact and friction of tip and sample, and the attraction of the
///           particle. That is taken where the tip is foreseen to be and held during the balance; between
///           there and where the tip comes to rest, ε, it changes by ε dF/dd: below 1e-4 of the pull-off of
///           particle and sample for each nm, so below 1e-8 of it for what is foreseen to 1e-4 nm. The
///           potential is led on to where the tip is, to first order.
/// Ends      where the tip would draw more than wakes the particle, touch it, or go further in a step than
///           half the gap between them: then ParticleEquilibrium makes the step.
/// Limits    Flat samples. On others ParticleBalance takes the curvature at the foot, TipEquilibrium its
///           average over the foot: the force would step where the particle falls asleep.
class TipBesideSleeper {
 public:
  TipBesideSleeper(std::shared_ptr<const Surface> surface, const ParticleModel& model, double little_pull_nn);

  /// Whether the step may be begun from here: the particle sleeps, the sample is flat.
  bool may_begin(const ParticleState& state) const noexcept;
  /// The tip as ParticleEquilibrium left it; `springs` of that step.
  void begin(const ParticleState& from, const ParticleSolution& solution, const Compliance& springs,
             TipState& tip) const noexcept;
  /// Between tip and particle.
  struct Pull {
    TipSampleState memory;
    Equilibrium law;
    Vec3 force_w_nn = Vec3::Zero();  ///< on the tip
  };
  /// False, with `tip` left as it was: the particle wakes.
  bool advance(const Vec3& free_end_w_nm, const Compliance& springs, const ParticleState& lies, Pull& pull,
               TipState& tip, TipSolution& solution) const noexcept;
  /// The two contacts of the tip, as they are after such a step; nothing else of `out` has changed.
  void describe(const TipSolution& solution, const Pull& pull, ParticleSolution& out) const noexcept;
  /// Back: the state that ParticleEquilibrium goes on from.
  void end(const TipState& tip, const TipSolution& solution, const Pull& pull,
           ParticleState& state) const noexcept;

 private:
  TipEquilibrium equilibrium_;
  const TipSampleLaw law_;  // between tip and particle
  double tip_radius_nm_, reach_nm_, radius_nm_;
  double little_pull_nn_;
  bool flat_;
};

}  // namespace telenano::physics
