#pragma once

#include <cstdint>
#include <span>

#include "telenano/master/calibration/dynamics_sample.h"

namespace telenano::calibration {

/// A value with its two-sided 95 % interval.
struct Interval {
  double value = 0;
  double low = 0;
  double high = 0;
};

enum class DynamicsVerdict : std::uint8_t {
  kGood,
  kTooShort,      ///< fewer than about 9 s, or too many long pauses in it
  kDoesNotMove,   ///< less than 0.5 mm or 30 encoder steps rms: held, blocked or without power
  kHeld,          ///< something as stiff as a hand holds it
  kChanges,       ///< its first half has another mass, damping or stiffness than its second
  kNotOfThisKind  ///< more than 10 % of the force is not explained: another kind of dynamics
};
/// What is the matter and what to do: one phrase; empty when it is good.
const char* verdict_text(DynamicsVerdict verdict) noexcept;

/// m ẍ + b ẋ + f_c sgn ẋ + k (x − x₀) = F(t − τ), of one axis.
struct AxisDynamics {
  DynamicsVerdict verdict = DynamicsVerdict::kTooShort;
  Interval mass_kg;        ///< m, apparent at the handle
  Interval damping_n_s_m;  ///< b, viscous
  Interval friction_n;     ///< f_c, Coulomb
  Interval stiffness_n_m;  ///< k: of nothing, where nobody holds on and gravity is balanced
  Interval latency_s;      ///< τ, from a force commanded to its effect in a position read
  double quantum_m = 0;    ///< smallest step between positions; 0: none seen
  double motion_rms_m = 0;
  double unexplained = 0;  ///< rms of the force that the law leaves, over the force's rms
};

/// Least squares of the law in its weak form. With a smooth w that vanishes with its derivative at both ends
/// of a window, integration by parts takes the derivatives off the encoder's positions,
///
///   m ∫ x w″ − b ∫ x w′ + f_c ∫ sgn(ẋ) w + k ∫ (x − x₀) w = ∫ F(t − τ) w                               (1)
///
/// (Shinbrot's modulating functions, Trans. ASME 76, 1954; Preisig & Rippin, Comput. Chem. Eng. 17, 1993).
/// w is sin⁴(πu) times 1 and the cosines and sines of up to eight periods a window of one second, half
/// overlapping: 1 to 10 Hz, where a hand moves. The integrals of x are trapezoids (exact but for the ends,
/// where w has vanished), those of the held force closed. A row's weight is what its noise would be from an
/// encoder step and 10 mN. τ is linear near its best value on a grid up to 12 ms.
///
/// Intervals   jackknife over sixteen stretches of the track, Student's t with 15 degrees of freedom: they
///             hold errors of the model that change with time, not those that are the same throughout.
/// Needs       a track of about 9 s, times increasing. Pauses of up to 20 ms are filled (filled_positions.h); windows with a
///             longer one, or with a command that took longer, are left out.
AxisDynamics identify_axis(std::span<const DynamicsSample> track);

}  // namespace telenano::calibration
