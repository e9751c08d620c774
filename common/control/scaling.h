#pragma once

#include "telenano/common/base/constants.h"
#include "telenano/common/base/vec3.h"

namespace telenano::control {

/// Velocity (position) and force scale between hand and tip, SI over SI. The only place that crosses the
/// units: master and controller in m, N, J; nano side in nm, nN, aJ.
struct Scaling {
  double velocity = 1e-6;  ///< α_v: the tip moves α_v metres for a metre of the hand
  double force = 2e7;      ///< α_F: the hand feels α_F newtons for a newton at the tip

  Vec3 tip_displacement_nm(const Vec3& hand_displacement_m) const noexcept {
    return velocity * kNmPerM * hand_displacement_m;
  }
  Vec3 hand_displacement_m(const Vec3& tip_displacement_nm) const noexcept {
    return tip_displacement_nm / (velocity * kNmPerM);
  }
  Vec3 hand_force_n(const Vec3& tip_force_nn) const noexcept {
    return force / kNanonewtonPerNewton * tip_force_nn;
  }
  /// Power-scale factor: a hand joule stands for α_v/α_F tip joules, E_master = (α_F/α_v)·E_nano.
  double hand_energy_j(double tip_energy_aj) const noexcept {
    return force / velocity / kAttojoulePerJoule * tip_energy_aj;
  }
  double tip_energy_aj(double hand_energy_j) const noexcept {
    return hand_energy_j * velocity / force * kAttojoulePerJoule;
  }
  /// α_v α_F, the factor from a tip stiffness or damping (N/m, N·s/m) to the one the hand feels.
  double impedance() const noexcept { return velocity * force; }
};

/// What the bounds on α_v α_F depend on. The coupling k_c, b_c is the largest impedance that the slave's port
/// shows.
struct ScalingPlant {
  double device_damping_n_s_m = 2.0;  ///< b
  double adaptive_damping_n_s_m = 0;  ///< γ, while the damper acts
  double coupling_stiffness_n_m = 0;  ///< k_c
  double coupling_damping_n_s_m = 0;  ///< b_c
  double period_s = 1e-3;             ///< T
  int delay_samples = 0;              ///< d, of the whole loop
};

/// Exact sampled-data bound on α_v α_F for any discrete-passive environment behind the coupling (zero-order
/// hold, sampled position). With A = b_c + k_c T/2, D = k_c T/2, s = sin θ/2, c = cos θ/2,
///
///   α_v α_F ≤ min over θ in (0, π] of (b + γ cos θ)·2A s² / [(A² s² + D² c²)(1 − cos (d+1)θ)].
///
/// d = 0: (b − γ)/(b_c + k_c T/2) for γ ≥ 0. b_c = γ = 0: 2b/((d+1)² T k_c). Infinite without a coupling; at
/// most 0 where nothing is safe.
double exact_impedance_bound(const ScalingPlant& plant) noexcept;

/// The same where the force acts `delay_samples` late, which need not be whole: plant.delay_samples does not
/// count. Between d and d + 1 its inverse lies on a line: a spring held by a force that comes a part f of a
/// period late puts as much into the hand as (1 − f) of it with d samples and f of it with d + 1.
double exact_impedance_bound(ScalingPlant plant, double delay_samples) noexcept;

/// The region as published [Kim & Sitti, eqs. 21, 22, fig. 12], Llewellyn's criterion on the hybrid matrix,
/// no delay:
///
///   α_v α_F ≤ min over c in (0, 1] of 2(b + γc²)A(1 + c) / (c[A² − (A² − D²)c²]).
///
/// γ = b_c = 0: 8b/(k_c T). It is 4 to 17 times too permissive for a device that holds its force between
/// samples, and is here for comparison only.
double llewellyn_impedance_bound(const ScalingPlant& plant) noexcept;

/// α_F ≤ ε f̂_a/f̂_e, so that the largest tip force does not saturate the device.
double device_force_scale_bound(double force_safety, double device_force_max_n,
                                double tip_force_max_nn) noexcept;

}  // namespace telenano::control
