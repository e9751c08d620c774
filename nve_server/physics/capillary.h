#pragma once

#include <cstdint>

#include "nve_server/physics/long_range_point.h"

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
///           which assures that (films beyond reach the meniscus' own size, and the model its end).
/// Energy    U is 0 where the bridge ruptures, not at infinity: less would mean that the rupture gives back
///           what was never put in. What forming it sets free, -U(D_f) >= 0, is heat; what is left of F at a
///           rupture only lets the spring snap back. A loop with D_f = 0 costs U = F0 D_r/2 = 4 pi R gamma r
///           c^2 at constant curvature.
/// Symbols   D gap (nm) >= 0, R radius (nm), gamma surface tension (N/m).
/// Validity  r, D << R, no gravity. A meniscus of fewer than some ten molecules (RH below 20 %) is formal. In
///           contact (overlap > 0) the force stays at its value at touch.
/// Errors    Model; numerics some 1e-15.
/// Source    J. N. Israelachvili, Intermolecular and Surface Forces, 3rd ed. (2011), ch. 17.11; constant
///           volume: Y. I. Rabinovich et al., Adv. Colloid Interface Sci. 96 (2002) 213; rupture: G. Lian, C.
///           Thornton, M. J. Adams, J. Colloid Interface Sci. 161 (1993) 138.
class Capillary {
 public:
  Capillary() = default;
  /// Throws UserError with one line on what is out of range.
  explicit Capillary(const CapillaryParameters& parameters);

  bool active() const noexcept { return active_; }
  /// Of a bridge, 0 <= D <= rupture gap; nothing beyond.
  LongRangePoint at(double gap_nm, double radius_nm, const BridgeState& bridge) const noexcept;
  double energy_aj(double gap_nm, double radius_nm, const BridgeState& bridge) const noexcept;

  double kelvin_radius_nm() const noexcept { return kelvin_nm_; }
  double formation_gap_nm(double radius_nm) const noexcept;
  /// The bridge that forms there.
  BridgeState formed(double radius_nm) const noexcept;

 private:
  bool active_ = false;
  bool constant_volume_ = false;
  double force_per_radius_ = 0;  // 4 pi gamma c
  double kelvin_nm_ = 0;
  double reach_nm_ = 0;  // 2 r c
  double stretch_ = 1;   // 1 + theta/2
  double volume_nm3_ = 0;
  double film_nm_ = 0;
};

}  // namespace telenano::physics
