#pragma once

#include "telenano/common/base/constants.h"

namespace telenano::control {

/// The experiment of Colgate & Brown (ICRA 1994, CB): a mass m with its own viscous damping b, position
/// sampled every T, force held between samples, touching a virtual wall of stiffness K and virtual damping B.
struct HapticDisplay {
  double damping_n_s_m = 2.0;  ///< b > 0, of the hardware
  double mass_kg = 0.25;       ///< m > 0
  double period_s = 1e-3;      ///< T > 0
};

/// H(z) = z⁻ᵈ [K + B G(z)],  G(z) = (1 − z⁻¹) / (T + τ − τ z⁻¹): backward difference, and a first-order
/// filter on it by the same rule (τ = 0: none).
struct VirtualDamper {
  double damping_n_s_m = 0;  ///< B, of either sign
  double filter_s = 0;       ///< τ = 1/(2πf)
  int delay_samples = 0;     ///< d, of spring and damper alike
};

/// Largest K such that the display is passive (CB's theorem):
///
///   b > T/2 / (1 − cos θ) · Re{(1 − e^{−jθ}) H(e^{jθ})}   for all θ = ωT in (0, π].
///
/// With 1 − e^{−jθ} = 2j s e^{−jθ/2}, s = sin θ/2, this is
///
///   2b/T > K sin((d+½)θ)/s − 2B Re{e^{−j(d+1)θ} / (T + τ − τ e^{−jθ})},
///
/// evaluated on a grid and refined (error below 1e-9). NaN where no K >= 0 is passive, be it that B alone is
/// not.
double passive_stiffness(const HapticDisplay& display, const VirtualDamper& damper) noexcept;

/// The same in closed form: d = 0: (2/T)(b − B T/(T + 2τ)) for B >= 0, (2/T)(b + B) for B < 0; B = 0:
/// 2b/((1 + 2d)T). NaN where there is none, or where it is not positive.
double passive_stiffness_closed(const HapticDisplay& display, const VirtualDamper& damper) noexcept;

/// Least K, rising from 0, at which a hand of infinite mass, held by a spring so that it resonates at some
/// θ = ωT in (0, theta_max], is driven up by the wall. To first order in the wall (exact for infinite mass)
/// the oscillation of frequency ω grows when b ω + Im{H(e^{jθ}) e^{−jθ/2}} 2s/θ < 0, e^{−jθ/2} 2s/θ being the
/// hold; so
///
///   K sin((d+½)θ) = b θ²/(2sT) + 2 s B Re{e^{−j(d+1)θ} / (T + τ − τ e^{−jθ})}.
///
/// NaN where such a hand is driven up at K → 0 already. Up to π: beyond, at 2π − θ, sine and response are
/// what they are at θ, and the damping's part, which goes with θ², is larger.
double heavy_hand_stiffness(const HapticDisplay& display, const VirtualDamper& damper,
                            double theta_max = kPi) noexcept;

}  // namespace telenano::control
