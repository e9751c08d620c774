#include "nve_server/afm/afm_logic.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace telenano::afm {

using nanonis::Answer;
using nanonis::Call;
using nanonis::CommandId;
using nanonis::ZStatus;
using enum nanonis::CommandId;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kEmergencyPeriodNs = 40 * kMs;  // the heart beat; the guard knows it too
constexpr std::int64_t kLookPeriodNs = 20 * kMs;       // while withdrawing
constexpr std::int64_t kDataPeriodNs = 40 * kMs;
constexpr std::int64_t kSettleNs = 20 * kMs;  // of lever and piezo after a lift
constexpr double kCalmNm = 0.5;               // between two looks at an engaged tip
constexpr int kCalmLooks = 4;
constexpr double kContactPart = 0.125;  // of the force of a touch: less is no contact
constexpr double kSwitchOff_s = 0.02;
constexpr double kNearEnd = 0.25;  // of the range: withdrawn, or as far from it as can be

std::int64_t ns(double seconds) {
  return static_cast<std::int64_t>(std::llround(seconds * 1e9));
}

template <class... Values>
std::string text(const char* format, Values... values) {
  char line[256];
  std::snprintf(line, sizeof line, format, values...);
  return line;
}

}  // namespace

std::string_view name(Role role) noexcept {
  constexpr std::string_view kNames[] = {"motion", "reads", "data", "emergency"};
  return kNames[static_cast<std::size_t>(role)];
}

std::string_view name(Phase phase) noexcept {
  constexpr std::string_view kNames[] = {"checking", "refused",   "engaging",    "lifting",  "taring",
                                         "touching", "following", "withdrawing", "withdrawn"};
  return kNames[static_cast<std::size_t>(phase)];
}

std::string_view name(Cause cause) noexcept {
  constexpr std::string_view kNames[] = {"none",
                                         "no session for long",
                                         "link loss",
                                         "stop",
                                         "force limit",
                                         "lateral force limit",
                                         "controller error",
                                         "connection lost",
                                         "controller silent",
                                         "stale force",
                                         "SafeTip",
                                         "no surface found",
                                         "exit"};
  return kNames[static_cast<std::size_t>(cause)];
}

AfmLogic::AfmLogic(const AfmConfig& config)
    : config_(config),
      model_(config.spring_constant_n_m, 0, kContactPart * config.touch_force_nn, config.slope_max),
      book_(config.spring_constant_n_m) {
  make_checks();
}

double AfmLogic::force_trip_nn() const noexcept {
  return config_.force_max_nn + config_.spring_constant_n_m * 2 * config_.step_nm + 6 * state_.noise_nn;
}

bool AfmLogic::all_connected() const noexcept {
  return std::all_of(connections_.begin(), connections_.end(),
                     [](const Connection& c) { return c.connected; });
}

void AfmLogic::tell(const std::string& line) {
  news_ = line;
  ++news_count_;
}

void AfmLogic::refuse(const std::string& line) {
  if (state_.phase == Phase::kRefused) return;
  refusal_ = line;
  // The checks move nothing; what is found out only by touching ends withdrawn.
  if (state_.phase == Phase::kChecking) {
    state_.phase = Phase::kRefused;
  } else if (!withdrawing()) {
    withdraw(Cause::kController, phase_ns_);
  }
}

void AfmLogic::enter(Phase phase, std::int64_t now_ns) {
  state_.phase = phase;
  phase_ns_ = now_ns;
}

// ---- connections

void AfmLogic::connected(Role role, std::int64_t now_ns) {
  Connection& c = at(role);
  c = {};
  c.connected = true;
  c.next_ns = now_ns;
  if (withdrawing()) {
    if (role == Role::kEmergency) stop_sent_ = withdraw_sent_ = false;
    if (role == Role::kMotion) motion_withdraw_sent_ = false;
  }
}

void AfmLogic::lost(Role role, Loss loss, std::int64_t now_ns) {
  Connection& c = at(role);
  c = {};
  if (state_.phase == Phase::kRefused) return;
  if (state_.phase == Phase::kChecking) {
    const std::string who = "port of " + std::string(name(role)) + ": ";
    refuse(loss == Loss::kGarbage  ? who + "what answers there does not speak the Nanonis protocol"
           : loss == Loss::kSilent ? who + "the controller does not answer; is another client using it?"
                                   : who + "closed by the controller; is it in use by another client?");
    return;
  }
  if (withdrawing()) return;
  withdraw(loss == Loss::kSilent ? Cause::kSilent : Cause::kConnection, now_ns);
  tell("withdrawing: port of " + std::string(name(role)) +
       (loss == Loss::kSilent    ? " does not answer"
        : loss == Loss::kGarbage ? " answers no Nanonis"
                                 : " was closed"));
}

bool AfmLogic::take_close(Role role) noexcept {
  Connection& c = at(role);
  const bool close = c.close;
  c.close = false;
  return close;
}

const Call* AfmLogic::waits_for(Role role) const noexcept {
  return at(role).busy ? &at(role).call : nullptr;
}

std::int64_t AfmLogic::timeout_ns(const Connection& c) const noexcept {
  double s = 1e-3 * config_.reply_timeout_ms;
  if (c.call.id == kSignalValsGet) s += 2 * config_.period_s();
  // The tip goes up as soon as the controller hears: let that stand.
  if (c.call.id == kWithdraw || c.call.id == kStop) s = std::max(s, 1.0);
  return ns(s);
}

bool AfmLogic::send(Role role, CommandId id, std::vector<double> numbers, std::int64_t now_ns, Call& call) {
  call = {id, std::move(numbers)};
  Connection& c = at(role);
  c.busy = true;
  c.call = call;
  c.sent_ns = now_ns;
  return true;
}

bool AfmLogic::next(Role role, std::int64_t now_ns, Call& call) {
  Connection& c = at(role);
  if (!c.connected || c.busy || now_ns < c.next_ns) return false;
  if (state_.phase == Phase::kRefused) return false;
  if (state_.phase == Phase::kChecking) {
    if (!all_connected() || next_check_ >= checks_.size() || checks_[next_check_].role != role) return false;
    const Call& check = checks_[next_check_].call;
    return send(role, check.id, check.numbers, now_ns, call);
  }
  switch (role) {
    case Role::kReads:
      return send(role, kSignalValsGet, {1.0 * config_.deflection_signal, 1.0 * config_.lateral_signal, 0.0},
                  now_ns, call);
    case Role::kMotion:
      return next_motion(now_ns, call);
    case Role::kData:
      return next_data(now_ns, call);
    case Role::kEmergency:
      return next_emergency(now_ns, call);
  }
  return false;
}

void AfmLogic::answered(Role role, const Answer& answer, std::int64_t now_ns) {
  Connection& c = at(role);
  if (!c.busy) return;
  c.busy = false;
  const CommandId id = c.call.id;
  const std::int64_t sent_ns = c.sent_ns;
  if (state_.phase == Phase::kChecking) {
    const Check check = checks_[next_check_++];
    checked(check, answer);
    if (state_.phase == Phase::kChecking && next_check_ == checks_.size()) engage(now_ns);
    return;
  }
  if (answer.error != 0) {
    if (!withdrawing()) {
      tell(std::string(nanonis::command(id).name) + ": " + answer.error_text);
      withdraw(Cause::kController, now_ns);
    } else if (id == kWithdraw || id == kStop) {
      stop_sent_ = withdraw_sent_ = false;
      c.next_ns = now_ns + kLookPeriodNs;
    }
    return;
  }
  switch (id) {
    case kSignalValsGet:
      return on_reading(answer, sent_ns, now_ns);
    case kStatusGet:
      c.next_ns = now_ns + (state_.phase == Phase::kWithdrawing ? kLookPeriodNs : kEmergencyPeriodNs);
      return on_status(answer.numbers[0], now_ns);
    case kZPosGet:
      if (role == Role::kMotion) return on_motion(answer, now_ns);
      c.next_ns = now_ns + (role == Role::kData ? kDataPeriodNs : kLookPeriodNs);
      return on_height(answer.numbers[0], now_ns);
    default:
      if (role == Role::kMotion) on_motion(answer, now_ns);
  }
}

// ---- checks: nothing moves

void AfmLogic::make_checks() {
  const double d = config_.deflection_signal, l = config_.lateral_signal;
  checks_ = {{Role::kData, {kSignalNamesGet, {}}},
             {Role::kData, {kSignalCalibrGet, {d}}},
             {Role::kData, {kSignalCalibrGet, {l}}},
             {Role::kData, {kPiezoRangeGet, {}}},
             {Role::kEmergency, {kStatusGet, {}}},
             {Role::kMotion, {kZPosGet, {}}},
             {Role::kMotion, {kXyPosGet, {1}}},
             {Role::kData, {kAcqPeriodSet, {config_.period_s()}}},
             {Role::kReads, {kSignalValsGet, {d, l, 1}}},
             {Role::kData, {kWithdrawRateSet, {1e-9 * config_.withdraw_nm_s}}},
             {Role::kData, {kTipLiftSet, {1e-9 * config_.lift_nm}}},
             {Role::kData, {kSwitchOffDelaySet, {kSwitchOff_s}}},
             {Role::kMotion, {kSpeedSet, {1e-9 * config_.speed_nm_s, 1}}},
             {Role::kData, {kSafeTipPropsSet, {0, 0, 0}}},
             {Role::kData, {kSafeTipOnOffSet, {1}}},
             {Role::kData, {kSafeTipPropsGet, {}}},
             {Role::kData, {kSafeTipOnOffGet, {}}}};
}

void AfmLogic::checked(const Check& check, const Answer& answer) {
  const std::string port = "port of " + std::string(name(check.role)) + ": ";
  const std::string& file = config_.path;
  if (answer.error != 0) {
    if (check.call.id == kSignalValsGet || check.call.id == kSignalCalibrGet)
      return refuse(port + "signals " + std::to_string(config_.deflection_signal) + " and " +
                    std::to_string(config_.lateral_signal) + " are not answered: " + answer.error_text);
    return refuse(port + std::string(nanonis::command(check.call.id).name) + " is refused (" +
                  answer.error_text +
                  "): is this the port for that role? --ports lists motion, reads, data, emergency");
  }
  const auto& n = answer.numbers;
  switch (check.call.id) {
    case kSignalNamesGet:
      for (const auto& [key, index] : {std::pair{"deflection", config_.deflection_signal},
                                       std::pair{"lateral", config_.lateral_signal}}) {
        const auto place = static_cast<std::size_t>(index);
        if (place >= answer.texts.size() || answer.texts[place].empty())
          return refuse(file + ": [signals] " + key + ": there is no signal " + std::to_string(index) +
                        "; the controller has " + std::to_string(answer.texts.size()) + " places");
      }
      return;
    case kSignalCalibrGet: {
      const bool deflection = check.call.numbers[0] == config_.deflection_signal;
      if (n[0] == 0)
        return refuse(file + ": [signals] " + (deflection ? "deflection" : "lateral") +
                      ": the controller has no calibration for it");
      if (deflection) {
        calibration_m_v_ = n[0];
        offset_ = n[1];
        if ((n[0] > 0) != (config_.sensitivity_nm_v > 0))
          return refuse(file + ": [calibration] sensitivity_nm_v: " + text("%g", config_.sensitivity_nm_v) +
                        " has the other sign than the controller's calibration of the signal, " +
                        text("%g a volt", n[0]));
      } else {
        lateral_calibration_ = n[0];
        lateral_offset_ = n[1];
      }
      return;
    }
    case kPiezoRangeGet: {
      const double across = 1e9 * std::min(n[0], n[1]);
      range_z_nm_ = 1e9 * n[2];
      if (2 * config_.half_width_nm > across)
        return refuse(file + ": [limits] half_width_nm: " + text("%g", config_.half_width_nm) +
                      " is beyond the piezo's range across, " + text("%g nm in all", across));
      if (config_.top_nm + config_.depth_nm > range_z_nm_ || config_.lift_nm > range_z_nm_)
        return refuse(file + ": [limits] top_nm and depth_nm: " +
                      text("%g + %g nm are beyond the piezo's range along Z, %g nm", config_.top_nm,
                           config_.depth_nm, range_z_nm_));
      return;
    }
    case kStatusGet:
      if (n[0] != static_cast<double>(ZStatus::kOff))
        return refuse(port + text("the Z controller is not off (status %g): withdraw the tip first", n[0]));
      return;
    case kZPosGet: {
      top_height_nm_ = height_nm_ = height_of(n[0]);
      if (height_nm_ < -kNearEnd * range_z_nm_)
        return refuse(
            file + ": [calibration] z_sign: the tip stands at Z = " + text("%g nm", 1e9 * n[0]) +
            ", which by this sign is at the sample's end of the range: wrong sign, or the tip is not "
            "withdrawn");
      if (height_nm_ < kNearEnd * range_z_nm_)
        return refuse(port + text("the tip stands at Z = %g nm: withdraw it first", 1e9 * n[0]));
      return;
    }
    case kXyPosGet:
      start_x_nm_ = 1e9 * n[0];
      start_y_nm_ = 1e9 * n[1];
      return;
    case kSignalValsGet: {
      if (n.size() != 2) return refuse(port + "Signals.ValsGet does not return what was asked for");
      const double volts = (n[0] - offset_) / calibration_m_v_;
      free_deflection_nm_ = config_.sensitivity_nm_v * volts;
      // SafeTip looks at the signal itself: its size where the lever is free, and what the trip adds.
      const double per_nn =
          std::fabs(calibration_m_v_ / (config_.sensitivity_nm_v * config_.spring_constant_n_m));
      const double threshold =
          std::fabs(n[0]) + per_nn * (force_trip_nn() + 2 * config_.step_nm * config_.spring_constant_n_m);
      for (Check& later : checks_) {
        if (later.call.id == kSafeTipPropsSet) later.call.numbers = {0, 0, threshold};
      }
      return;
    }
    case kSafeTipPropsGet: {
      double set = 0;
      for (const Check& c : checks_) {
        if (c.call.id == kSafeTipPropsSet) set = c.call.numbers[2];
      }
      if (n[0] != 0 || !(std::fabs(n[2] - set) <= 1e-6 * std::fabs(set)))
        return refuse(port + "the controller did not take the settings of SafeTip");
      return;
    }
    case kSafeTipOnOffGet:
      if (n[0] != 1) return refuse(port + "the controller did not switch SafeTip on");
      return;
    default:
      return;
  }
}

// ---- approach

void AfmLogic::engage(std::int64_t now_ns) {
  enter(Phase::kEngaging, now_ns);
  engage_ns_ = now_ns;
  engage_step_ = 0;
  calm_ = 0;
  state_.cause = Cause::kNone;
  state_.force_known = false;
  book_.interrupt();
  reading_ns_ = now_ns;
  session_ns_ = now_ns;
  tell("approaching");
}

double AfmLogic::contact_height_nm(std::int64_t now_ns) const noexcept {
  return surface_height_nm_ + drift_nm_s_ * 1e-9 * static_cast<double>(now_ns - surface_ns_);
}

bool AfmLogic::send_z(double z_w_nm, std::int64_t now_ns, Call& call) {
  height_nm_ = z_w_nm + contact_height_nm(now_ns);
  sent_w_nm_.z() = z_w_nm;
  history_.add(now_ns, sent_w_nm_);
  state_.base_w_nm = sent_w_nm_;
  return send(Role::kMotion, kZPosSet, {1e-9 * config_.z_sign * height_nm_}, now_ns, call);
}

bool AfmLogic::next_motion(std::int64_t now_ns, Call& call) {
  Connection& c = at(Role::kMotion);
  switch (state_.phase) {
    case Phase::kEngaging:
      if (engage_step_ == 0) return send(Role::kMotion, kOnOffSet, {1}, now_ns, call);
      if (engage_step_ == 1) {
        c.next_ns = now_ns + kLookPeriodNs;
        return send(Role::kMotion, kZPosGet, {}, now_ns, call);
      }
      return send(Role::kMotion, kOnOffSet, {0}, now_ns, call);
    case Phase::kLifting:
      if (engage_step_ == 0) {
        c.next_ns = now_ns + 5 * kMs;
        return send(Role::kMotion, kOnOffGet, {}, now_ns, call);
      }
      return send(Role::kMotion, kZPosGet, {}, now_ns, call);
    case Phase::kTouching:
      return next_touch(now_ns, call);
    case Phase::kFollowing:
      return next_move(now_ns, call);
    case Phase::kWithdrawing:
      if (motion_withdraw_sent_) return false;
      motion_withdraw_sent_ = true;
      return send(Role::kMotion, kWithdraw, {0, -1}, now_ns, call);
    default:
      return false;
  }
}

void AfmLogic::on_motion(const Answer& answer, std::int64_t now_ns) {
  const CommandId id = at(Role::kMotion).call.id;
  if (state_.phase == Phase::kEngaging) {
    if (id == kOnOffSet && engage_step_ == 0) {
      engage_step_ = 1;
      last_height_nm_ = 1e300;
    } else if (id == kZPosGet && engage_step_ == 1) {
      const double height = height_of(answer.numbers[0]);
      const bool still = std::fabs(height - last_height_nm_) < kCalmNm && state_.force_known;
      calm_ = still ? calm_ + 1 : 0;
      last_height_nm_ = height;
      if (calm_ < kCalmLooks) return;
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
    } else if (id == kOnOffSet && engage_step_ == 2) {
      enter(Phase::kLifting, now_ns);
      engage_step_ = 0;
    }
  } else if (state_.phase == Phase::kLifting) {
    if (id == kOnOffGet) {
      if (answer.numbers[0] != 0) return;
      engage_step_ = 1;
      at(Role::kMotion).next_ns = now_ns + kSettleNs;
    } else if (id == kZPosGet) {
      height_nm_ = height_of(answer.numbers[0]);
      const double lifted = height_nm_ - settled_height_nm_;
      if (lifted < 0.5 * config_.lift_nm) {
        refusal_ =
            config_.path + text(
                               ": [calibration] z_sign: a lift of %g nm moved Z by %g nm: wrong sign (the "
                               "tip was withdrawn)",
                               config_.lift_nm, lifted);
        return withdraw(Cause::kController, now_ns);
      }
      surface_height_nm_ = settled_height_nm_;
      surface_ns_ = now_ns;
      history_.clear();
      sent_w_nm_ = Vec3(sent_w_nm_.x(), sent_w_nm_.y(), height_nm_ - contact_height_nm(now_ns));
      history_.add(now_ns, sent_w_nm_);
      state_.base_w_nm = sent_w_nm_;
      model_.forget_place();
      tared_ = 0;
      tare_sum_ = tare_squares_ = tare_lateral_sum_ = 0;
      enter(Phase::kTaring, now_ns);
    }
  } else if (state_.phase == Phase::kTouching && id == kZPosSet) {
    touch_moved_ns_ = now_ns;
  }
}

void AfmLogic::tare(double deflection_nm, double lateral_nn, std::int64_t sent_ns, std::int64_t now_ns) {
  if (sent_ns - ns(config_.period_s()) < phase_ns_ + kSettleNs) return;  // averaged before the tip was free
  ++tared_;
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
  touches_ = 0;
  touch_ = Touch::kDown;
  touch_fresh_ = false;
  touch_moved_ns_ = now_ns;
  touch_from_height_nm_ = height_nm_;
  enter(Phase::kTouching, now_ns);
}

bool AfmLogic::next_touch(std::int64_t now_ns, Call& call) {
  if (touch_ == Touch::kPause) {
    if (now_ns < touch_ns_ + ns(config_.touch_pause_s)) return false;
    touch_ = Touch::kDown;
    touch_fresh_ = false;
    touch_moved_ns_ = now_ns;
  }
  if (touch_ == Touch::kDown) {
    // Each step down waits for a reading that was begun after the last one.
    if (!touch_fresh_) return false;
    touch_fresh_ = false;
    return send_z(sent_w_nm_.z() - config_.step_nm, now_ns, call);
  }
  if (sent_w_nm_.z() >= config_.lift_nm) {
    touched(now_ns);
    return false;
  }
  if (now_ns < last_move_ns_ + ns(config_.step_nm / config_.speed_nm_s)) return false;
  last_move_ns_ = now_ns;
  return send_z(std::min(sent_w_nm_.z() + config_.step_nm, config_.lift_nm), now_ns, call);
}

void AfmLogic::touch_reading(std::int64_t sent_ns, std::int64_t now_ns) {
  if (touch_ != Touch::kDown || at(Role::kMotion).busy) return;
  if (sent_ns - ns(config_.period_s()) < touch_moved_ns_) return;
  touch_fresh_ = true;
  const double force = state_.measured_force_w_nn.z();
  model_.add(sent_w_nm_, force, now_ns);
  if (force >= config_.touch_force_nn) {
    touch_ = Touch::kUp;
    touch_height_nm_ = height_nm_ + force / model_.stiffness_n_m();
    touch_ns_ = now_ns;
  } else if (sent_w_nm_.z() < -2 * config_.lift_nm - config_.step_nm) {
    tell("no surface where the Z controller found one");
    withdraw(Cause::kNoSurface, now_ns);
  }
}

void AfmLogic::touched(std::int64_t now_ns) {
  ++touches_;
  if (touches_ >= 2) {
    const double dt_s = 1e-9 * static_cast<double>(touch_ns_ - last_touch_ns_);
    const double rate = (touch_height_nm_ - last_touch_height_nm_) / dt_s;
    if (std::fabs(rate) > config_.drift_max_nm_s) {
      tell(text("the surface moves by %g nm/s: more than drift", rate));
      return withdraw(Cause::kNoSurface, now_ns);
    }
    drift_nm_s_ = rate;
    drift_known_ = true;
  }
  last_touch_height_nm_ = touch_height_nm_;
  last_touch_ns_ = touch_ns_;
  surface_height_nm_ = touch_height_nm_;
  surface_ns_ = touch_ns_;
  // W's zero has moved to where the tip touched: the tip stands as much lower in it.
  sent_w_nm_.z() = height_nm_ - contact_height_nm(now_ns);
  history_.clear();
  history_.add(now_ns, sent_w_nm_);
  state_.base_w_nm = sent_w_nm_;
  // The same ground in the new frame: known where the touch saw it.
  model_.forget_place();
  model_.add(
      Vec3(sent_w_nm_.x(), sent_w_nm_.y(), -model_.contact_threshold_nn() * 1.01 / model_.stiffness_n_m()),
      model_.contact_threshold_nn() * 1.01, now_ns);
  model_.forget_place();
  state_.model = model_.model();
  if (touches_ < 2) {
    touch_ = Touch::kPause;
    return;
  }
  ever_touched_ = true;
  was_touching_ = false;
  enter(Phase::kFollowing, now_ns);
  last_move_ns_ = last_xy_ns_ = now_ns;
  session_ns_ = now_ns;
  last_book_ns_ = now_ns;
  book_.interrupt();
  tell(text("surface found; drift %+.3f nm/s, noise %.2f nN, stiffness %.3g N/m", drift_nm_s_,
            state_.noise_nn, model_.stiffness_n_m()));
}

// ---- following

double AfmLogic::lowest_allowed_nm(std::int64_t now_ns) noexcept {
  const MotionHistory::Stretch since = history_.between(reading_from_ns_, now_ns);
  const double k = config_.spring_constant_n_m;
  const double left_nn = config_.force_max_nn - state_.measured_force_w_nn.z();
  return since.highest_nm + config_.slope_max * since.path_across_nm - left_nn / k;
}

bool AfmLogic::next_move(std::int64_t now_ns, Call& call) {
  if (!state_.force_known) return false;
  const bool told = wish_.session != 0 && wish_.follow;
  const Vec3 low(-config_.half_width_nm, -config_.half_width_nm, -config_.depth_nm);
  const Vec3 high(config_.half_width_nm, config_.half_width_nm, config_.top_nm);
  const Vec3 target = told ? Vec3(wish_.target_w_nm.cwiseMax(low).cwiseMin(high)) : sent_w_nm_;
  const double lowest = lowest_allowed_nm(now_ns);
  state_.held_by_force = told && target.z() < lowest;
  const double reach = [&](std::int64_t last_ns) {
    return std::min(config_.step_nm, config_.speed_nm_s * 1e-9 * static_cast<double>(now_ns - last_ns));
  }(last_move_ns_);
  const double up = std::max(target.z(), lowest) - sent_w_nm_.z();
  const Eigen::Vector2d across = (target - sent_w_nm_).head<2>();
  // What lies within a thousandth of a step is there.
  const double least = 1e-3 * config_.step_nm;
  const bool wants_across = across.norm() > least;
  // Holding still along Z must be told too, as the rig drifts.
  const double stale_z = std::fabs(drift_nm_s_) * 1e-9 * static_cast<double>(now_ns - last_move_ns_);
  const bool wants_z = std::fabs(up) > least || stale_z > 0.05 * config_.step_nm;
  if (wants_across && (across_next_ || !wants_z)) {
    const double may =
        std::min(config_.step_nm, config_.speed_nm_s * 1e-9 * static_cast<double>(now_ns - last_xy_ns_));
    // Ground may rise under a move across: not where that could pass the limit before it is read.
    const bool room = sent_w_nm_.z() - config_.slope_max * may >= lowest || across.norm() <= 0;
    across_next_ = false;
    if (may > least && room) {
      const Eigen::Vector2d move =
          across.norm() > may ? Eigen::Vector2d(across * (may / across.norm())) : across;
      sent_w_nm_.head<2>() += move;
      last_xy_ns_ = now_ns;
      history_.add(now_ns, sent_w_nm_);
      state_.base_w_nm = sent_w_nm_;
      return send(Role::kMotion, kXyPosSet,
                  {1e-9 * (start_x_nm_ + sent_w_nm_.x()), 1e-9 * (start_y_nm_ + sent_w_nm_.y()), 0}, now_ns,
                  call);
    }
  }
  if (!wants_z || !(reach > least)) {
    across_next_ = true;
    return false;
  }
  across_next_ = true;
  last_move_ns_ = now_ns;
  return send_z(sent_w_nm_.z() + std::clamp(up, -reach, reach), now_ns, call);
}

void AfmLogic::on_reading(const Answer& answer, std::int64_t sent_ns, std::int64_t now_ns) {
  if (answer.numbers.size() != 2) return withdraw(Cause::kController, now_ns);
  const double deflection_nm = config_.sensitivity_nm_v * (answer.numbers[0] - offset_) / calibration_m_v_;
  const double lateral_nn =
      config_.lateral_nn_v * (answer.numbers[1] - lateral_offset_) / lateral_calibration_;
  const std::int64_t period_ns = ns(config_.period_s());
  const bool free = state_.phase == Phase::kEngaging || state_.phase == Phase::kLifting;
  const double zero_nm = free ? free_deflection_nm_ : tare_nm_;
  state_.measured_force_w_nn = Vec3(free ? 0 : lateral_nn - tare_lateral_nn_, 0,
                                    config_.spring_constant_n_m * (deflection_nm - zero_nm));
  state_.measured_ns = now_ns - period_ns / 2;
  state_.force_known = true;
  reading_from_ns_ = sent_ns - period_ns;
  reading_ns_ = now_ns;
  if (withdrawing()) return;
  if (state_.phase == Phase::kTaring) return tare(deflection_nm, lateral_nn, sent_ns, now_ns);

  const Vec3& force = state_.measured_force_w_nn;
  if (force.z() > force_trip_nn() && state_.phase != Phase::kEngaging) {
    tell(text("force %.4g nN, over the limit of %.4g nN", force.z(), config_.force_max_nn));
    return withdraw(Cause::kForceLimit, now_ns);
  }
  if (std::fabs(force.x()) > config_.lateral_max_nn) {
    tell(text("lateral force %.4g nN, over the limit of %.4g nN", force.x(), config_.lateral_max_nn));
    return withdraw(Cause::kLateralLimit, now_ns);
  }
  if (state_.phase == Phase::kTouching) return touch_reading(sent_ns, now_ns);
  if (state_.phase != Phase::kFollowing) return;

  const MotionHistory::Stretch averaged = history_.between(now_ns - period_ns, now_ns);
  state_.measured_base_w_nm = averaged.mean_w_nm;
  model_.add(averaged.mean_w_nm, force.z(), now_ns);
  state_.model = model_.model();
  state_.touching = model_.touching();
  WorkBook::Reading reading;
  reading.base_w_nm = averaged.mean_w_nm;
  reading.force_w_nn = force;
  reading.way_nm = history_.between(last_book_ns_, now_ns).path_nm;
  reading.window_way_nm = history_.between(reading_from_ns_, now_ns).path_nm;
  const bool touches =
      state_.touching || was_touching_ || std::fabs(force.z()) > model_.contact_threshold_nn();
  book_.add(reading, 3 * state_.noise_nn, touches, model_.model().adhesion_nn);
  was_touching_ = state_.touching;
  last_book_ns_ = now_ns - period_ns;
  state_.energy_in_aj = book_.energy_in_aj();
  state_.energy_out_aj = book_.energy_out_aj();
  state_.energy_bound_aj = book_.bound_aj();
}

// ---- watching

bool AfmLogic::next_data(std::int64_t now_ns, Call& call) {
  if (state_.phase == Phase::kWithdrawing || state_.phase == Phase::kWithdrawn)
    return send(Role::kData, kZPosGet, {}, now_ns, call);
  at(Role::kData).next_ns = now_ns + kDataPeriodNs;
  return send(Role::kData, kStatusGet, {}, now_ns, call);
}

void AfmLogic::on_status(double status, std::int64_t now_ns) {
  if (status == static_cast<double>(ZStatus::kSafeTip)) {
    if (!withdrawing()) {
      tell("the controller's SafeTip has withdrawn the tip");
      withdraw(Cause::kSafeTip, now_ns);
    }
    return;
  }
  const bool off = status == static_cast<double>(ZStatus::kOff);
  if ((state_.phase == Phase::kTouching || state_.phase == Phase::kFollowing ||
       state_.phase == Phase::kTaring) &&
      !off) {
    tell(text("the Z controller was switched by someone else (status %g)", status));
    withdraw(Cause::kController, now_ns);
  }
}

void AfmLogic::on_height(double z_m, std::int64_t now_ns) {
  if (!withdrawing()) return;
  const double height = height_of(z_m);
  height_nm_ = height;
  // Up means: as far as it stood when this began, or at the upper end.
  const double up = std::min(top_height_nm_, 0.45 * range_z_nm_);
  const bool is_up = height > up - 1;
  if (state_.phase == Phase::kWithdrawing && is_up) {
    enter(Phase::kWithdrawn, now_ns);
    tell("withdrawn: " + std::string(name(state_.cause)));
  } else if (!is_up && now_ns > withdraw_ns_ + 100 * kMs) {
    // On its way, or brought down again by a command that was late: once more.
    state_.phase = Phase::kWithdrawing;
    withdraw_ns_ = now_ns;
    stop_sent_ = withdraw_sent_ = motion_withdraw_sent_ = false;
  }
}

// ---- withdrawing

void AfmLogic::withdraw(Cause cause, std::int64_t now_ns) {
  if (state_.phase == Phase::kChecking || state_.phase == Phase::kRefused) return;
  if (withdrawing()) {
    if (state_.cause == Cause::kParked && cause != Cause::kParked) {
      state_.cause = cause;
      ++state_.latches;
      cleared_ = wish_.clears;
    }
    return;
  }
  enter(Phase::kWithdrawing, now_ns);
  state_.cause = cause;
  state_.held_by_force = false;
  state_.touching = false;
  if (cause != Cause::kParked) ++state_.latches;
  cleared_ = wish_.clears;
  withdraw_ns_ = now_ns;
  stop_sent_ = withdraw_sent_ = motion_withdraw_sent_ = false;
  at(Role::kEmergency).next_ns = now_ns;
  at(Role::kMotion).next_ns = now_ns;
  book_.interrupt();
  tell("withdrawing: " + std::string(name(cause)));
}

bool AfmLogic::next_emergency(std::int64_t now_ns, Call& call) {
  if (state_.phase == Phase::kWithdrawing) {
    // Stop first would cost its reply's time: up comes before across.
    if (!withdraw_sent_) {
      withdraw_sent_ = true;
      return send(Role::kEmergency, kWithdraw, {0, -1}, now_ns, call);
    }
    if (!stop_sent_) {
      stop_sent_ = true;
      return send(Role::kEmergency, kStop, {}, now_ns, call);
    }
    return send(Role::kEmergency, kZPosGet, {}, now_ns, call);
  }
  if (state_.phase == Phase::kWithdrawn) return send(Role::kEmergency, kZPosGet, {}, now_ns, call);
  return send(Role::kEmergency, kStatusGet, {}, now_ns, call);
}

void AfmLogic::tick(std::int64_t now_ns, const PortWish& wish) {
  wish_ = wish;
  state_.time_ns = now_ns;
  for (std::size_t i = 0; i < kRoles; ++i) {
    Connection& c = connections_[i];
    if (!c.busy || now_ns - c.sent_ns <= timeout_ns(c)) continue;
    lost(static_cast<Role>(i), Loss::kSilent, now_ns);
    connections_[i].close = true;
  }
  if (state_.phase == Phase::kChecking || state_.phase == Phase::kRefused) return;

  if (withdrawing()) {
    if (state_.phase != Phase::kWithdrawn || !all_connected() || !refusal_.empty()) return;
    const bool wanted = wish_.session != 0 && wish_.follow && !wish_.retract &&
                        now_ns - wish_.time_ns < ns(1e-3 * config_.link_loss_ms);
    const bool free = state_.cause == Cause::kParked || wish_.clears != cleared_;
    if (wanted && free && state_.cause != Cause::kExit) engage(now_ns);
    return;
  }
  const bool approaching = state_.phase != Phase::kFollowing;
  if (approaching && now_ns > engage_ns_ + ns(config_.timeout_s + config_.touch_pause_s)) {
    withdraw(Cause::kNoSurface, now_ns);
    return;
  }
  if (now_ns - reading_ns_ > ns(config_.stale_force_s())) {
    withdraw(Cause::kStaleForce, now_ns);
    return;
  }
  if (wish_.retract && now_ns - wish_.time_ns < ns(1e-3 * config_.link_loss_ms)) {
    withdraw(Cause::kStop, now_ns);
    return;
  }
  if (wish_.session == 0) {
    if (!approaching && now_ns > session_ns_ + ns(config_.park_after_s)) withdraw(Cause::kParked, now_ns);
  } else if (now_ns - wish_.time_ns > ns(1e-3 * config_.link_loss_ms)) {
    withdraw(Cause::kLinkLoss, now_ns);
  }
}

}  // namespace telenano::afm
