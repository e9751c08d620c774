#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/probe/probe_mode.h"

namespace telenano::slave {

/// A mode's step on one potential by a discrete gradient (Gonzalez, J. Nonlinear Sci. 6:449, 1996): the force
/// Φ̄ that is held over the step is the one that gives the mode just what all else has set free,
///
///   Φ̄ (q₁ − q₀) = −ΔV,   V the energy of tip, ground and the other springs, less the port's work,
///
/// and not the mean of its ends, whose work differs from −ΔV by the bend of the force. The motion under a
/// held force is exact (probe_mode.h), so that nothing of the mode's energy is the method's. q₁ is found by
/// Newton's method on f = q₁ − q_free − g Φ̄(q₁), f' = 1 − g (Φ₁ − Φ̄)/(q₁ − q₀), since Φ₁ = −dV/dq₁: the
/// balance is told by how much the mode lies elsewhere (the shift), 1 + cK times what q₁ shall move.
class MeanForce {
 public:
  static constexpr int kMostTrials = 5;

  /// `now`: the step as the balance has just seen it, `first` as ProbeMode::begin made it with θ = ½, whose
  /// compliance is g/2.
  MeanForce(const physics::ProbeMode& mode, const physics::ModeStep& now, const physics::ModeStep& first,
            double force_nn, double given_aj) noexcept
      : mode_(mode), now_(now), force_nn_(force_nn), given_aj_(given_aj) {
    free_nm_ = first.shift_nm - first.compliance_nm_nn * first.from.force_nn;
    held_nm_nn_ = 2.0 * first.compliance_nm_nn;
    deflection_nm_ = now.shift_nm + now.compliance_nm_nn * force_nn;
    moved_nm_ = deflection_nm_ - now.from.deflection_nm;
  }

  /// False: the mode stands all but still, or what is given is not the mode's (a port that moves fast): the
  /// mean of a smooth force lies between its ends, or little beyond.
  bool found() const noexcept {
    constexpr double kStill_nm = 1e-7;
    if (!(std::abs(moved_nm_) > kStill_nm)) return false;
    const double trapezium = 0.5 * (now_.from.force_nn + force_nn_);
    return std::abs(mean_nn() - trapezium) <= std::abs(force_nn_ - now_.from.force_nn);
  }
  bool done(double stored_aj) const noexcept { return lost_below(2e-16, stored_aj); }  // rounding
  /// What Newton's method has come to, if not to its end; a soft lever above a snap may not be there by far.
  bool close(double stored_aj) const noexcept { return lost_below(1e-12, stored_aj); }
  double better_shift_nm(double stiffness_n_m) const noexcept {
    const double f = deflection_nm_ - free_nm_ - held_nm_nn_ * mean_nn();
    const double slope = 1.0 - held_nm_nn_ * (force_nn_ - mean_nn()) / moved_nm_;
    return now_.shift_nm - f / slope * (1.0 + now_.compliance_nm_nn * stiffness_n_m);
  }
  physics::ModeLoss finish(physics::ModeState& to) const noexcept {
    const physics::ModeState& from = now_.from;
    const double held = held_nn();
    to.force_nn = force_nn_;
    to.deflection_nm = deflection_nm_;
    to.velocity_nm_s =
        now_.over.keep_v * from.velocity_nm_s +
        now_.over.reach_s * (held - mode_.stiffness_n_m() * from.deflection_nm) / mode_.mass_kg();
    physics::ModeLoss loss;
    loss.damped_aj = std::max(0.0, held * moved_nm_ - (mode_.energy_aj(to) - mode_.energy_aj(from)));
    loss.numerical_aj = lost_aj();
    return loss;
  }

 private:
  double mean_nn() const noexcept { return given_aj_ / moved_nm_; }
  /// That leads to where the mode is.
  double held_nn() const noexcept { return (deflection_nm_ - free_nm_) / held_nm_nn_; }
  double lost_aj() const noexcept { return given_aj_ - held_nn() * moved_nm_; }
  bool lost_below(double part, double stored_aj) const noexcept {
    return std::abs(lost_aj()) <= part * (std::abs(stored_aj) + mode_.energy_aj(now_.from));
  }

  const physics::ProbeMode& mode_;
  const physics::ModeStep& now_;
  double force_nn_;
  double given_aj_;
  double free_nm_ = 0;
  double held_nm_nn_ = 0;
  double deflection_nm_ = 0;
  double moved_nm_ = 0;
};

}  // namespace telenano::slave
