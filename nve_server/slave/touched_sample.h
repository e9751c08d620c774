#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "telenano/nve_server/physics/equilibrium/marked_potential.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/particle/particle_asleep.h"
#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/state_fields.h"

namespace telenano::slave {

/// What the tip of one session touches where the ground is fields of the apex: the scene's sample, shared by
/// all sessions, and what is this session's own: the surface where marks stay, a particle. Trials change
/// nothing until one is accepted. (On a level sample without either the law alone is asked, by NveSlave.)
class TouchedSample {
 public:
  /// Throws UserError if the sample yields but has no surface of heights.
  explicit TouchedSample(std::shared_ptr<const scene::Scene> scene);

  /// Moves the free end of the springs as PotentialEquilibrium::advance does, within `dt_s`. Energies of the
  /// solution are those of everything that is touched: `potential_aj` and `friction_stored_aj` stored,
  /// `dissipated_aj` and `friction_dissipated_aj` lost in this step.
  physics::TipSolution advance(const Vec3& free_end_w_nm, const physics::Compliance& springs, double dt_s,
                               physics::PotentialState& state) noexcept;
  /// `accepted`, the last trial, is what happened.
  void accept(const physics::TipSolution& accepted) noexcept;

  /// This session's own surface; null where no marks stay.
  const physics::SplineSurface* marked_surface() const noexcept {
    return marked_ ? &marked_->surface() : nullptr;
  }

  /// Steps that left a mark.
  std::uint64_t marks() const noexcept { return marked_ ? marked_->marks() : 0; }

  /// Hears of every mark from now on; nothing where none stay.
  void set_mark_journal(physics::MarkJournal* journal) noexcept {
    if (marked_) marked_->set_journal(journal);
  }

  /// Of the last trial accepted; null without a particle.
  const physics::ParticleSolution* particle() const noexcept {
    return particle_ ? &particle_->solution() : nullptr;
  }

  /// Whether the last trial balanced the particle together with the tip, which takes longer.
  bool balances_particle() const noexcept { return particle_ && !particle_->trial_alone; }

  /// MarkedPotential::set_maker() and stroke_maker().
  void set_maker(std::uint64_t maker) noexcept {
    if (marked_) marked_->set_maker(maker);
  }
  std::uint64_t stroke_maker() const noexcept { return marked_ ? marked_->stroke_maker() : 0; }

  /// MarkedPotential::exchange_stroke() and keep_undone(); false: there is nothing to take back.
  bool exchange_stroke() noexcept { return marked_ && marked_->exchange_stroke(); }
  void keep_undone() noexcept { marked_->keep_undone(); }

  /// Of what marks have changed of the fields; 0: nothing.
  std::uint64_t marks_digest() const noexcept { return marked_ ? marked_->fields().marks_digest() : 0; }
  /// Bytes that write() may need for what marks have changed.
  std::size_t mark_bytes_max() const noexcept;
  /// What of it later steps depend on: `visit` is a StateHash, StateWriter or StateReader (state_fields.h).
  template <class Visit>
  void write(Visit& visit) const noexcept;
  /// False: not such a sample's; then it is as at the beginning.
  bool read(StateReader& visit) noexcept;
  void reset() noexcept;

 private:
  struct ParticleTrial {
    physics::ParticleEquilibrium equilibrium;
    // What is, and the trial: exchanged, not copied, when one is accepted.
    physics::ParticleState states[2];
    physics::ParticleSolution solutions[2];
    physics::ParticleState& state() noexcept { return states[now]; }
    const physics::ParticleState& state() const noexcept { return states[now]; }
    physics::ParticleState& trial_state() noexcept { return states[1 - now]; }
    physics::ParticleSolution& solution() noexcept { return solutions[now]; }
    const physics::ParticleSolution& solution() const noexcept { return solutions[now]; }
    physics::ParticleSolution& trial_solution() noexcept { return solutions[1 - now]; }
    physics::ParticleState at_first;
    // While it sleeps the tip is balanced alone, in the state of who calls, once it has begun.
    physics::TipBesideSleeper beside;
    physics::TipBesideSleeper::Pull pull;
    physics::TipBesideSleeper::Pull trial_pull;  // the law's memory in it: any is right, the last is quick
    bool alone = false;
    bool begun = false;
    bool trial_alone = false;
    physics::Compliance springs = physics::Compliance::Zero();  // of the last trial
    int now = 0;                                                // of the two
  };
  physics::TipSolution advance_both(const Vec3& free_end_w_nm, const physics::Compliance& springs,
                                    double dt_s, physics::PotentialState& state) noexcept;
  bool advance_alone(const Vec3& free_end_w_nm, const physics::Compliance& springs,
                     physics::PotentialState& state) noexcept;

  void unmark() noexcept;

  std::shared_ptr<const scene::Scene> scene_;
  std::unique_ptr<physics::MarkedPotential> marked_;
  std::unique_ptr<ParticleTrial> particle_;
};

}  // namespace telenano::slave
