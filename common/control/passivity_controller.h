#pragma once

#include "common/base/vec3.h"
#include "common/control/energy_observer.h"
#include "common/control/method.h"

namespace telenano::control {

struct PassivityConfig {
  Method method = Method::kKsClamp;
  double period_s = 1e-3;            ///< T, for which a force is held
  double allowance_j = 0.010;        ///< E₀, what may be extracted at most
  double velocity_max_m_s = 0.5;     ///< up to which the guarantee holds; the velocity trip is at or below it
  double damping_certain_n_s_m = 0;  ///< b, the device's own viscous damping that is certainly there
  double shown_stiffness_n_m = 0;    ///< K = α_v α_F k_c, the largest that can be shown
  double shown_damping_n_s_m = 0;    ///< B = α_v α_F b_c
  double position_quantum_m = 0;     ///< q, of the encoder
};

/// Time-domain passivity controller of the station's port. Forces act on the hand (frame H, N).
///
/// Order of calls in a tick: observe() with the force that acted in the interval that just ended, then
/// damper_force() to be added to the rendered force, then — after all other limits — force_bound_n() on the
/// norm of the sum.
///
/// **`ks`** [Kim & Sitti, eqs. 14–17], as published. With the sign of this code,
///   E(k) = E(k−1) − F(k−1)·Δx(k) + γ(k)|Δx(k)|²/T,
///   γ(k) = −E(k−1)·T/|Δx(k)|² if E(k−1) < 0, else 0;   damper force −γ(k) Δx(k)/T.
/// (The paper prints γ = ΔE/Δx² and means the energy γΔx²; as a damping in N·s/m it is γT/Δx².) Since F of
/// the next interval contains the damper's force, its work is booked twice: once assumed, once done. γ has no
/// cap. Both are kept here to show what they do.
///
/// **`ks-clamp`**, three parts.
/// 1. Ledger: E(k) = E(k−1) − F(k−1)·Δx(k) with the total force applied. If E < 0, E ← min(0, E + c), with c
/// the energy
///    certainly lost in the device's own damping: ∫b v² dt ≥ b|Δx|²/T (Cauchy–Schwarz). Credit only repays a
///    deficit, so E never exceeds the energy put in plus the energy certainly dissipated. Without it the
///    small leak of a sampled wall (which a device with b > KT/2 pays for, so that it is passive at the hand)
///    would fade the wall to nothing. With a quantised encoder Δx is known to ±q an axis only, and b q²/T of
///    a flickering last digit would be a credit for nothing: the credit is taken over windows long enough for
///    |Δx| ≥ 8 q, as b (|Δx| − q)²/t_window; windows do not overlap, so the bound stays certain.
/// 2. Damper γ = −E·T/|Δx|² along the motion, capped at γ ≤ b − KT/2 − |B|: it is itself sampled, and beyond
/// the cap
///    it makes the port active (Colgate's bound). What the cap leaves stays in the ledger. Where K > 2b/T the
///    cap is zero: the damper can then do nothing at all.
/// 3. Pre-commit clamp: |F(k)| ≤ (E(k) + E₀)/(v_max T). The next interval cannot take out more than
/// |F|·v_max·T, so
///    E(k+1) ≥ E(k) − |F(k)| v_max T ≥ −E₀ for every motion below v_max: by induction no hand extracts more
///    than E₀ beyond what is certainly dissipated. (E₀ = 0 would never let the first contact begin.) An
///    interval that comes out k periods long may overdraw that by (k − 1)·|F|·v_max·T; once, since no force
///    is given until it is repaid.
class PassivityController {
 public:
  explicit PassivityController(const PassivityConfig& config) noexcept;

  /// `dt_s` is the length of the interval. Arguments must be finite, dt_s > 0.
  void observe(const Vec3& applied_force_h_n, const Vec3& hand_pos_h_m, double dt_s) noexcept;

  Vec3 damper_force_h_n() const noexcept { return damper_force_h_n_; }
  double damper_n_s_m() const noexcept { return damper_n_s_m_; }  ///< γ of this tick
  double damper_cap_n_s_m() const noexcept { return damper_cap_n_s_m_; }

  /// The largest norm of the force that may be committed now; infinite for methods without a clamp.
  double force_bound_n() const noexcept;

  /// The method's own energy: of `ks` as published, of `ks-clamp` the ledger, of `none` that of the observer.
  double ledger_j() const noexcept { return ledger_j_; }
  double credit_j() const noexcept { return credit_j_; }  ///< of certain damping, so far
  const EnergyObserver& observer() const noexcept { return observer_; }
  const PassivityConfig& config() const noexcept { return config_; }

 private:
  double certain_loss_j(const Vec3& hand_pos_h_m, double dt_s) noexcept;

  PassivityConfig config_;
  EnergyObserver observer_;
  double damper_cap_n_s_m_ = 0;
  double ledger_j_ = 0;
  double credit_j_ = 0;
  double damper_n_s_m_ = 0;
  Vec3 damper_force_h_n_ = Vec3::Zero();
  Vec3 window_start_h_m_ = Vec3::Zero();
  Vec3 window_s_ = Vec3::Zero();
};

}  // namespace telenano::control
