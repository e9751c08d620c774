#pragma once

#include <string>

#include "telenano/common/control/companding.h"
#include "telenano/common/control/method.h"
#include "telenano/common/control/passivity_controller.h"
#include "telenano/common/control/scaling.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::station {

/// The scales that a station may run with.
inline constexpr double kVelocityScaleMin = 1e-12, kVelocityScaleMax = 1;
inline constexpr double kForceScaleMin = 1, kForceScaleMax = 1e12;
/// Most that weak forces may be shown stronger than planned.
inline constexpr double kCompandingGainMax = 10;

/// Everything that a person may set at the station. Plain values with documented defaults; SI units.
struct StationConfig {
  double rate_hz = 1000;
  control::Scaling scaling{};  ///< α_v = 1e-6 (1 mm is 1 nm), α_F = 2e7 (50 nN is 1 N)
  control::Method method = control::Method::kModel;
  control::DamperDirection damper = control::DamperDirection::kAlongMotion;
  double leak_time_s = 0;  ///< stored passivity leaks away with this time constant; 0 = never
  /// Most stored passivity that is kept: what a hand may get back of what was put in. Twice what any scene's
  /// sample gave back at the device's force limit.
  double store_max_j = 0.25;

  double allowance_j = 0.010;  ///< E₀, energy that may ever be extracted beyond what is put in
  double well_max_j = 0.1;     ///< most that is credited for a sample's own energy, whatever the slave says
  double guaranteed_velocity_m_s = 0.5;  ///< v_max of the energy clamp
  double trip_velocity_m_s = 0.5;        ///< latched stop above it; at most guaranteed_velocity_m_s
  double force_safety = 0.8;             ///< ε: the force limit is ε f̂_a
  double slew_n_s = 4000;                ///< of increases and reversals of |f|
  double stale_hold_s = 0.020;           ///< the last force is held so long after the last new reply
  double stale_zero_s = 0.100;           ///< and has become zero after so long
  /// Longest round trip at which forces are shown, 0.05 to 10; 0: by the method (age_most_s).
  double force_age_s = 0;
  double engage_ramp_s = 0.200;      ///< from no force to the full one, on engage, resume and reconnect
  double device_damping_n_s_m = -1;  ///< certain damping of the device; negative: as the device reports
  /// Upper bound of how late the device's force acts, measured with that damping; negative: nobody has.
  double device_latency_s = -1;

  /// α_v α_F of what is felt without the twin, where the scaling is planned for the twin alone (no delay in its
  /// loop) and is stiffer than that; 0: it is planned for every method.
  double impedance_without_twin = 0;

  /// Of attraction before contact, where the slave's twin is felt; other methods show forces as they are.
  control::CompandingConfig companding{};

  bool require_deadman = true;        ///< the deadman button must be held to move and feel
  bool allow_unsafe_scaling = false;  ///< run beyond the exact bound (the force limit stays)

  /// Longest round trip at which the method `shown` shows a force. Reflected forces (none, ks, ks-clamp) 0.4
  /// s, methods whose ports keep an account (tdpa, wave, tank) 0.5 s, a local model 0.8 s: beyond, a hand
  /// meets what it has not touched for as long as it takes to react twice. Infinite for the twin, which has
  /// limits of its own.
  double age_most_s(control::Method shown) const noexcept;

  /// Throws UserError: one line with the key, its value and the expected range. `source` names the file or
  /// the flags.
  void validate(const std::string& source = "station configuration") const;
};

/// What the bounds of control/scaling say about this station, device and slave.
struct ScalingCheck {
  double impedance = 0;        ///< α_v α_F asked for
  double exact_bound = 0;      ///< of α_v α_F, at the delay that binds the method
  double loop_bound = 0;       ///< the same at the whole loop's delay
  double llewellyn_bound = 0;  ///< as published, for comparison: too permissive
  double device_force_scale =
      0;  ///< largest α_F that does not saturate the device at the slave's force limit
  double shown_stiffness_n_m = 0;  ///< α_v α_F k_c
  bool safe = false;               ///< impedance ≤ exact_bound
  bool saturates = false;          ///< α_F > device_force_scale: legal, the force limit cuts the peaks
  std::string text;                ///< for a person, one line: what was asked for and what is possible
  std::string advice;              ///< when not safe: what to do about it
  std::string note;                ///< when safe by the method alone: what the loop's delay does; else empty
};

/// What the slave's port is, for planning.
struct SlavePort {
  double coupling_stiffness_n_m = 0;
  double coupling_damping_n_s_m = 0;
  double force_max_nn = 0;
};

/// `delay_samples`: samples between a position read and the force that answers it, 0 in the same tick. How
/// many of them count is the method's: control::binding_delay_samples().
ScalingCheck check_scaling(const StationConfig& config, const device::DeviceInfo& device,
                           const SlavePort& slave, int delay_samples);

}  // namespace telenano::station
