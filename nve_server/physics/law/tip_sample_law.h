#pragma once

#include <cstdint>
#include <memory>

#include "telenano/nve_server/physics/contact/contact_law.h"
#include "telenano/nve_server/physics/contact/joined_law.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"
#include "telenano/nve_server/physics/contact/maugis_table.h"
#include "telenano/nve_server/physics/law/contact_medium.h"
#include "telenano/nve_server/physics/long_range/long_range.h"

namespace telenano::physics {

enum class Branch : std::uint8_t { kFree, kVanDerWaals, kNonContact, kContact };
/// On the contact law's curve, not outside it.
constexpr bool is_on_curve(Branch branch) noexcept {
  return branch == Branch::kContact || branch == Branch::kNonContact;
}

/// One sphere on one locally spherical sample: what the force law needs, in nm, nN, GPa, N/m.
struct TipSampleParameters {
  double contact_modulus_gpa = 0;          ///< K = 4E*/3
  double work_of_adhesion_n_m = 0;         ///< w
  double equilibrium_distance_nm = 0.165;  ///< z0 of Maugis–Dugdale = a0 of van der Waals
  bool van_der_waals =
      true;  ///< Hamaker constant from w (H = 12 pi a0^2 w), so that no adhesion is counted twice
  ContactLaw model = ContactLaw::kMaugisDugdale;
  MaugisMethod method = MaugisMethod::kDirect;
  LongRangeParameters long_range{};
};

/// What need not be computed again while radius and compliance stay; private to the law.
struct TipSampleCache {
  double radius_nm = -1;
  bool wet = false;  // under the liquid of a bridge
  ContactScales scales;
  MaugisDugdale curve{1.0};
  AdhesiveCurve adhesive;
  bool tabulated = false;  // at this radius
  OutsideLaw outside{1.0};
  bool has_handover = false;
  Handover handover;
  bool has_parting = false;
  Parting parting;
  // The last two handovers in contact, to extrapolate u/lambda^2 from.
  double handover_lambda[2] = {0, 0};
  double handover_ratio[2] = {0, 0};
  // The last state on the curve, in contact to extrapolate from.
  double lambda = 0;
  double u = 0;
  bool has_last = false;
  CurvePoint last;
  // With long-range forces: the last state, and the end of the curve, at their radii.
  double far_radius_nm = -1;
  double far_compliance = -1;
  double far_base_nm = 0;
  double far_base_rate = 0;  // dZ/dx
  bool far_contact = false;
  double far_parameter = 0;  // x inside
  double fold_radius_nm = -1;
  CurvePoint rigid_fold;
};

/// What must be remembered between steps: which of the stable states the tip is in, and a warm start. A state
/// belongs to one law; start a new one when the parameters change.
struct TipSampleState {
  Branch branch = Branch::kFree;
  double overlap_nm = -1e9;
  double warm = 0;  ///< private to the law (the curve's parameter)
  BridgeState bridge;
  TipSampleCache cache;

  /// `*this = from`, as far as the law can tell. Where both have been at one radius with a table, most of the
  /// cache is the same in both, or not looked at; what moves is a sixth of it.
  void go_on_from(const TipSampleState& from) noexcept {
    if (!cache.tabulated || !from.cache.tabulated || cache.radius_nm != from.cache.radius_nm) {
      *this = from;
      return;
    }
    branch = from.branch;
    overlap_nm = from.overlap_nm;
    warm = from.warm;
    cache.lambda = from.cache.lambda;
    cache.u = from.cache.u;
    cache.has_last = from.cache.has_last;
    cache.last = from.cache.last;
  }
};

enum class SolveStatus : std::uint8_t { kOk, kNotConverged, kNonFinite };

/// An equilibrium of the tip between the sample and a spring to the base.
struct Equilibrium {
  SolveStatus status = SolveStatus::kOk;
  Branch branch = Branch::kFree;
  double overlap_nm = 0;         ///< delta, positive beyond touching
  double force_nn = 0;           ///< repulsive positive
  double stiffness_n_m = 0;      ///< dF/d(delta) of the tip–sample law alone
  double contact_radius_nm = 0;  ///< a; 0 without contact
  double potential_aj = 0;       ///< of the tip–sample law alone, 0 at infinite distance
  double dissipated_aj = 0;      ///< lost in the jumps of this advance, >= 0
  int jumps = 0;
  bool bridge = false;  ///< a liquid bridge spans the gap
};

/// Van der Waals joined to a contact law (joined_law.h), with memory of the branch.
///
/// The tip has at most two stable states at a base position: outside (free, or van der Waals) and inside (the
/// stable segment of the law's curve). It stays in the one where it is until that one ends: outside
/// at the jump to contact or at the handover, inside at the fold of Z = delta + F/k or at the handover; then
/// it goes over to the other at the same base position (overdamped: what the potential loses there is
/// dissipated; at the handover, too, which is no jump of the force: joined_law.h). Hence over any path at
/// constant radius
///   integral of F dZ = change of (U + F^2/(2k)) + dissipated,
/// and one long step gives the same as many short ones. When radius or compliance change between two steps
/// the branch is carried over; if it no longer exists there the tip goes over to the other.
///
/// Long-range forces (long_range.h) are added on both sides; there may then be more stable states, and the
/// bridge is a second memory (long_range_step.h). What is said above holds.
///
/// Under the liquid of a bridge tip and sample attract each other less. With Young's equation, gamma_SV -
/// gamma_SL = gamma cos(theta) for both, the wetted contact's work of adhesion is
///   w_SLS = w - 2 gamma c   (capillary.h),
/// and what goes with w does so there, too: the Maugis–Dugdale law, and the Hamaker constant H = 12 pi a0^2
/// w_SLS with retardation and cone. So the pull-off of a rigid sphere, 4 pi R gamma c + 2 pi R w_SLS, is the
/// dry one; elastic bodies part at more, since the far-reaching meniscus deforms them less. w is that of the
/// dry contact; what adsorbed films take of it (their spreading pressure) is left out. Where w_SLS would be
/// less than kLeastWetShare of w, that is taken: w and the angles contradict each other.
/// Source: A. Fogden, L. R. White, J. Colloid Interface Sci. 138 (1990) 414; D. Maugis, B. Gauthier-Manuel,
/// J. Adhes. Sci. Technol. 8 (1994) 1311.
class TipSampleLaw {
 public:
  /// Throws UserError unless modulus, work of adhesion and equilibrium distance are finite and positive and
  /// the long-range parameters within their ranges; and for Hertz with van der Waals, and long-range terms
  /// with anything but Maugis–Dugdale by the direct method. With the method kTable it makes the table of
  /// `nominal_radius_nm`, which must then be positive; copies of the law share it. At any other radius lambda
  /// is another one, and the direct method takes over.
  explicit TipSampleLaw(const TipSampleParameters& parameters, double nominal_radius_nm = 0);

  /// Moves the base quasi-statically from where the state was to `base_overlap_nm` (the overlap that there
  /// would be without any force) against a spring of compliance `compliance_nm_nn` (0 = rigid: displacement
  /// control) at the local radius `radius_nm`, resolving every jump on the way. F = (base_overlap − delta) /
  /// compliance. No allocation. A non-finite or impossible argument gives kNonFinite with no force and leaves
  /// the state as it was.
  Equilibrium advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                      TipSampleState& state) const noexcept;

  /// The same as one of several trials of a step: `again` is `from` before it, and what the trial before
  /// found (in `again`) only a place to start from. The potential may lack what add_joining_energy() adds
  /// once the last trial is known: it depends on the radius alone, but takes a search.
  Equilibrium try_advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                          const TipSampleState& from, TipSampleState& again) const noexcept;
  void add_joining_energy(Equilibrium& eq, TipSampleState& again) const noexcept;

  /// Makes again what of a cache follows from its radius, and from its being wet: for one of which only the
  /// rest was kept.
  void derive(TipSampleCache& cache) const noexcept;

  const TipSampleParameters& parameters() const noexcept { return parameters_; }
  ContactScales scales(double radius_nm) const noexcept;
  double lambda(double radius_nm) const noexcept { return scales(radius_nm).lambda; }
  const LongRange& long_range() const noexcept { return long_range_; }
  /// Dry, and under the liquid of a bridge (the same where there is none).
  const ContactMedia& media() const noexcept { return media_; }
  /// Without Hamaker constant if there is no van der Waals outside. Dry.
  const VanDerWaals& van_der_waals() const noexcept { return media_.dry.van_der_waals(); }
  /// Largest attraction of the dry contact alone under load control, positive; pull_off.h has that of all
  /// terms. For set-up, not for loops.
  double pull_off_nn(double radius_nm) const noexcept;
  /// No attraction on a tip of this radius is greater: 2 pi w R bounds the pull-off of every theory (DMT),
  /// dry or wet, and the other terms are greatest at touch.
  double attraction_bound_nn(double radius_nm) const noexcept;

 private:
  void prepare(double radius_nm, bool wet, TipSampleCache& cache) const noexcept;

  Equilibrium advance_extended(double base_overlap_nm, double compliance_nm_nn, TipSampleState& state,
                               bool join_energy) const noexcept;
  Equilibrium advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                      TipSampleState& state, bool join_energy) const noexcept;
  bool joins_later() const noexcept { return long_range_.active() && parameters_.van_der_waals; }

  TipSampleParameters parameters_;
  ContactMedia media_;
  LongRange long_range_;
  std::shared_ptr<const MaugisTable> table_;
};

/// Of w: the least work of adhesion that is taken under liquid.
inline constexpr double kLeastWetShare = 0.01;

}  // namespace telenano::physics
