#pragma once

#include <Eigen/Core>
#include <array>

#include "telenano/nve_server/physics/particle/particle_bristle.h"
#include "telenano/nve_server/physics/particle/particle_model.h"
#include "telenano/nve_server/physics/particle/particle_state.h"

namespace telenano::physics {

/// One small step of tip and particle to their balance.
///
/// Unknowns y = (u, Δq, φ): u the tip's centre p less the free end x, Δq the motion of the particle's centre,
/// φ its turn in this step. The balance is a minimum of
///   Π(y) = ½uᵀC⁻¹u + Σ_i U_i(δ_i) + Σ_j E_j(s_j + Δs_j) + ½η(|Δq|² + R_p²|φ|²)/Δt,
/// with the contact laws' potentials U_i at the overlap δ_i, from their memory at the start of the step, and
/// the envelopes E_j of the bristles (particle_bristle.h). With d the motion of the upper body less that of
/// the lower, n the normal towards the upper and P = 1 − nnᵀ, the bristles are carried by
///   slide  P(d + R_p n×φ)  (the tip does not turn: without φ at the tip–sample contact),
///   roll   Pφ,   spin  n nᵀφ.
/// Rolling without sliding on a flat is Δq = R_p φ×n. The lever is R_p, not R_p less a part of the overlap.
///
/// Newton's method, the Hessian in full where it is positive definite, else with what bends downwards taken
/// as positive, each step shortened until Π falls; so a state that ceases to be stable runs downhill to the
/// next one, as an overdamped one does. What the friction takes from the state (n, a, effective radius) is
/// held during one such minimisation and renewed after it, until it is what it was taken to be: at the end
/// the bristles' limits are those of the contact radii reported, and forces and torques balance. The first
/// minimisations end as soon as what they hold is the larger error, and from the third on what is held is extrapolated. A contact
/// that begins in this step carries friction from the next one on; one that ends carries none in this.
///
/// The two U_i of the ground are functions of the place alone (tip_potential.h), U(δ, ρ) with ρ = ln R_eff a
/// field too: force −∇U and stiffness ∇∇U are exact. Trials start from the branch that the step began on and
/// go over its borders as they are met.
///
/// Asleep, Δq = φ = 0 and the contact of particle and sample is what it was: u alone is balanced, with the
/// force of the particle where it lies. Source
/// M. Ortiz, L. Stainier, Comput. Methods Appl. Mech. Eng. 171 (1999) 419 (incremental potentials).
class ParticleBalance {
 public:
  using Vec9 = Eigen::Matrix<double, 9, 1>;
  using Mat9 = Eigen::Matrix<double, 9, 9>;

  /// `spring` is C⁻¹; `free_end` belongs to the tip's centre.
  ParticleBalance(const ParticleModel& model, const ParticleState& from, const Mat3& spring_n_m,
                  const Vec3& free_end_w_nm, double dt_s, bool asleep = false) noexcept;
  ParticleBalance(const ParticleBalance&) = delete;
  ParticleBalance& operator=(const ParticleBalance&) = delete;

  SolveStatus solve() noexcept;

  struct ContactTrial {
    Equilibrium law;
    Vec3 normal_w = Vec3::UnitZ();    ///< −∇δ
    double distance_nm = 0;           ///< of the centres, between tip and particle
    Vec3 push_w_nn = Vec3::Zero();    ///< on the upper body, without friction: −∇U
    Mat3 hessian_n_m = Mat3::Zero();  ///< on the ground: ∇∇U
    PotentialBranch place;            ///< on the ground: the branch that U is of
    double radius_nm = 0;             ///< effective, at this place
    BristleResponse slide, roll, spin;
    bool known = false;  ///< the law's part is that of centre_w_nm and of the branch that is held
    Vec3 centre_w_nm =
        Vec3::Zero();  ///< of tip or particle on the ground; between the two from tip to particle
  };
  struct Trial {
    Vec9 y = Vec9::Zero();
    bool valid = false;
    double potential_aj = 0;  ///< Π
    double magnitude_aj = 0;  ///< sum of the terms' sizes, for rounding
    Vec9 gradient = Vec9::Zero();
    double load_nn = 0;       ///< sum of the forces' sizes
    double stiffest_n_m = 0;  ///< sum of the contacts' stiffnesses
    std::array<ContactTrial, kParticleContacts> contacts;
  };
  const Trial& result() const noexcept { return *best_; }
  const ContactTrial& contact(int i) const noexcept { return best_->contacts[i]; }
  double radius_nm(int i) const noexcept { return held_[i].radius_nm; }  ///< that the law was given
  int iterations() const noexcept { return iterations_; }
  int jumps() const noexcept;
  bool unstable() const noexcept { return unstable_; }
  double drag_loss_aj() const noexcept;
  /// Slip, and what bristles lose that get stiffer, softer or lose their contact.
  double friction_loss_aj() const noexcept;
  /// Writes what is to be remembered into the state that the step began from. Of the ground's two contacts nothing
  /// of the law's cache moves.
  void store(ParticleState& state) const noexcept;

 private:
  // What is held during one minimisation.
  struct Held {
    double radius_nm = 0;
    double contact_radius_nm = 0;
    Vec3 normal_w = Vec3::UnitZ();
    double stiffest_n_m = 0;        // bounds a fold's infinite slope
    ParticleModel::AtRadius at;     // radius_nm
    Branch branch = Branch::kFree;  // that trials start from
    PotentialBranch place;          // the same
    CurveHint hint;
    Bristle slide, roll, spin;
    Vec3 slide_nm = Vec3::Zero(), roll_rad = Vec3::Zero(), spin_rad = Vec3::Zero();
    bool lost = false;
    // What the last pass found for what it had held, and how far the two were apart.
    Vec3 normal_found_w = Vec3::UnitZ(), normal_gap = Vec3::Zero();
    double radius_found_nm = 0, radius_gap_nm = 0;
  };

  // Motion of a contact's upper body less that of its lower: d = tip·Δp + particle·Δq.
  struct Pair {
    double tip;
    double particle;
  };
  static constexpr std::array<Pair, kParticleContacts> kPairs = {Pair{1, 0}, Pair{-1, 1}, Pair{0, 1}};

  static constexpr bool on_ground(int i) noexcept { return i != kTipParticle; }
  bool lean(int i, const Vec3& centre_w_nm, ContactTrial& contact) noexcept;
  bool touch(const Vec3& apart_w_nm, ContactTrial& contact) noexcept;
  void evaluate(const Vec9& y, Trial& trial) noexcept;
  void hold(int pass) noexcept;
  double extrapolation(int pass) const noexcept;
  double unsettled_nn() const noexcept;
  bool on_held_branches() const noexcept;
  SolveStatus minimise(bool to_the_end) noexcept;
  bool go_over() noexcept;
  double size(const Vec9& gradient) const noexcept;
  double tolerance_nn(const Trial& trial) const noexcept;

  // Newton's step (particle_balance_newton.cpp).
  void hessian(const Trial& trial, bool convex, Mat9& h) const noexcept;
  double excess(const Vec9& step) const noexcept;
  bool find_tip_step(bool convex, Vec9& step) const noexcept;
  bool find_step(bool convex, Vec9& step) noexcept;
  bool descend(const Vec9& step, double tolerance) noexcept;

  const ParticleModel& model_;
  const ParticleState& from_;
  Mat3 spring_;
  Vec3 free_end_;
  Vec3 start_u_;
  double drag_n_m_;
  double floor_nn_ = 0;
  TipSampleState law_;  // of tip and particle; its cache goes on from trial to trial
  std::array<Held, kParticleContacts> held_;
  Trial trials_[2];
  Trial *best_ = &trials_[0], *trial_ = &trials_[1];  // exchanged, not copied: a trial is some kB
  int iterations_ = 0;
  int jumps_ = 0;
  bool unstable_ = false;
  bool asleep_;
};

}  // namespace telenano::physics
