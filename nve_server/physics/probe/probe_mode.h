#pragma once

namespace telenano::physics {

/// The first bending mode of a cantilever as one mass on its spring, q its deflection in nm:
///
///   m q'' + c q' + k q = Φ,   m = k/(2π f0)²,   c = k/(2π f0 Q),   Φ the force along the mode, nN.
///
/// m in nN·s²/nm (= kg), c in nN·s/nm (= N·s/m), energies ½ m q'² + ½ k q² in aJ. Source: the point-mass
/// model of dynamic force microscopy, e.g. García & Pérez, Surf. Sci. Rep. 47:197 (2002). Valid for one mode
/// (the second has 6.3 f0 and 39 k) and Q > ½. The motion of the base enters the deflection only through the
/// force: its inertia −m x_base'' is left out, since a sampled command has no second derivative; the error in
/// q is |x_base''|/(2π f0)² (100 µm/s reached in 1 ms at f0 = 10 kHz: 0.025 nm).
///
/// A step over h is q₁ = shift + compliance · Φ₁ with Φ₁ the force at the step's end, so that whatever
/// balances springs against a contact balances the moving probe too. With the exact free motion over h,
///   E = e^{−γh}, γ = ω0/(2Q), ω_d² = ω0² − γ²,
///   q_free = E (cos + (γ/ω_d) sin) q₀ + (E sin/ω_d) v₀,   g = (1 − E (cos + (γ/ω_d) sin))/k,
///   q₁ = q_free + g Φ̄,   v₁ = v_free + (E sin/(m ω_d)) Φ̄   (exact for a force Φ̄ held over the step),
/// the three ways to a step are
///   kBackwardEuler  q₁ = (m(q₀ + h v₀)/h² + c q₀/h + Φ₁)/(k + c/h + m/h²): first order, stable always, loses
///                   any motion faster than h. What is left of a mode that h does not resolve: its mean.
///   kHeldForce      Φ̄ = Φ₁: exact when free, first order in contact. A convex contact never gives more than
///                   it had, an attractive one does; and a hard contact bounces for ever (v₁ = −v₀).
///   kMeanForce      Φ̄ = (1 − θ) Φ₀ + θ Φ₁, θ = ½ (1 + β), v₁ ← (1 − β) v₁ + β (q₁ − q₀)/h with
///                   β = (gK)²/(1 + (gK)²) rounded to eighths, K >= 0 the contact's stiffness along the
///                   mode. Exact when free,
///                   second order in contact and without loss for a linear force that the step resolves
///                   (Φ̄ (q₁ − q₀) = −ΔU when β = 0, attractive or not); a contact that h does not resolve
///                   (gK > 4, gK = ½ (ω_K h)² with ω_K² = K/m) is held, not bounced on.
/// A step of kMeanForce on a linear contact has no eigenvalue beyond 1 for K from −k to 1e9 k, Q from 0.6 to
/// 1e6 and ω0 h to 1. Beyond ω0 h = 1 a held force no longer means the motion between two samples (at whole
/// periods g = 0, and the probe would be rigid): there over() takes backward Euler. Rounding: g is a
/// difference of numbers near 1, its relative error 1e-16/(ω0 h)².
enum class ModeIntegrator : unsigned char { kBackwardEuler, kHeldForce, kMeanForce };

struct ModeState {
  double deflection_nm = 0;
  double velocity_nm_s = 0;
  double force_nn = 0;  ///< Φ at the end of the last step
};

/// What a step of one length needs, the same for all steps of that length.
struct ModePropagator {
  ModeIntegrator integrator = ModeIntegrator::kBackwardEuler;
  double step_s = 0;
  double keep_q = 0;      ///< q_free = keep_q q₀ + reach v₀
  double reach_s = 0;     ///< E sin/ω_d
  double keep_v = 0;      ///< v_free = −ω0² reach q₀ + keep_v v₀
  double held_nm_nn = 0;  ///< g, or 1/(k + c/h + m/h²)
};

/// A step that only lacks its force: q₁ = shift + compliance · Φ₁.
struct ModeStep {
  ModePropagator over;
  ModeState from;
  double shift_nm = 0;
  double compliance_nm_nn = 0;
  double blend = 0;  ///< β
};

/// Where the work of the force on the mode, ½ (Φ₀ + Φ₁)(q₁ − q₀), went besides the mode's own energy.
struct ModeLoss {
  double damped_aj = 0;     ///< by c, >= 0
  double numerical_aj = 0;  ///< by the method; of kMeanForce 0 when free, may be negative in contact
};

class ProbeMode {
 public:
  /// Above this ω0 h a step no longer resolves the mode.
  static constexpr double kResolved = 1.0;
  /// A time step is cut so that ω0 h <= kResolved, unless that took more pieces than this; then the mode is
  /// quasi-static in one piece. With 32: f0 dt <= 5, e.g. 5 kHz at 1 kHz.
  static constexpr int kMaxPieces = 32;

  /// Throws UserError unless stiffness and frequency are finite and positive and 0.6 <= quality <= 1e6,
  /// or infinite: no damping.
  ProbeMode(double stiffness_n_m, double frequency_hz, double quality);

  /// Pieces that a time step is cut into: ceil(ω0 dt), or 1 where that is more than kMaxPieces.
  int pieces(double dt_s) const noexcept;
  bool resolved(double step_s) const noexcept { return omega_1_per_s_ * step_s <= kResolved * (1.0 + 1e-9); }

  /// kMeanForce where the step resolves the mode, else kBackwardEuler.
  ModePropagator over(double step_s) const noexcept;
  /// Any of the three, for comparison. ω0 h <= 1e6.
  ModePropagator over(double step_s, ModeIntegrator integrator) const noexcept;

  /// `contact_stiffness_n_m` as the mode feels it at the step's begin (negative counts as none).
  ModeStep begin(const ModePropagator& over, const ModeState& from,
                 double contact_stiffness_n_m) const noexcept;
  /// Takes the step under the force Φ₁.
  ModeLoss finish(const ModeStep& step, double force_nn, ModeState& to) const noexcept;

  double kinetic_aj(const ModeState& state) const noexcept {
    return 0.5 * mass_ * state.velocity_nm_s * state.velocity_nm_s;
  }
  double elastic_aj(const ModeState& state) const noexcept {
    return 0.5 * stiffness_n_m_ * state.deflection_nm * state.deflection_nm;
  }
  double energy_aj(const ModeState& state) const noexcept { return kinetic_aj(state) + elastic_aj(state); }
  /// Slows the mode down by up to `energy_aj`; returns what was taken.
  double slow_down(double energy_aj, ModeState& state) const noexcept;

  double stiffness_n_m() const noexcept { return stiffness_n_m_; }
  double frequency_hz() const noexcept { return frequency_hz_; }
  double quality() const noexcept { return quality_; }
  double mass_kg() const noexcept { return mass_; }
  double damping_n_s_m() const noexcept { return damping_; }

 private:
  double stiffness_n_m_;
  double frequency_hz_;
  double quality_;
  double omega_1_per_s_;
  double gamma_1_per_s_;
  double omega_damped_1_per_s_;
  double mass_;
  double damping_;
};

}  // namespace telenano::physics
