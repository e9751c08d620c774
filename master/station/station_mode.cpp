#include "telenano/master/station/station.h"

#include <algorithm>

namespace telenano::station {

void Station::choose_mode(const StationInput& input, double dt_s) noexcept {
  waits_for_tip_ = false;
  if (latched_ != 0) {
    mode_ = Mode::kStopped;
    return;
  }
  if (input.device_status == device::DeviceStatus::kHoming) {
    mode_ = input.session_up ? Mode::kHoming : Mode::kIdle;
    return;
  }
  const bool was_engaged = mode_ == Mode::kEngaged || mode_ == Mode::kHeld;
  if (!input.session_up) {
    mode_ = was_engaged ? Mode::kHeld : Mode::kIdle;
    return;
  }
  const bool wanted = (!config_.require_deadman || (input.buttons & device::kButtonDeadman)) &&
                      !(input.buttons & device::kButtonClutch) &&
                      input.device_status == device::DeviceStatus::kOk && holds_tip() && !twin_waits() &&
                      !fades_;
  waits_for_tip_ = wanted && has_reply_ && tip_up_;
  if (!wanted || waits_for_tip_) {
    mode_ = Mode::kReady;
  } else if (mode_ == Mode::kEngaged) {
    // A station that was itself kept from running so long has been as blind as in an outage, even if the
    // reply that waited for it is taken for news.
    if (std::max(blind_s_, dt_s) >= zero_s()) mode_ = Mode::kHeld;
  } else if (has_reply_ && blind_s_ <= hold_s()) {
    mode_ = Mode::kEngaged;
  } else {
    mode_ = was_engaged ? Mode::kHeld : Mode::kReady;
  }
}

void Station::update_ramp(const StationInput& input, double dt_s) noexcept {
  const double fade_s = zero_s() - hold_s();
  if (mode_ == Mode::kStopped || input.device_status != device::DeviceStatus::kOk) {
    ramp_ = 0;
    return;
  }
  const bool stale = blind_s_ > hold_s();
  if (fades_) {  // by itself, unless the hand lets go or the link is lost before
    const bool held = (!config_.require_deadman || (input.buttons & device::kButtonDeadman) != 0) &&
                      (input.buttons & device::kButtonClutch) == 0 && input.session_up;
    if (!held) ramp_ = std::max(0.0, ramp_ - dt_s / fade_s);
    if (stale) ramp_ = std::min(ramp_, std::max(0.0, (zero_s() - blind_s_) / fade_s));
    return;
  }
  if (mode_ == Mode::kEngaged && has_reply_ && !stale) {
    ramp_ = std::min(1.0, ramp_ + std::min(dt_s, period_s_) / config_.engage_ramp_s);
    return;
  }
  if (mode_ != Mode::kEngaged) ramp_ = std::max(0.0, ramp_ - dt_s / fade_s);
  if (stale) ramp_ = std::min(ramp_, std::max(0.0, (zero_s() - blind_s_) / fade_s));
}

/// How long a force is shown after the last new reply. A twin needs none to be right: it may go on for as
/// long as the server's slave would go on following.
double Station::hold_s() const noexcept {
  return shows_twin() ? std::max(config_.stale_hold_s, twin_->silence_s()) : config_.stale_hold_s;
}

double Station::zero_s() const noexcept {
  return shows_twin() ? hold_s() + config_.stale_zero_s - config_.stale_hold_s : config_.stale_zero_s;
}

/// Lets go; the target is where the tip is now.
void Station::stand_at_tip(const Vec3& tip_pos_w_nm) noexcept {
  if (mode_ == Mode::kEngaged || mode_ == Mode::kHeld) mode_ = Mode::kReady;
  mapping_.update(false, hand_pos_h_m_);
  mapping_.stand_at(tip_pos_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
}

/// The tip is this station's to move, from where it stands: what the method shows comes in by the ramp.
void Station::begin_anew() noexcept {
  methods_.change_to(methods_.method(), method_config(), hand_pos_h_m_);
  bump_ahead_ = true;
}

/// A slave that withdraws within the session, by a stop or a fault: its tip is no longer where the target was
/// left, and must not be driven back there by the next engagement.
void Station::follow_a_retracted_tip() noexcept {
  if (mode_ == Mode::kEngaged || !has_reply_ || !(reply_.fault_bits & link::kFaultRetracted)) return;
  if (shares_tip()) {
    mapping_.stand_at(reply_.tip.pos_w_nm);  // better than the tip's own place: what the slave goes on from
    last_target_w_nm_ = mapping_.target_w_nm();
    return;
  }
  mapping_.stand_at(reply_.tip_pos_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
}

void Station::clear_stop() noexcept {
  if (latched_ == 0) return;
  latched_ = 0;
  ramp_ = 0;
  mode_ = Mode::kReady;
}

}  // namespace telenano::station
