#pragma once

#include <algorithm>
#include <cmath>

namespace telenano::control {

/// How much stronger than planned the far attraction of a sample is shown.
struct CompandingConfig {
  double gain = 1;       ///< g ≥ 1, of the weakest forces; 1: none, to the bit
  double energy_aj = 5;  ///< U₀ > 0: where |U| is U₀ a quarter of (g − 1) is left

  bool on() const noexcept { return gain > 1; }
  /// Most that a hand may get beyond what the sample gives, aJ at the tip.
  double most_aj() const noexcept { return (gain - 1) * energy_aj; }
};

/// Companding of forces that are too small to feel: before contact G = ψ′(U) F is shown instead of F, with U
/// the energy that is stored between the port and the sample (coupling, lever, sample), and
///
///   ψ(U) = U + (g − 1) U / (1 + |U|/U₀),   ψ′(U) = 1 + (g − 1) / (1 + |U|/U₀)²   for U < 0,
///
/// and ψ(U) = U above, where nothing pulls.
///
/// *Why of the energy and not of the force.* The force at the port is F = −∇U, whatever inside is in balance,
/// so that G = −∇ψ(U): a closed path that dissipates nothing gives nothing. A map of |F|, or of each
/// component, has no potential in three dimensions: G = h(|F|) F has the curl h′ ∇|F| × F. What is dissipated
/// (work D beside ΔU) is scaled by ψ′ > 0 too and stays dissipated.
///
/// *What is felt.* 1 < ψ′ ≤ g, and van der Waals' attraction of a sphere, F = U²/C, stays one that grows all
/// the way: ψ′(U) U² grows with |U|. So its slope has the sign that it had, and the greatest stiffness that
/// pushes back, of which the plan keeps within the passive bound, is the contact's as before.
///
/// *Branches.* In contact G = F. There the forces are strong, and U passes through zero under load, where a
/// gain would be a bump of any stiffness. A hand that enters the contact at one place and leaves it at another
/// might so get T(U) = (g − 1)|U|/(1 + |U|/U₀) at the first and pay less of it at the second. So an account is
/// kept: `owed` is what has been given beyond the sample's own, less what the sample has dissipated, never
/// below T(U) before contact or 0 in contact. Before contact the gain acts where owed = T(U), and then owed
/// follows T, both ways; where more is owed, G = F until T has come up to it. Then at any time
///
///   Σ G·Δx ≥ Σ F·Δx − Σ D − (g − 1) U₀ = ΔU − (g − 1) U₀,
///
/// and ≥ 0 around every closed path that ends with as much owed as it began. So the companded sample is a
/// passive one whose well is (g − 1) U₀ deeper: that much is promised besides (station/twin_run.h).
///
/// Pure; nothing allocates, waits or throws.
class Companding {
 public:
  Companding() = default;

  /// From the next state on; what is owed stays owed.
  void configure(const CompandingConfig& config) noexcept {
    config_ = config;
    most_ever_aj_ = std::max(most_ever_aj_, config.most_aj());
    known_ = false;
  }
  const CompandingConfig& config() const noexcept { return config_; }
  /// Most that hands may have got beyond what the sample gives, with all that was ever configured.
  double most_ever_aj() const noexcept { return most_ever_aj_; }

  /// The state of this step, whose port has brought `brought_aj` since the last one: returns what the same
  /// step brings at the companded force. `other`: the state is no continuation of the last one.
  double step(double stored_aj, double brought_aj, bool in_contact, bool other = false) noexcept {
    if (other) known_ = false;
    const double excess_aj = excess(stored_aj);
    double companded_aj = brought_aj;
    if (known_) {
      const double stored_more_aj = stored_aj - stored_aj_;
      // The mean of ψ′ between the two states, so that what is stored goes over exactly.
      if (gains_ && !in_contact) companded_aj += (mean_gain(stored_aj_, stored_aj) - 1) * brought_aj;
      const double dissipated_aj = std::max(0.0, brought_aj - stored_more_aj);
      owed_aj_ += brought_aj - companded_aj - dissipated_aj;
    }
    // Whoever owes less than T gets no more for it: the rest of what was dissipated is forfeited.
    const double least_aj = in_contact ? 0 : excess_aj;
    const double tolerance_aj = kRounding * (excess_aj + config_.most_aj());
    if (owed_aj_ < least_aj + tolerance_aj) owed_aj_ = least_aj;
    gains_ = config_.on() && !in_contact && owed_aj_ <= excess_aj;
    gain_ = gains_ ? mean_gain(stored_aj, stored_aj) : 1;
    stored_aj_ = stored_aj;
    known_ = std::isfinite(stored_aj);
    if (!known_) gain_ = 1, gains_ = false;
    return companded_aj;
  }

  /// Of the force to show in the state of the last step.
  double gain() const noexcept { return gain_; }
  double owed_aj() const noexcept { return owed_aj_; }

  /// T(U), what ψ gives beyond U: 0 far away, at most (g − 1) U₀.
  double excess(double stored_aj) const noexcept {
    if (!config_.on()) return 0;
    const double u = std::fabs(stored_aj) / config_.energy_aj;
    return stored_aj < 0 ? config_.most_aj() * (u / (1 + u)) : 0;
  }

 private:
  /// (ψ(b) − ψ(a))/(b − a), ψ′(a) where they are one: no difference is taken of what is nearly equal. Above
  /// zero, where a probe that rings may be, it is 1: a repelling force is not companded.
  double mean_gain(double a_aj, double b_aj) const noexcept {
    const double more = config_.gain - 1;
    const double a = std::max(0.0, -a_aj) / config_.energy_aj, b = std::max(0.0, -b_aj) / config_.energy_aj;
    const double both = more / ((1 + a) * (1 + b));
    if (a_aj <= 0 && b_aj <= 0) return 1 + both;
    if (a_aj >= 0 && b_aj >= 0) return 1;
    return 1 + both * (a + b) * config_.energy_aj / std::fabs(a_aj - b_aj);
  }

  static constexpr double kRounding = 1e-12;

  CompandingConfig config_;
  double most_ever_aj_ = 0;
  double stored_aj_ = 0;
  double owed_aj_ = 0;
  double gain_ = 1;
  bool known_ = false;
  bool gains_ = false;
};

}  // namespace telenano::control
