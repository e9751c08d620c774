#pragma once

#include "telenano/nve_server/physics/long_range/capillary.h"
#include "telenano/nve_server/physics/long_range/electrostatic.h"
#include "telenano/nve_server/physics/long_range/tip_van_der_waals.h"
#include "telenano/nve_server/physics/long_range/van_der_waals.h"

namespace telenano::physics {

/// Forces beside van der Waals and contact; each 0 means: none.
struct LongRangeParameters {
  double retardation_nm = 0;  ///< lambda_r of van der Waals, about 100
  double cone_half_angle_deg =
      0;                      ///< of the tip above its sphere, from the axis; with the height or not at all
  double cone_height_nm = 0;  ///< from the apex to the cone's upper end
  double tip_bias_v = 0;      ///< against the sample, with the contact potential
  CapillaryParameters capillary;
};

/// The sum G of all that is added to "van der Waals outside, contact inside" (tip_sample_law.h): what
/// retardation and cone change in van der Waals, the electrostatic attraction, the capillary bridge.
///
/// With a bridge all of van der Waals is that under liquid. G is the same function of the overlap delta
/// outside and inside, so the handover between van der Waals and contact and the offset of their energies
/// stay where they are: force and energy remain continuous and no adhesion counts twice.
///   delta < 0   van der Waals and electrostatic at d = a0 - delta, the bridge at D = -delta;
///   delta >= 0  the force stays at its value at touch (the flattened contact is not added to the capacitor
///               or to the meniscus): U = U(0) + G(0) delta. G is continuous, its slope is not.
/// For delta < 0 every term without the bridge's memory is attractive, or a correction of an attraction, and
/// the whole outside law is completely monotone in the gap (all its derivatives have one sign): it is
/// followed by one stable segment from far away to one fold.
class LongRange {
 public:
  /// Throws UserError with one line on what is out of range. `hamaker_aj` = 0: no van der Waals to correct;
  /// it is that of the dry contact, of which the liquid of a bridge takes `displaced` away.
  LongRange(const LongRangeParameters& parameters, double hamaker_aj, double cut_off_nm,
            const DisplacedAttraction& displaced = {});

  bool active() const noexcept {
    return van_der_waals_.active() || electrostatic_.active() || capillary_.active();
  }
  bool has_bridge() const noexcept { return capillary_.active(); }
  const Capillary& capillary() const noexcept { return capillary_; }
  /// Where the bridge forms that a tip coming down meets, not yet in contact: capillary.h says where, with
  /// what retardation and cone change in the attraction that the liquid displaces.
  double formation_overlap_nm(double radius_nm) const noexcept;

  /// Force and stiffness at any overlap.
  LongRangePoint evaluate(double overlap_nm, double radius_nm, const BridgeState& bridge) const noexcept;
  /// The same for delta <= 0, at 0 with the stiffness of the open gap.
  LongRangePoint evaluate_open(double overlap_nm, double radius_nm, const BridgeState& bridge) const noexcept;
  double energy_aj(double overlap_nm, double radius_nm, const BridgeState& bridge) const noexcept;

  /// G and its energy at overlap 0, from which those of every pressed tip follow: force G, energy U + G
  /// delta.
  struct Touch {
    double force_nn = 0;
    double energy_aj = 0;
  };
  Touch at_touch(double radius_nm, const BridgeState& bridge) const noexcept;

 private:
  const TipVanDerWaals& van_der_waals(const BridgeState& bridge) const noexcept {
    return bridge.present ? wet_van_der_waals_ : van_der_waals_;
  }
  double freed_aj(double gap_nm, double radius_nm) const noexcept;

  double cut_off_nm_;
  TipVanDerWaals van_der_waals_, wet_van_der_waals_;
  TipVanDerWaals::Gap touch_, wet_touch_;  // of them
  Electrostatic electrostatic_;
  Capillary capillary_;
};

/// Where a tip that comes from far away on a spring jumps to contact, by the attraction alone (no bridge
/// yet): the gap d = a0 - delta at which the attraction's slope has grown to the spring's stiffness. For
/// set-up, not for loops; 0 if the spring is stiffer than the slope at the cut-off. With van der Waals alone
/// d = (H R/(3 k))^(1/3).
double jump_to_contact_gap_nm(const VanDerWaals& van_der_waals, const LongRange& long_range,
                              double cut_off_nm, double stiffness_n_m, double radius_nm) noexcept;
double jump_to_contact_gap_nm(const VanDerWaals& van_der_waals, double stiffness_n_m,
                              double radius_nm) noexcept;

}  // namespace telenano::physics
