#pragma once

#include <array>
#include <memory>
#include <optional>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/contact/friction.h"
#include "telenano/nve_server/physics/law/plastic_contact.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The springs between the free end and the tip's apex in W, nm/nN: symmetric, positive semidefinite, 0 =
/// rigid. The virtual coupling is equal in all directions; the cantilever adds its own, with a cross term
/// where it bends and tilts at once.
using Compliance = Mat3;

inline constexpr int kMaxFeet = 3;  ///< a sphere in a pit stands on three points

/// A point that the tip leans on, and its share of the force (shares are >= 0 and sum to 1).
struct ActiveFoot {
  FootMemory memory;
  double share = 1;
};

/// How the contact radius changes with the normal force and with the effective radius.
struct ContactRadiusRates {
  double per_force_nm_nn = 0;
  double per_radius = 0;
};

/// What the last step changed: a step that goes on like it begins from there.
struct TipTrend {
  Vec3 move_w_nm = Vec3::Zero();  ///< of the free end; 0: nothing to go by
  Vec3 bend_w_nm = Vec3::Zero();  ///< of the apex, beside what `follow` said
  double force_nn = 0;
  ContactRadiusRates contact_radius_rates;
};

/// What the equilibrium remembers from one accepted step to the next.
struct TipState {
  TipSampleState law;
  std::array<ActiveFoot, kMaxFeet> feet;
  int foot_count = 0;
  bool started = false;
  Vec3 free_end_w_nm = Vec3::Zero();
  Vec3 apex_w_nm = Vec3::Zero();
  Vec3 normal_w = Vec3::UnitZ();
  double force_nn = 0;  ///< normal
  double overlap_nm = 0;
  double stiffness_n_m = 0;  ///< of the law
  double radius_nm = 0;
  double radius_force_nn = 0;  ///< -dU/dR
  double contact_radius_nm = 0;
  ContactRadiusRates contact_radius_rates;
  double radius_as_overlap = 0;  ///< η
  FrictionState friction;
  Mat3 follow = Mat3::Identity();  ///< ∂apex/∂free end, to predict the next apex from
  TipTrend trend;
  double stored_aj = 0;    ///< in the tip–sample law and the bristle
  bool under_way = false;  ///< no balance yet: the tip slides, and goes on sliding in the next step
  bool stuck = false;      ///< nor a way down: it stays until the free end moves
  double slide_part = 0;   ///< β of the slide that goes on
};

/// What yielded in a step, and where: at every foot that bore a part. The surface is not yet lowered
/// (marked_sample.h does).
struct TipFlow {
  struct Foot {
    Vec3 at_w_nm = Vec3::Zero();
    double normal_z = 1;
  };
  std::array<Foot, kMaxFeet> foot;
  int feet = 0;
  double from_radius_nm = 0;  ///< R_eff before
  double origin_radius_nm = 0;
  PlasticFlow flow;  ///< no depth: nothing yielded
};

struct TipSolution {
  SolveStatus status = SolveStatus::kOk;
  Branch branch = Branch::kFree;
  Vec3 apex_w_nm = Vec3::Zero();
  Vec3 force_w_nn = Vec3::Zero();     ///< on the tip, all of it
  Vec3 friction_w_nn = Vec3::Zero();  ///< the part of it that is friction
  Vec3 normal_w = Vec3::UnitZ();      ///< Σ share·normal: shorter than 1 when leaning on several feet
  double normal_force_nn = 0;         ///< repulsive positive
  double overlap_nm = 0;
  double radius_nm = 0;  ///< effective
  double contact_radius_nm = 0;
  double stiffness_n_m = 0;           ///< of the tip–sample law, along the normal
  double potential_aj = 0;            ///< of the tip–sample law
  double dissipated_aj = 0;           ///< in the jumps of this step
  double friction_stored_aj = 0;      ///< in the bristle
  double friction_dissipated_aj = 0;  ///< in this step
  TipFlow yielded;
  int jumps = 0;
  int iterations = 0;
  int feet = 0;            ///< that the tip leans on
  bool sliding = false;    ///< the contact slips over the sample
  bool slid = false;       ///< the tip went down a slope by a lateral instability
  bool under_way = false;  ///< and is not in balance: `force_w_nn` is that of the springs, not of the sample
  bool stuck = false;      ///< nor finds a way down from here
  bool outside = false;    ///< beyond the rim of the scan
  bool radius_clamped = false;  ///< wider than the pit it stands in
};

struct EquilibriumOptions {
  std::optional<FrictionParameters> friction{};
  /// L. Without it the force is along the normals (and friction), and a path over changing curvature may draw
  /// the energy that a changing radius is worth. For surfaces whose radius of curvature changes little over
  /// the width of the contact, a |∇R_eff| << R_eff: there the pointwise R_eff means something. On a scan that
  /// is rough on that scale L is as rough, the tip is caught at every pixel, and a step costs many more
  /// iterations.
  bool radius_force = false;
  /// The sample yields (plastic_contact.h). The state then belongs to the surface **with** the marks of
  /// `yielded`: whoever keeps it must press them before the next step. A flat surface cannot be pressed:
  /// there it is refused (UserError).
  std::optional<double> hardness_gpa{};
};

/// Quasi-static balance of a spherical tip between a sample and springs to a free end.
///
///   apex p = x_free + C (n F + L + f),   F = ∂U/∂δ (overlap δ, R_eff),   δ = R − distance(p + R e_z)
///   L = −∂U/∂R_eff ∇R_eff,   f = friction (friction.h)
///
/// C the compliance, n the surface's normal at the foot, U the law's potential: n F + L = −∇U(p). For a given
/// foot the balance along n is scalar: the law is advanced against the compliance c_n = nᵀCn, branches and
/// jumps included. The foot, normal and radius follow from p.
///
/// Flat sample without friction: nothing turns, the scalar balance is the answer. Otherwise Newton's method
/// with the law kept whole: the turning normal n(p) ≈ n + N(p − p_k) (N = ∂n/∂p) and the bristle's tangent K
/// (stick k(1 − nnᵀ), slip that of a force of given size; semismooth) change the compliance to S = A C, A =
/// (1 − C (F N − K))⁻¹, and the base overlap to δ_k − nᵀA(x_free + C (L + f) − p_k). A radius that changes by
/// g·(p − p_k) acts on the law as an overlap changed by η g·(p − p_k), η = F_R/F_δ, and by the symmetry of
/// U's second derivatives L changes by −η g (F − F_k): the law acts along n − η g, in which it feels the
/// overlap too. F_R is the law's own (radius_rates), of the other laws (F − δ F_δ/3)/R, exact where λ plays
/// no part, and F/R outside. Without `radius_force` the law still feels −η g, and acts along n alone. The
/// limit of friction goes with the contact radius a(F, R): along F through ∂a/∂F, and with the position
/// through ∂a/∂R g, which is part of −K. So is how friction turns with the normal: f stays across n, −n (N
/// f)ᵀ, and of the motion m only what lies across it counts, K_m N (n·m), K_m = −∂f/∂m. What is still left
/// out (∇g, with `radius_force`, and what several feet do) is found from the steps themselves
/// (balance_guards.h). A step that goes on like the last one begins from where that leads to second order:
/// the apex from `follow` and what was beside it last time, the force from its last change, the contact
/// radius at that force. Where F C N comes near 1 the tip is about to slide off a summit sideways: A is then
/// bounded and the iteration walks downhill to the next balance. Each trial starts from a copy of the law's
/// memory, which moves on once a step; only the guess of the curve's parameter goes on from trial to trial.
///
/// Slides. Where Newton's method finds nothing, the tip goes down as if overdamped: stages of the proximal
/// point method,
///   p_{j+1} = balance with compliance βC of the free end p_j + β(x_free − p_j),   0 < β <= 1,
/// each of which lowers the energy of springs and sample, however corrugated, and is easier to solve the
/// smaller β. β shrinks on failure and grows on success; at β = 1 the balance is that sought. A step takes
/// kMostIterations of Newton's iterations, all attempts together; what is left of the way is gone in the
/// next step (`under_way`). Meanwhile the springs pull with C⁻¹(p − x_free), which is `force_w_nn`, and the
/// sample with something else: the difference is the drag, and what it takes is not in the books here (the
/// port's charge has it, nve_slave.h). Where no stage lowers the energy the tip stays (`stuck`) until the
/// free end moves: there R_eff, which has no force of its own without `radius_force`, changes so much within
/// the reach of a foot, or between two feet, that the forces do not belong to the energy. Springs that are
/// rigid in some direction cannot hold a tip on its way: on them a slide is gone in one step, however long
/// that takes, or is not made.
///
/// Yield. With a hardness the law's advance may flow (plastic_contact.h); trials leave no trace in the
/// surface. While the tip relaxes it does not yield: what is overloaded in the balance found flows in the
/// next step.
///
/// Corners. The law acts on the largest overlap of the whole surface, δ = max_i δ_i over the feet i: a
/// potential of the position, U(δ), so that no path draws energy from it. Where the tip is pressed (F > 0)
/// into an edge, a groove or a pit, two or three feet share the largest overlap, and the force is F Σ α_i n_i
/// with shares α_i >= 0, Σ α_i = 1 (the subgradient of max δ_i): the shares follow from δ_i = δ_0, one linear
/// equation a foot,
///   MᵀSM β = δ_i − δ_0 − Mᵀ(A(x_free + C (L + f) − p_k) + S n_0 F),   M = (n_i − n_0),  β_i = α_i F,
/// which reduces the compliance that the law sees. Feet with a negative share are dropped, a deeper one is
/// taken in (active set); the last word has a search of the whole surface. Attracted (F <= 0), the tip takes
/// one side. So the bound on several contacts: force and energy are those of **one** contact at the largest
/// overlap, divided among the feet, never more; in truth each foot would carry its own (up to three times the
/// sum, in a pit). Its radius is Σ α_i R_i, and the friction that of one contact in the plane across Σ α_i
/// n_i.
///
/// Energy. Standing on one foot the work of the free end is Δ(U + ½ F_totᵀ C F_tot + bristle) + dissipated.
/// Exceptions: with several feet of different radii, U(δ, Σ α_i R_i) depends on the shares as well as on
/// the position, and where the foot passes from one place to another of the same overlap but other radius U
/// steps; a tip that slides off a summit (`slid`) loses energy that is in no book; a jump
/// on turning ground is booked as one along the normal.
class TipEquilibrium {
 public:
  TipEquilibrium(std::shared_ptr<const Surface> surface, const TipSampleLaw& law, double tip_radius_nm,
                 const EquilibriumOptions& options = {});

  /// Moves the free end to `free_end_w_nm`. Unless the status is kOk, `state` is left as it was. Takes at
  /// most kMostIterations iterations on springs that give in all directions.
  TipSolution advance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn,
                      TipState& state) const noexcept;

  /// advance() on a flat sample without friction, where the law alone says what is remembered. Of `solution`
  /// it writes what is not always the same there: begin with a new one. Unless that says kOk, `law` is left
  /// as it was.
  void advance_flat(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, TipSampleState& law,
                    TipSolution& solution) const noexcept;

  /// Height of the apex at which the sphere, coming straight down on (x, y), first touches the surface.
  double touch_height_nm(double x_nm, double y_nm) const noexcept;

  const Surface& surface() const noexcept { return *surface_; }
  const TipSampleLaw& law() const noexcept { return law_; }
  const EquilibriumOptions& options() const noexcept { return options_; }
  const std::optional<PlasticContact>& plastic() const noexcept { return plastic_; }
  double tip_radius_nm() const noexcept { return tip_radius_nm_; }

 private:
  TipSolution advance_flat(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn,
                           TipState& state) const noexcept;
  /// How Newton's method takes the effective radius, which changes with the position.
  enum class Radius {
    kFollowed,  ///< through its gradient: converges fast
    kLate,  ///< as it was one iteration ago: slow, but not led astray where the gradient jumps between feet
  };
  /// Where an iteration had the law jump, and how the law was afterwards.
  struct Jump {
    TipSampleState law;
    Vec3 apex_w_nm;
    double dissipated_aj;
  };
  struct Attempt {
    Radius radius = Radius::kFollowed;
    int iterations = 0;       ///< at most; one in which the law jumps counts kJumpCost
    double tolerance_nm = 0;  ///< 0: as exact as numbers are; for a stage on the way
    bool may_yield = true;
    std::optional<Jump>* last_jump = nullptr;  ///< of all iterations, if asked for
  };
  TipSolution balance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, const Vec3& start_w_nm,
                      TipState& state, const Attempt& attempt) const noexcept;
  TipSolution slide(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn, int iterations,
                    TipState& state) const noexcept;

  std::shared_ptr<const Surface> surface_;
  TipSampleLaw law_;
  double tip_radius_nm_;
  std::optional<Friction> friction_;
  std::optional<PlasticContact> plastic_;
  bool radius_force_;
  EquilibriumOptions options_;
};

}  // namespace telenano::physics
