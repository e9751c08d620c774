#include "telenano/master/station/station.h"

#include <algorithm>
#include <utility>

namespace telenano::station {

/// What the method shows now. Where that may be another force than the last at once (news after an outage,
/// another method or scale), the ramp starts where the new one, so scaled, is no larger than what acts.
void Station::render(const StationInput& input, double dt_s, StationTrace& trace) noexcept {
  control::StationMethod& method = methods_.now();
  const Vec3 last_h_n = rendered_force_h_n_;
  rendered_force_h_n_ = method.force_h_n({mapping_.target_w_nm(), input.command_sequence, dt_s});
  // A method that knows less of the contact than the twin did must not drop the hand.
  if (std::exchange(leaves_twin_, false)) left_by_twin_h_n_ = last_h_n - rendered_force_h_n_;
  const double left_n = left_by_twin_h_n_.norm();
  const double goes_n = control::Twin::kGoOver_n_s * std::min(dt_s, period_s_);
  left_by_twin_h_n_ *= left_n > goes_n ? 1 - goes_n / left_n : 0;
  rendered_force_h_n_ += left_by_twin_h_n_;
  if (bump_ahead_) {
    const double norm_n2 = rendered_force_h_n_.squaredNorm();
    const double along = norm_n2 > 0 ? commanded_force_h_n_.dot(rendered_force_h_n_) / norm_n2 : 0;
    ramp_ = along > 0 ? std::min(ramp_, along) : 0;
  }
  bump_ahead_ = false;
  trace.rendered_force_h_n = rendered_force_h_n_;
  trace.damper_force_h_n = method.damper_force_h_n();
  trace.damper_n_s_m = method.damper_n_s_m();
  trace.force_bound_n = method.force_bound_n();
}

/// A stiffness that was planned for a loop without delay is no other method's, for however short a time. What
/// acts on the hand becomes a force that no longer depends on where the hand is, and fades; the tip stays.
void Station::leave_twins_scale() noexcept {
  const bool too_stiff = config_.impedance_without_twin > 0 && !config_.allow_unsafe_scaling &&
                         config_.scaling.impedance() > config_.impedance_without_twin * (1 + 1e-9);
  if (too_stiff && !fades_ && has_reply_ && !shows_twin()) {
    fades_ = true;
    fading_h_n_ = commanded_force_h_n_;
    ramp_ = 1;
    leaves_twin_ = false;
    left_by_twin_h_n_.setZero();
  }
  if (fades_) faults_ |= kFaultTwinLeft;
}

/// When nothing is left of the force: the scale that was planned for any method. Then the hand engages anew, by
/// the ramp.
void Station::fade_to_new_scale(double dt_s, StationTrace& trace) noexcept {
  const double left_n = fading_h_n_.norm();
  const double goes_n = control::Twin::kGoOver_n_s * std::min(dt_s, period_s_);
  fading_h_n_ *= left_n > goes_n ? 1 - goes_n / left_n : 0;
  rendered_force_h_n_ = fading_h_n_;
  trace.rendered_force_h_n = rendered_force_h_n_;
  trace.force_bound_n = methods_.now().force_bound_n();
  if (fading_h_n_.squaredNorm() > 0) return;
  fades_ = false;
  const control::Scaling& scaling = config_.scaling;
  if (scaling.impedance() > config_.impedance_without_twin)  // a person may have chosen less meanwhile
    change_scaling({scaling.velocity, config_.impedance_without_twin / scaling.velocity});
  begin_anew();
  ramp_ = 0;
}

Vec3 Station::limited_force(double dt_s, StationTrace& trace) noexcept {
  if (ramp_ <= 0) return Vec3::Zero();
  Vec3 force_h_n = ramp_ * (trace.rendered_force_h_n + trace.damper_force_h_n);
  if (!is_finite(force_h_n)) {
    latched_ |= kFaultForceNonFinite;
    mode_ = Mode::kStopped;
    ramp_ = 0;
    return Vec3::Zero();
  }
  // A late tick has shown nothing in the meantime: it may take as much force away as its length asks for, but
  // add no more than an ordinary one.
  const double growth_n = config_.slew_n_s * std::min(dt_s, period_s_);
  force_h_n = limit_slew(force_h_n, applied_force_h_n_, growth_n, trace.slewed);
  force_h_n = limit_norm(force_h_n, force_limit_n_, trace.limited);
  return limit_norm(force_h_n, trace.force_bound_n, trace.clamped);
}

}  // namespace telenano::station
