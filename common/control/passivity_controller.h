#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/certain_loss.h"
#include "telenano/common/control/method.h"
#include "telenano/common/control/port_interval.h"

namespace telenano::control {

/// What the injected damping opposes.
enum class DamperDirection : std::uint8_t {
  kAlongMotion,  ///< one account, a damper along the hand's motion: what leaks in one axis is taken from any
  kPerAxis       ///< an account and a damper for each axis: only the leaking axis is damped
};

struct PassivityConfig {
  Method method = Method::kKsClamp;
  double period_s = 1e-3;            ///< T, for which a force is held
  double allowance_j = 0.010;        ///< E₀, what may be extracted at most
  double velocity_max_m_s = 0.5;     ///< up to which the guarantee holds; the velocity trip is at or below it
  double damping_certain_n_s_m = 0;  ///< b, the device's own viscous damping that is certainly there
  double shown_stiffness_n_m = 0;    ///< K = α_v α_F k_c, the largest that can be shown
  double shown_damping_n_s_m = 0;    ///< B = α_v α_F b_c
  double position_quantum_m = 0;     ///< q, of the encoder
  DamperDirection damper = DamperDirection::kAlongMotion;
  /// Reset policy: time constant with which stored passivity (a positive account) leaks away; 0 = never. A
  /// long session in a lossy sample stores joules, behind which a later activity of the loop stays unseen for
  /// seconds. A leak gives that memory up. It only ever lowers the account, so every guarantee holds with it.
  double leak_time_s = 0;
  /// Most passivity that is kept, J: what was put in beyond it is forgotten, and nobody gets it back. A
  /// sample gives back what it has stored, and no more; a session's dissipated joules (rubbing, ploughing)
  /// must not be at the disposal of a slave or a link that turns hostile. It too only ever lowers the account.
  double store_max_j = std::numeric_limits<double>::infinity();
};

/// Time-domain passivity controller of the station's port. Forces act on the hand (frame H, N).
///
/// Order of calls in a tick: account_for() with the interval that just ended, then damper_force() to be added to the
/// rendered force, then — after all other limits — force_bound_n() on the norm of the sum. Other methods than
/// `none` and `ks` use the account, damper and clamp of `ks-clamp`, what came from and went to the other side
/// (transfer()) included.
///
/// **`ks`** [Kim & Sitti, eqs. 14–17], as published. With the sign of this code,
///   E(k) = E(k−1) − F(k−1)·Δx(k) + γ(k)|Δx(k)|²/T,
///   γ(k) = −E(k−1)·T/|Δx(k)|² if E(k−1) < 0, else 0;   damper force −γ(k) Δx(k)/T.
/// (The paper prints γ = ΔE/Δx² and means the energy γΔx²; as a damping in N·s/m it is γT/Δx².) Since F of
/// the next interval contains the damper's force, its work is counted twice: once assumed, once done. γ has no
/// cap. Both are kept here to show what they do.
///
/// **`ks-clamp`**, three parts.
/// 1. Account: E(k) = E(k−1) − F(k−1)·Δx(k) with the total force applied. If E < 0, E ← min(0, E + c), with c
///    the energy certainly lost in the device's own damping: ∫b v² dt ≥ b|Δx|²/T (Cauchy–Schwarz). Credit
///    only repays a deficit, so E never exceeds the energy put in plus the energy certainly dissipated.
///    Without it the small leak of a sampled wall (which a device with b > KT/2 pays for, so that it is
///    passive at the hand) would fade the wall to nothing. With a quantised encoder Δx is known to ±q an axis
///    only, and b q²/T of a flickering last digit would be a credit for nothing: the credit is taken over
///    windows long enough for |Δx| ≥ 8 q, as b (|Δx| − q)²/t_window; windows do not overlap, so the bound
///    stays certain.
/// 2. Damper γ = −E·T/|Δx|² along the motion, capped at γ ≤ b − KT/2 − |B|: it is itself sampled, and beyond
///    the cap it makes the port active (Colgate's bound). What the cap leaves stays in the account. Where K >
///    2b/T the cap is zero: the damper can then do nothing at all.
/// 3. Pre-commit clamp: |F(k)| ≤ (E(k) + E₀)/(v_max T). The next interval cannot take out more than
///    |F|·v_max·T, so E(k+1) ≥ E(k) − |F(k)| v_max T ≥ −E₀ for every motion below v_max: by induction no hand
///    extracts more than E₀ beyond what is certainly dissipated. (E₀ = 0 would never let the first contact
///    begin.) An interval that comes out k periods long may overdraw that by (k − 1)·|F|·v_max·T; once, since
///    no force is given until it is repaid.
/// 4. Store: E ≤ store_max_j. So from any moment on no hand extracts more than store_max_j + E₀ beyond what
///    is put in and dissipated after it, whatever was put in before.
class PassivityController {
 public:
  explicit PassivityController(const PassivityConfig& config) noexcept;

  /// Goes on where another method was: its deficit is carried over, its surplus is not, and no new allowance
  /// is granted.
  void take_over(double account_j, const Vec3& hand_pos_h_m) noexcept;

  /// Accounts for an interval. Its numbers must be finite, dt_s > 0.
  void account_for(const PortInterval& interval) noexcept;

  /// Energy received from the other side less what was sent there.
  void transfer(double net_j) noexcept { account_j_ = std::min(account_j_ + net_j, config_.store_max_j); }

  Vec3 damper_force_h_n() const noexcept { return damper_force_h_n_; }
  double damper_n_s_m() const noexcept { return damper_n_s_m_; }  ///< γ of this tick, the largest of the axes
  double damper_cap_n_s_m() const noexcept { return damper_cap_n_s_m_; }

  /// The largest norm of the force that may be committed now; infinite for methods without a clamp.
  double force_bound_n() const noexcept;

  /// The method's own energy: of `ks` as published, of `none` what the hand put in, else the account.
  double account_j() const noexcept { return account_j_; }
  double credit_j() const noexcept { return credit_j_; }  ///< of certain damping, so far
  const PassivityConfig& config() const noexcept { return config_; }

 private:
  bool clamps() const noexcept { return config_.method != Method::kNone && config_.method != Method::kKs; }
  void repay_with(const Vec3& loss_j) noexcept;
  void damp(const Vec3& deficit_axes_j, double deficit_j, const PortInterval& interval) noexcept;

  PassivityConfig config_;
  CertainLoss loss_;
  double damper_cap_n_s_m_ = 0;
  double account_j_ = 0;
  Vec3 axis_account_j_ = Vec3::Zero();  // kPerAxis: the same account, an axis each
  double credit_j_ = 0;
  double damper_n_s_m_ = 0;
  Vec3 damper_force_h_n_ = Vec3::Zero();
};

}  // namespace telenano::control
