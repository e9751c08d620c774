#pragma once

#include <memory>
#include <optional>

#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/law/plastic_contact.h"
#include "telenano/nve_server/physics/surface/mark_journal.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "telenano/nve_server/physics/surface/stroke_history.h"

namespace telenano::physics {

/// A sample of one potential that keeps marks: a session's own fields (tiles of them, where it has pressed),
/// the balance of the tip on them, and the heights that a viewer sees. One for each session; many trials,
/// then press() what the accepted one yielded.
///
/// Flow. Yield rule and law of flow are those of plastic_contact.h, in the overlap and the effective radius
/// of the fields at the apex: a contact flows where its normal force exceeds Y(a*), until the balance has
/// just that, with δ_p lower ground and R_p = a*/ε. A trial leaves the fields alone: lowered by d at all
/// softenings, they have at an apex what they had d above it, so that the trial's balance looks there, and
/// adds what ρ has risen. d = δ_p/c, c the cosine of the feet.
///
/// Shape. Flow at the contact radius a* lowers H by crater.h's level. Its rim is such that the volume is
/// π a*² d: what the flow works, F dδ_p = H π a*² dδ_p at yield, is the hardness times the volume displaced,
/// in a dent and in a groove alike, whatever the path. A share of it, the pile-up, stands round the rim. A
/// flow over a wide range of a* is pressed in pieces of kPiece in a*. Both in the fields of the apex and, at
/// the foot, in the heights.
///
/// Energy. U is that of the fields; a mark changes it at the apex by W(δ − d c, ρ') − W(δ, ρ). What a step
/// that flowed has lost is the tip's work, by the trapezium of its two balanced forces over its way, less Δ(U
/// + bristle) and what friction lost: second order in the step, never below 0, and no less than what jumps
/// lost. What the fields differ from the trial's (in ρ's slopes) is part of the next step's ΔU: the free
/// end's work is Δstored + lost over any number of steps, whatever was pressed.
///
/// Limits. The cosine of the feet stays what it was. A crater's fields are those of its own bump, not of the
/// dilation of what the tip would have cut: moving sideways in a dent the tip climbs a wall as wide as the
/// contact. Adhesion presses through Y as in plastic_contact.h.
class MarkedPotential {
 public:
  /// `unmarked` may end before it. Throws UserError unless the hardness is positive and finite and the
  /// pile-up within [0, 1].
  MarkedPotential(const ScanFields& unmarked, const SplineSurface& heights, const PotentialEquilibrium& scene,
                  const std::optional<FrictionParameters>& friction, double hardness_gpa, double pile_up);
  MarkedPotential(const MarkedPotential&) = delete;
  MarkedPotential& operator=(const MarkedPotential&) = delete;

  /// As PotentialEquilibrium::advance, with flow. What yielded is in the solution and pending: the state
  /// afterwards is that on the ground with it. Trials that follow forget it.
  TipSolution advance(const Vec3& free_end_w_nm, const Compliance& compliance_nm_nn,
                      PotentialState& state) noexcept;
  /// The last trial is what happened: its flow is pressed. No allocation.
  void accept(const TipSolution& accepted) noexcept;

  const SplineSurface& surface() const noexcept { return heights_; }
  const ScanFields& fields() const noexcept { return fields_->ground; }
  const PotentialEquilibrium& equilibrium() const noexcept { return equilibrium_; }
  /// To take a state over; what both are left with is what later steps begin from, with the last step below.
  SplineSurface& surface_to_restore() noexcept { return heights_; }
  ScanFields& fields_to_restore() noexcept { return fields_->ground; }
  /// The last accepted step, from which the work of one that flows is counted; none at first.
  struct LastStep {
    bool known = false;
    bool under_way = false;
    Vec3 force_w_nn = Vec3::Zero();
    Vec3 apex_w_nm = Vec3::Zero();
    double potential_aj = 0;
    double friction_stored_aj = 0;
  };
  /// Strokes are kept, as many as StrokeHistory holds: from the first mark after touching to parting. exchange_stroke()
  /// puts the ground back to what it was before the last of them; once more, and it is as now. Then keep_undone(), or
  /// not. False: there is none.
  bool exchange_stroke() noexcept;
  void keep_undone() noexcept;
  /// Nothing of what has been pressed until now can be taken back.
  void forget_strokes() noexcept {
    strokes_.clear();
    in_stroke_ = false;
  }
  /// Who marks from now on; 0: as before. Another's marks are another stroke, also where the tip has not parted.
  void set_maker(std::uint64_t maker) noexcept {
    if (maker == 0 || maker == maker_) return;
    maker_ = maker;
    in_stroke_ = false;
  }
  /// Who made the stroke that exchange_stroke() would take back; 0: there is none, or it is not known.
  std::uint64_t stroke_maker() const noexcept { return strokes_.maker(); }
  const LastStep& last_step() const noexcept { return last_; }
  void set_last_step(const LastStep& last) noexcept { last_ = last; }
  /// Steps that left a mark.
  std::uint64_t marks() const noexcept { return marks_; }
  /// From now on hears of every mark in the heights; null: nobody.
  void set_journal(MarkJournal* journal) noexcept { journal_ = journal; }

 private:
  /// The fields, and what a trial has lowered them by.
  struct Yielding final : ContactFields {
    explicit Yielding(const ScanFields& unmarked) : ground(ScanFields::for_marks(unmarked)) {}
    void contact_at(const Vec3& apex, ContactJet& jet) const noexcept override {
      ground.contact_at(Vec3(apex.x(), apex.y(), apex.z() + lowered_nm), jet);
      jet.log_radius += log_radius_rise;
    }
    void growing_at(const Vec3& apex, const SofteningRule& rule, ContactJet& jet) const noexcept override {
      ground.growing_at(Vec3(apex.x(), apex.y(), apex.z() + lowered_nm), rule, jet);
      jet.log_radius += log_radius_rise;
    }
    void values_at_softening(const Vec3& apex, double softening_nm, double& overlap_nm,
                             double& log_radius) const noexcept override {
      ground.values_at_softening(Vec3(apex.x(), apex.y(), apex.z() + lowered_nm), softening_nm, overlap_nm,
                                 log_radius);
      log_radius += log_radius_rise;
    }
    void at_softening(const Vec3& apex, double softening_nm, ContactJet& jet) const noexcept override {
      ground.at_softening(Vec3(apex.x(), apex.y(), apex.z() + lowered_nm), softening_nm, jet);
      jet.log_radius += log_radius_rise;
    }
    ScanFields ground;
    double lowered_nm = 0;
    double log_radius_rise = 0;
  };
  struct Trial {
    double a_nm = 0;  ///< a* it flowed to; 0: elastic
    double lowered_nm = 0;
    double cosine = 1;
    double overload = 0;  ///< F − Y(a*), over πHa*²
    TipSolution solution;
    PotentialState state;
  };
  struct Onset;
  struct Bracket;
  std::optional<Onset> onset_of(const TipSolution& elastic) const noexcept;
  double first_radius_nm(const Onset& onset, const Compliance& c) const noexcept;
  const Trial* flow(const Onset& onset, const Vec3& free_end, const Compliance& c,
                    const PotentialState& from) noexcept;
  void tell_flow(const Onset& onset, const Trial& kept, TipSolution& solution) const noexcept;
  double lost_aj(const TipSolution& solution) const noexcept;
  void flow_to(double a_nm, const Onset& onset, const Vec3& free_end, const Compliance& c,
               const PotentialState& from, Trial& trial) noexcept;

  double overload(const TipSolution& solution, double origin_nm) const noexcept;

  std::shared_ptr<Yielding> fields_;
  SplineSurface heights_;
  PlasticContact plastic_;
  PotentialEquilibrium equilibrium_;
  double tip_radius_nm_;
  double last_radius_nm_;
  double pile_up_;
  Trial elastic_, trials_[2];
  double pending_lowered_nm_ = 0;
  LastStep last_;
  std::uint64_t marks_ = 0;
  MarkJournal* journal_ = nullptr;
  StrokeHistory strokes_;
  std::uint64_t maker_ = 0;
  bool in_stroke_ = false;  // the tip has marked since it touched
};

}  // namespace telenano::physics
