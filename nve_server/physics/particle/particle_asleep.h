#pragma once

#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/particle/particle_equilibrium.h"

namespace telenano::physics {

/// The tip beside a particle that sleeps (particle_equilibrium.h): the tip's own balance on the ground, drawn
/// by the particle where it lies. So such a step costs what it costs without the particle, and one evaluation
/// of the law between tip and particle.
///
/// Model     As ParticleBalance asleep: contact and friction of tip and sample, and the attraction of the
///           particle. That is taken where the tip is foreseen to be and held during the balance; between
///           there and where the tip comes to rest, ε, it changes by ε dF/dd: below 1e-4 of the pull-off of
///           particle and sample for each nm, so below 1e-8 of it for what is foreseen to 1e-4 nm. The
///           potential is led on to where the tip is, to first order.
/// Ends      where the tip would draw more than wakes the particle, touch it, or go further in a step than
///           half the gap between them: then ParticleEquilibrium makes the step.
class TipBesideSleeper {
 public:
  TipBesideSleeper(const ParticleModel& model, double little_pull_nn);

  /// Whether the step may be begun from here: the particle sleeps.
  bool may_begin(const ParticleState& state) const noexcept { return state.started && state.sleep.asleep; }
  /// The tip as ParticleEquilibrium left it; `springs` of that step.
  void begin(const ParticleState& from, const ParticleSolution& solution, const Compliance& springs,
             PotentialState& tip) const noexcept;
  /// Between tip and particle.
  struct Pull {
    TipSampleState memory;
    Equilibrium law;
    Vec3 force_w_nn = Vec3::Zero();  ///< on the tip
  };
  /// False, with `tip` left as it was: the particle wakes. The free end that `tip` keeps is the one that the
  /// ground alone would need for the same place: what springs and pull make of the true one.
  bool advance(const Vec3& free_end_w_nm, const Compliance& springs, const ParticleState& lies, Pull& pull,
               PotentialState& tip, TipSolution& solution) const noexcept;
  /// The two contacts of the tip, as they are after such a step; nothing else of `out` has changed.
  void describe(const TipSolution& solution, const Pull& pull, ParticleSolution& out) const noexcept;
  /// Back: the state that ParticleEquilibrium goes on from.
  void end(const PotentialState& tip, const TipSolution& solution, const Pull& pull,
           ParticleState& state) const noexcept;

 private:
  bool draw(const Vec3& from_apex, const Vec3& foreseen_apex, const Vec3& move, const ParticleState& lies,
            Pull& pull) const noexcept;

  PotentialEquilibrium equilibrium_;
  const TipSampleLaw law_;  // between tip and particle
  double tip_radius_nm_, reach_nm_, radius_nm_;
  double little_pull_nn_;
};

}  // namespace telenano::physics
