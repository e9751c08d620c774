#pragma once

#include <cstdint>

#include "telenano/nve_server/physics/long_range/long_range_point.h"

namespace telenano::physics {

enum class CapillaryModel : std::uint8_t {
  kConstantCurvature,  ///< the liquid follows the vapour: slow compared with condensation
  kConstantVolume      ///< the liquid stays as it is: fast
};

/// A liquid bridge between tip and sample. None if the humidity is 0 (and no volume is given).
struct CapillaryParameters {
  double humidity_percent = 0;
  double contact_angle_tip_deg = 0;
  double contact_angle_sample_deg = 0;
  double surface_tension_n_m = 0.0728;  ///< of water at 20 °C
  CapillaryModel model = CapillaryModel::kConstantCurvature;
  double volume_nm3 = 0;  ///< constant volume: 0 = what the humidity condenses where the bridge forms
  double film_nm = 0;     ///< both adsorbed films together: the bridge forms at this gap; 0 = at touch
};

/// The part of the dry attraction between tip and sample that the liquid takes away (tip_sample_law.h).
struct DisplacedAttraction {
  double work_n_m = 0;         ///< of the work of adhesion, w - w_SLS
  double cut_off_nm = 0;       ///< a0 of van der Waals
  bool van_der_waals = false;  ///< else it ends at the range of Dugdale's stress, 0.974 a0
};

/// What must be remembered of a bridge.
struct BridgeState {
  bool present = false;
  double volume_nm3 = 0;  ///< constant volume only
  double rupture_gap_nm = 0;
};

/// Force of a liquid bridge between a sphere and a plane.
///
/// Formula   Kelvin radius r = gamma Vm/(R_gas T)/(-ln RH) = 0.539 nm/(-ln RH) for water at 20 °C; c the mean
///           cosine of the contact angles; F0 = 4 pi R gamma c.
///           Constant curvature: the pressure gamma/r acts where the gap D + x^2/2R is below 2 r c,
///             F = -F0 (1 - D/D_r), U = -F0 (D_r - D)^2/(2 D_r), D_r = 2 r c, where the bridge ends by
///             itself.
///           Constant volume: V = pi x^2 (D + x^2/4R), the pressure gamma 2c/(D + x^2/2R) acts inside x:
///             F = -F0 (1 - D/s), s = sqrt(D^2 + V/(pi R)),  U = -F0 (s(D) - D - s(D_r) + D_r),
///             rupture at D_r = (1 + theta/2) V^(1/3), theta the mean contact angle.
///           Without a given volume, that of the constant curvature where the bridge forms, V = pi R ((2 r
///           c)^2 - D_f^2): the two models then start from the same force.
/// Formation At the gap D_f = film_nm, when the adsorbed films touch, at the latest where the bridge would
///           rupture; for the volume from the humidity also D_f <= sqrt 2 r c and D_f^3 <= pi R (2 r c)^2/2,
///           which assures that (films beyond reach the meniscus' own size, and the model its end). And only
///           where it sets energy free: where -U(D_f) is more than the energy of the attraction that the
///           liquid displaces, rigid and outside 2 pi R (w - w_SLS) a0^2/(a0 + D); else at the first gap on
///           the way in where it does. At constant curvature that is
///             (D_r - D)^2/(2 D_r) >= a0^2/(a0 + D) (w - w_SLS)/(2 gamma c),
///           which is nowhere so unless D_r > 2 a0 (w - w_SLS)/(2 gamma c): a liquid that reaches no farther
///           than what it displaces does not condense, and dry air is dry (without van der Waals outside 2 a0
///           is the range of Dugdale's stress).
/// Energy    U is 0 where the bridge ruptures, not at infinity: less would mean that the rupture gives back
///           what was never put in. What forming it sets free is heat, and so is what the tip gains at the
///           rupture as the air comes back between (2 pi R (w - w_SLS) a0^2/(a0 + D_r)); what is left of F at
///           a rupture only lets the spring snap back. Rigid, a loop with D_f = 0 costs F0 D_r/2 = 4 pi R
///           gamma r c^2 at constant curvature, less 2 pi R (w - w_SLS) a0 D_r/(a0 + D_r).
/// Symbols   D gap (nm) >= 0, R radius (nm), gamma surface tension (N/m).
/// Validity  r, D << R, no gravity. A meniscus of fewer than some ten molecules (RH below 20 %) is formal. In
///           contact (overlap > 0) the force stays at its value at touch, as if the meniscus did not deform
///           the bodies: its own lambda_m = 2 (gamma/r) (R/(pi 2 gamma c K^2))^(1/3) must be small (error in
///           the pull-off 3 % at 0.1, 14 % at 0.5; wholly wrong for rubber).
/// Errors    Model; numerics some 1e-15.
/// Source    J. N. Israelachvili, Intermolecular and Surface Forces, 3rd ed. (2011), ch. 17.11; constant
///           volume: Y. I. Rabinovich et al., Adv. Colloid Interface Sci. 96 (2002) 213; rupture: G. Lian, C.
///           Thornton, M. J. Adams, J. Colloid Interface Sci. 161 (1993) 138.
class Capillary {
 public:
  Capillary() = default;
  /// Throws UserError with one line on what is out of range.
  explicit Capillary(const CapillaryParameters& parameters, const DisplacedAttraction& displaced = {});

  /// 2 gamma c: what of a dry work of adhesion the liquid takes over. 0 if there is none.
  static double adhesion_n_m(const CapillaryParameters& parameters) noexcept;

  /// Is there a bridge at any gap?
  bool active() const noexcept { return active_; }
  /// Of a bridge, 0 <= D <= rupture gap. The caller's tip ruptures it: a rounding beyond, the formulas go on.
  LongRangePoint at(double gap_nm, double radius_nm, const BridgeState& bridge) const noexcept;
  double energy_aj(double gap_nm, double radius_nm, const BridgeState& bridge) const noexcept;

  double kelvin_radius_nm() const noexcept { return kelvin_nm_; }
  bool constant_volume() const noexcept { return constant_volume_; }
  /// 4 pi gamma c: F0 over R.
  double force_per_radius_n_m() const noexcept { return force_per_radius_; }
  /// Of a rigid tip outside, without what retardation and cone change in the displaced attraction; with the
  /// energy looked at only if settled().
  double formation_gap_nm(double radius_nm) const noexcept;
  bool settled() const noexcept { return !constant_volume_ || displaced_.work_n_m == 0; }
  /// What forming there sets free (aJ), likewise; less than 0: it would take energy.
  double freed_aj(double gap_nm, double radius_nm) const noexcept;
  /// The bridge that forms there (none if there is no liquid).
  BridgeState formed(double radius_nm) const noexcept {
    return formed_at(formation_gap_nm(radius_nm), radius_nm);
  }
  BridgeState formed_at(double gap_nm, double radius_nm) const noexcept;

 private:
  bool active_ = false;
  bool constant_volume_ = false;
  double force_per_radius_ = 0;  // 4 pi gamma c
  double kelvin_nm_ = 0;
  double reach_nm_ = 0;  // 2 r c
  double stretch_ = 1;   // 1 + theta/2
  double volume_nm3_ = 0;
  double film_nm_ = 0;
  DisplacedAttraction displaced_;
};

}  // namespace telenano::physics
