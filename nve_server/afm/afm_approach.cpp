// AfmLogic: approach, lift, tare, and finding the surface by touch.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm/afm_units.h"

namespace telenano::afm {

namespace {

constexpr int kLiftReadings = 4;
constexpr std::int64_t kSettleNs = 20 * kMs;  // of lever and piezo after a lift
constexpr std::int64_t kMovedNs = 3 * kMs;    // likewise after one step down, which is far smaller
constexpr double kCalmNm = 0.5;               // between two looks at an engaged tip
constexpr int kCalmLooks = 4;

}  // namespace

void AfmLogic::engage(std::int64_t now_ns) {
  enter(Phase::kEngaging, now_ns);
  engage_ns_ = now_ns;
  engage_step_ = 0;
  setpoint_ok_ = false;
  calm_ = 0;
  contact_stiffness_n_m_ = 0;
  approved_ = false;     // used up
  floor_nm_ = kNoFloor;  // the guard may have raised it
  safe_tip_air_known_ = safe_tip_touch_known_ = !port_->capabilities().watches_force;
  safe_tip_differs_ = 0;
  held_asked_ = 0;
  free_ = false;
  lift_readings_ = 0;
  lift_sum_nm_ = 0;
  lift_last_nm_ = kNoFloor;
  lift_nm_ = config_.lift_nm;
  watch_.begin();
  model_.forget_stiffness();
  state_.cause = Cause::kNone;
  state_.force_known = false;
  account_.interrupt();
  reading_ns_ = now_ns;
  session_ns_ = now_ns;
  tell("approaching");
}

double AfmLogic::contact_height_nm(std::int64_t now_ns) const noexcept {
  // What a touch has corrected is not made at once.
  return touches_ > 0 ? surface_.height_nm(now_ns) - shift_nm_ : settled_height_nm_;
}

bool AfmLogic::send_z(double z_w_nm, std::int64_t now_ns, AfmCommand& call) {
  height_nm_ = z_w_nm + contact_height_nm(now_ns);
  sent_w_nm_.z() = z_w_nm;
  history_.add(now_ns, sent_w_nm_);
  state_.base_w_nm = sent_w_nm_;
  return send(Role::kMotion, {AfmOp::kMoveZ, {height_nm_}}, now_ns, call);
}

bool AfmLogic::next_motion(std::int64_t now_ns, AfmCommand& call) {
  Connection& c = at(Role::kMotion);
  switch (state_.phase) {
    case Phase::kEngaging:
      if (!setpoint_ok_ || (floor_nm_ == kNoFloor && port_->capabilities().z_limits))
        return false;  // the data connection asks and sets
      if (engage_step_ == 0) return send(Role::kMotion, {AfmOp::kFeedback, {1}}, now_ns, call);
      if (engage_step_ == 1) {
        c.next_ns = now_ns + kLookPeriodNs;
        return send(Role::kMotion, {AfmOp::kAskHeight}, now_ns, call);
      }
      return send(Role::kMotion, {AfmOp::kFeedback, {0}}, now_ns, call);
    case Phase::kLifting:
      if (engage_step_ == 0) {
        c.next_ns = now_ns + 5 * kMs;
        return send(Role::kMotion, {AfmOp::kAskFeedback}, now_ns, call);
      }
      return send(Role::kMotion, {AfmOp::kAskHeight}, now_ns, call);
    case Phase::kTaring:
      return next_lift(now_ns, call);
    case Phase::kTouching:
      return next_touch(now_ns, call);
    case Phase::kFollowing:
      return next_move(now_ns, call);
    case Phase::kWithdrawing:
      if (motion_withdraw_sent_) return false;
      motion_withdraw_sent_ = true;
      return send(Role::kMotion, {AfmOp::kWithdraw}, now_ns, call);
    default:
      return false;
  }
}

void AfmLogic::on_motion(const AfmReading& reading, std::int64_t now_ns) {
  const AfmOp op = at(Role::kMotion).call.op;
  if (state_.phase == Phase::kEngaging) {
    if (op == AfmOp::kFeedback && engage_step_ == 0) {
      engage_step_ = 1;
      last_height_nm_ = 1e300;
    } else if (op == AfmOp::kAskHeight && engage_step_ == 1) {
      const double height = reading.numbers[0];
      const bool still = std::fabs(height - last_height_nm_) < kCalmNm && state_.force_known;
      calm_ = still ? calm_ + 1 : 0;
      if (calm_ <= 1) calm_ns_ = now_ns;
      last_height_nm_ = height;
      // The force is that of the tip at rest: what was read on the way down may still show the pull.
      if (calm_ < kCalmLooks || reading_from_ns_ < calm_ns_) return;
      if (height > top_height_nm_ - 1 || height < -0.499 * range_z_nm_) {
        calm_ = 0;  // not gone yet, or at the end of the range without a surface
        return;
      }
      settled_height_nm_ = height;
      // At rest in contact the set point bends the lever away from the sample.
      if (state_.measured_force_w_nn.z() < 0) {
        refusal_ = config_.path +
                   ": [calibration] sensitivity_nm_v: touching bends the lever the wrong way: wrong sign "
                   "(the tip was withdrawn)";
        return withdraw(Cause::kController, now_ns);
      }
      engage_step_ = 2;
    } else if (op == AfmOp::kFeedback && engage_step_ == 2) {
      enter(Phase::kLifting, now_ns);
      engage_step_ = 0;
    }
  } else if (state_.phase == Phase::kLifting) {
    if (op == AfmOp::kAskFeedback) {
      if (reading.numbers[0] != 0) return;
      engage_step_ = 1;
      off_ns_ = now_ns;
      at(Role::kMotion).next_ns = now_ns + kSettleNs;
    } else if (op == AfmOp::kAskHeight) {
      height_nm_ = reading.numbers[0];
      const double lifted = height_nm_ - settled_height_nm_;
      if (lifted < 0.5 * config_.lift_nm) {
        refusal_ =
            config_.path + text(
                               ": [calibration] z_sign: a lift of %g nm moved Z by %g nm: wrong sign (the "
                               "tip was withdrawn)",
                               config_.lift_nm, lifted);
        return withdraw(Cause::kController, now_ns);
      }
      touches_ = 0;  // the surface is where the Z controller stood
      history_.clear();
      bounds_.clear();
      sent_w_nm_ = Vec3(sent_w_nm_.x(), sent_w_nm_.y(), height_nm_ - contact_height_nm(now_ns));
      history_.add(now_ns, sent_w_nm_);
      state_.base_w_nm = sent_w_nm_;
      model_.forget_place();
      lift_to_nm_ = sent_w_nm_.z();
      tared_ = 0;
      tare_sum_ = tare_squares_ = tare_lateral_sum_ = 0;
      free_volts_.clear();
      free_lateral_v_.clear();
      enter(Phase::kTaring, now_ns);
    }
  } else if (state_.phase == Phase::kTouching && op == AfmOp::kMoveZ) {
    touch_moved_ns_ = now_ns;
  }
}

/// Averages at heights that are a fifth of the lift apart. A tip that sticks bends the lever by what the base
/// rises; one that is free does not: a twentieth is what the attraction far from the sample, and noise, may
/// be taken for.
void AfmLogic::lift_reading(double deflection_nm, std::int64_t now_ns) {
  lift_sum_nm_ += deflection_nm;
  if (++lift_readings_ < kLiftReadings) return;
  const double mean_nm = lift_sum_nm_ / lift_readings_;
  lift_readings_ = 0;
  lift_sum_nm_ = 0;
  const double rise_nm = std::max(0.2 * config_.lift_nm, 4 * config_.step_nm);
  const double change_nm = std::fabs(mean_nm - lift_last_nm_);
  if (lift_last_nm_ != kNoFloor && change_nm < 0.05 * rise_nm) {
    free_ = true;
    lift_nm_ = std::max(config_.lift_nm, sent_w_nm_.z() - rise_nm);  // free there already
    enter(Phase::kTaring, now_ns);                                   // settles anew
    if (lift_nm_ > config_.top_nm) {
      refusal_ = config_.path + text(
                                    ": [limits] top_nm: the tip sticks until %.4g nm above where it touches, "
                                    "and the workspace ends at "
                                    "%.4g nm: raise it, or take a stiffer lever (the tip was withdrawn)",
                                    lift_nm_, config_.top_nm);
      withdraw(Cause::kNoSurface, now_ns);
    }
    return;
  }
  lift_last_nm_ = mean_nm;
  lift_to_nm_ = sent_w_nm_.z() + rise_nm;
  if (height_nm_ + rise_nm < top_height_nm_ - 1) return;
  refusal_ = config_.path +
             text(
                 ": the tip does not come off the sample within the piezo's range, %.4g nm above where it "
                 "touched: approach from further away, or take a stiffer lever (the tip was withdrawn)",
                 sent_w_nm_.z());
  withdraw(Cause::kNoSurface, now_ns);
}

bool AfmLogic::next_lift(std::int64_t now_ns, AfmCommand& call) {
  if (sent_w_nm_.z() >= lift_to_nm_) return false;
  if (now_ns < last_move_ns_ + ns(config_.step_nm / config_.speed_nm_s)) return false;
  last_move_ns_ = now_ns;
  return send_z(std::min(sent_w_nm_.z() + config_.step_nm, lift_to_nm_), now_ns, call);
}

void AfmLogic::tare(double deflection_nm, double lateral_nn, std::int64_t sent_ns, std::int64_t now_ns) {
  const std::int64_t from_ns = sent_ns - ns(config_.period_s());
  // Averaged before the tip stood where it stands.
  if (from_ns < phase_ns_ + kSettleNs) return;
  if (!free_) {
    const bool moving = sent_w_nm_.z() < lift_to_nm_ || at(Role::kMotion).busy;
    if (!moving && from_ns >= last_move_ns_ + kSettleNs) lift_reading(deflection_nm, now_ns);
    return;
  }
  if (!safe_tip_air_known_) return;
  ++tared_;
  free_volts_.push_back(deflection_nm / config_.sensitivity_nm_v);
  free_lateral_v_.push_back(lateral_nn / config_.lateral_nn_v);
  tare_sum_ += deflection_nm;
  tare_squares_ += (deflection_nm - free_deflection_nm_) * (deflection_nm - free_deflection_nm_);
  tare_lateral_sum_ += lateral_nn;
  if (tared_ < config_.tare_readings) return;
  const double n = tared_;
  tare_nm_ = tare_sum_ / n;
  const double off = tare_nm_ - free_deflection_nm_;
  const double variance = std::max(0.0, (tare_squares_ - n * off * off) / (n - 1));
  state_.noise_nn = config_.spring_constant_n_m * std::sqrt(variance);
  tare_nn_ = config_.spring_constant_n_m * tare_nm_;
  tare_lateral_nn_ = tare_lateral_sum_ / n;
  model_.set_noise(state_.noise_nn);
  watch_.learn(free_volts_);
  watch_.learn_lateral(free_lateral_v_);
  touches_ = 0;
  touch_ = Touch::kDown;
  touch_fresh_ = false;
  touch_moved_ns_ = now_ns;
  touch_from_height_nm_ = height_nm_;
  touch_last_nn_ = 0;
  touch_last_nm_ = height_nm_;
  enter(Phase::kTouching, now_ns);
}

/// Below where the surface was found a signal that tells nothing must not let the tip go on for long: only as
/// far as the force limit allows where the ground has stayed.
double AfmLogic::deepest_touch_nm() const noexcept {
  return std::min(config_.force_max_nn / config_.spring_constant_n_m, 2 * config_.lift_nm) + config_.step_nm;
}

bool AfmLogic::next_touch(std::int64_t now_ns, AfmCommand& call) {
  if (touch_ == Touch::kPause) {
    if (now_ns < touch_ns_ + ns(config_.touch_pause_s)) return false;
    touch_ = Touch::kDown;
    touch_fresh_ = false;
    touch_moved_ns_ = now_ns;
  }
  if (touch_ == Touch::kDown) {
    // Each step down waits for a reading that was begun after the last one.
    if (!touch_fresh_) return false;
    const double step_nm = std::min(config_.step_nm, sent_w_nm_.z() - lowest_allowed_nm(now_ns));
    if (step_nm < 1e-3 * config_.step_nm) return false;
    touch_fresh_ = false;
    return send_z(sent_w_nm_.z() - step_nm, now_ns, call);
  }
  if (touch_ == Touch::kCompare) return false;  // the data connection asks
  if (touch_ == Touch::kLevel) {
    const double way_nm = lift_nm_ - sent_w_nm_.z();
    if (std::fabs(way_nm) < 1e-3 * config_.step_nm) {
      begin_following(now_ns);
      return false;
    }
    return send_z(sent_w_nm_.z() + std::clamp(way_nm, -config_.step_nm, config_.step_nm), now_ns, call);
  }
  if (sent_w_nm_.z() >= lift_nm_) {
    touched(now_ns);
    return false;
  }
  if (now_ns < last_move_ns_ + ns(config_.step_nm / config_.speed_nm_s)) return false;
  last_move_ns_ = now_ns;
  return send_z(std::min(sent_w_nm_.z() + config_.step_nm, lift_nm_), now_ns, call);
}

void AfmLogic::touch_reading(std::int64_t sent_ns, std::int64_t now_ns) {
  if (touch_ == Touch::kCompare && safe_tip_touch_known_) return compare_safe_tip(now_ns);
  if (touch_ != Touch::kDown || at(Role::kMotion).busy) return;
  if (sent_ns - ns(config_.period_s()) < touch_moved_ns_ + kMovedNs) return;
  touch_fresh_ = true;
  const double force = state_.measured_force_w_nn.z();
  // A lever bends up by no more than its base goes down, whatever the sample is.
  const double rise_nn = force - touch_last_nn_;
  const double most_nn = 1.5 * config_.spring_constant_n_m * std::max(touch_last_nm_ - height_nm_, 0.0) +
                         8 * state_.noise_nn + 0.5 * model_.contact_threshold_nn();
  // The step that passes the force of a touch goes on by up to a step: what lies beyond is taken back by the
  // stiffness of this very contact, so that two touches mean the same place whatever they ended with.
  const double lever_n_m = config_.spring_constant_n_m;
  const bool steep = touch_last_nn_ > model_.contact_threshold_nn() && touch_last_nm_ > height_nm_;
  const double beyond_n_m = steep
                                ? std::clamp(rise_nn / (touch_last_nm_ - height_nm_), model_.stiffness_n_m(),
                                             std::max(model_.stiffness_n_m(), lever_n_m))
                                : model_.stiffness_n_m();
  touch_last_nn_ = force;
  touch_last_nm_ = height_nm_;
  if (rise_nn > most_nn) {
    refusal_ =
        config_.path + text(
                           ": [calibration] sensitivity_nm_v: %g: the lever bent by more than its base "
                           "moved (%.3g nN more where %.3g nN are possible): wrong value or unit (the "
                           "tip was withdrawn)",
                           config_.sensitivity_nm_v, rise_nn, most_nn);
    return withdraw(Cause::kController, now_ns);
  }
  model_.add(sent_w_nm_, force, now_ns);
  if (force >= config_.touch_force_nn) {
    touch_ = touches_ == 0 && port_->capabilities().watches_force ? Touch::kCompare : Touch::kUp;
    touch_height_nm_ = height_nm_ + config_.touch_force_nn / model_.stiffness_n_m() +
                       (force - config_.touch_force_nn) / beyond_n_m;
    touch_ns_ = now_ns;
  } else if (sent_w_nm_.z() < -deepest_touch_nm()) {
    tell("no surface where the Z controller found one: the deflection shows no force");
    withdraw(Cause::kNoSurface, now_ns);
  }
}

void AfmLogic::touched(std::int64_t now_ns) {
  ++touches_;
  shift_nm_ = 0;
  if (touches_ == 1) {
    surface_.begin(sent_w_nm_.x(), sent_w_nm_.y(), touch_height_nm_, touch_ns_);
  } else {
    const double dt_s = 1e-9 * static_cast<double>(touch_ns_ - last_touch_ns_);
    const double rate = (touch_height_nm_ - last_touch_height_nm_) / dt_s;
    if (std::fabs(rate) > config_.drift_max_nm_s) {
      tell(text("the surface moves by %g nm/s, which is too fast for drift", rate));
      return withdraw(Cause::kNoSurface, now_ns);
    }
    surface_.touch(sent_w_nm_.x(), sent_w_nm_.y(), touch_height_nm_, 0, touch_ns_);
  }
  last_touch_height_nm_ = touch_height_nm_;
  last_touch_ns_ = touch_ns_;
  // W's zero has moved to where the tip touched: the tip stands as much lower in it.
  sent_w_nm_.z() = height_nm_ - contact_height_nm(now_ns);
  history_.clear();
  bounds_.clear();
  history_.add(now_ns, sent_w_nm_);
  state_.base_w_nm = sent_w_nm_;
  // The same ground in the new frame: known where the touch saw it.
  model_.forget_place();
  model_.add(
      Vec3(sent_w_nm_.x(), sent_w_nm_.y(), -model_.contact_threshold_nn() * 1.01 / model_.stiffness_n_m()),
      model_.contact_threshold_nn() * 1.01, now_ns);
  model_.forget_place();
  state_.model = model_.model();
  // Where a session begins in W is where its hand takes the tip to be: as high above the surface as was said.
  touch_ = touches_ < 2 ? Touch::kPause : Touch::kLevel;
}

void AfmLogic::begin_following(std::int64_t now_ns) {
  contact_stiffness_n_m_ = model_.stiffness_n_m();
  shifted_ns_ = now_ns;
  last_force_nn_ = 0;
  high_readings_ = 0;
  ever_touched_ = true;
  was_touching_ = false;
  enter(Phase::kFollowing, now_ns);
  last_move_ns_ = last_xy_ns_ = now_ns;
  lateral_from_ns_ = reading_from_ns_;
  ground_nm_ = 0;
  free_y_nm_ = sent_w_nm_.y();
  along_told_ = false;
  session_ns_ = now_ns;
  last_account_ns_ = now_ns;
  account_.interrupt();
  tell(text("surface found; drift %+.3f (+-%.2f) nm/s, noise %.2f nN, stiffness %.3g N/m", drift_nm_s(),
            surface_.drift_bound_nm_s(), state_.noise_nn, model_.stiffness_n_m()));
}

}  // namespace telenano::afm
