// AfmLogic: the checks before anything moves.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm/afm_units.h"

namespace telenano::afm {

using nanonis::Answer;
using nanonis::ZStatus;
using enum nanonis::CommandId;

namespace {

constexpr double kSwitchOff_s = 0.02;
constexpr double kEnd = 0.99;      // of a signal's range
constexpr int kFreeReadings = 19;  // with the first one 20, as signal_watch.h reckons
constexpr double kNearEnd = 0.25;  // of the range: withdrawn, or as far from it as can be

}  // namespace

std::string AfmLogic::setpoint_excess(double setpoint) const {
  const double deflection_nm = config_.sensitivity_nm_v * (setpoint - offset_) / calibration_m_v_;
  const double force_nn = config_.spring_constant_n_m * (deflection_nm - free_deflection_nm_);
  if (force_nn <= config_.force_max_nn) return {};
  return text(
      "the Z controller's set point, %g in the signal's unit, presses with %.4g nN, over the limit of %.4g "
      "nN: lower it",
      setpoint, force_nn, config_.force_max_nn);
}

void AfmLogic::make_checks() {
  const double d = config_.deflection_signal, l = config_.lateral_signal;
  checks_ = {{Role::kData, {kSignalNamesGet, {}}},
             {Role::kData, {kSignalCalibrGet, {d}}},
             {Role::kData, {kSignalCalibrGet, {l}}},
             {Role::kData, {kPiezoRangeGet, {}}},
             {Role::kEmergency, {kStatusGet, {}}},
             // Asked there for the guard, which listens: where "up" is, and how far the limits may be set.
             {Role::kEmergency, {kZPosGet, {}}},
             {Role::kEmergency, {kPiezoRangeGet, {}}},
             {Role::kMotion, {kZPosGet, {}}},
             {Role::kMotion, {kXyPosGet, {1}}},
             {Role::kData, {kAcqPeriodGet, {}}, true},
             {Role::kData, {kWithdrawRateGet, {}}, true},
             {Role::kData, {kTipLiftGet, {}}, true},
             {Role::kData, {kSwitchOffDelayGet, {}}, true},
             {Role::kMotion, {kSpeedGet, {}}, true},
             {Role::kData, {kSafeTipPropsGet, {}}, true},
             {Role::kData, {kSafeTipOnOffGet, {}}, true},
             {Role::kData, {kLimitsEnabledGet, {}}, true},
             {Role::kData, {kLimitsGet, {}}, true},
             {Role::kData, {kAcqPeriodSet, {config_.period_s()}}},
             {Role::kReads, {kSignalValsGet, {d, l, 1}}},
             {Role::kData, {kSafeTipSignalGet, {}}},
             {Role::kData, {kSetpointGet, {}}},
             {Role::kData, {kWithdrawRateSet, {1e-9 * config_.withdraw_nm_s}}},
             {Role::kData, {kTipLiftSet, {1e-9 * config_.lift_nm}}},
             {Role::kData, {kSwitchOffDelaySet, {kSwitchOff_s}}},
             {Role::kMotion, {kSpeedSet, {1e-9 * config_.speed_nm_s, 1}}},
             {Role::kData, {kLimitsEnabledSet, {1}}},
             {Role::kData, {kLimitsSet, {0, 0}}},  // when the range is known
             {Role::kData, {kLimitsEnabledGet, {}}},
             {Role::kData, {kLimitsGet, {}}},
             {Role::kData, {kSafeTipPropsSet, {0, 0, 0}}},
             {Role::kData, {kSafeTipOnOffSet, {1}}},
             {Role::kData, {kSafeTipPropsGet, {}}},
             {Role::kData, {kSafeTipOnOffGet, {}}}};
  // What the signal is like where nothing happens, before the Z controller moves by it.
  const auto first = std::find_if(checks_.begin(), checks_.end(),
                                  [](const Check& check) { return check.call.id == kSignalValsGet; });
  checks_.insert(first + 1, kFreeReadings, Check{Role::kReads, {kSignalValsGet, {d, l, 0}}});
}

/// A setting as it was found. What a controller does not tell is not given back.
void AfmLogic::keep(const Check& check, const Answer& answer) {
  if (answer.error != 0) return;
  const auto& n = answer.numbers;
  const auto later = [&](nanonis::CommandId id, std::vector<double> numbers) {
    give_back_.push_back({check.role, {id, std::move(numbers)}});
  };
  switch (check.call.id) {
    case kAcqPeriodGet:
      return later(kAcqPeriodSet, n);
    case kWithdrawRateGet:
      return later(kWithdrawRateSet, n);
    case kTipLiftGet:
      return later(kTipLiftSet, n);
    case kSwitchOffDelayGet:
      return later(kSwitchOffDelaySet, n);
    case kSpeedGet:
      return later(kSpeedSet, n);
    case kSafeTipPropsGet:
      return later(kSafeTipPropsSet, n);
    case kSafeTipOnOffGet:
      // Before its threshold, at which one that was off may act.
      give_back_.insert(give_back_.begin(), {check.role, {kSafeTipOnOffSet, {n[0] == 1 ? 1.0 : 2.0}}});
      return;
    case kLimitsEnabledGet:
      had_limits_ = n[0] == 1;
      return;
    case kLimitsGet: {
      // Limits that leave no room are those that the guard of a killed server has left: not given back, nor
      // kept to.
      const double room_nm = 1e9 * (n[0] - n[1]);
      const bool room = room_nm >= config_.top_nm + config_.depth_nm;
      if (had_limits_ && room) {
        outer_high_m_ = n[0];
        outer_low_m_ = n[1];
      }
      if (room) {
        later(kLimitsEnabledSet, {1});  // without, they cannot be set
        later(kLimitsSet, n);
      }
      return later(kLimitsEnabledSet, {had_limits_ && room ? 1.0 : 0.0});
    }
    default:
      return;
  }
}

bool AfmLogic::gives_back() const noexcept {
  if (given_back_ >= give_back_.size()) return false;
  return state_.phase == Phase::kRefused ||
         (state_.phase == Phase::kWithdrawn && (ending_ || !refusal_.empty()));
}

bool AfmLogic::finished() const noexcept {
  if (state_.phase == Phase::kRefused)
    return given_back_ >= give_back_.size() || !at(give_back_[given_back_].role).connected;
  return state_.phase == Phase::kWithdrawn && (ending_ || !refusal_.empty()) &&
         given_back_ >= give_back_.size();
}

bool AfmLogic::next_given_back(Role role, std::int64_t now_ns, nanonis::Call& call) {
  const Check& back = give_back_[given_back_];
  return back.role == role && send(role, back.call.id, back.call.numbers, now_ns, call);
}

/// SafeTip's signal in the air: that of the deflection, within a tenth of what the force limit adds.
void AfmLogic::on_safe_tip_signal(double value) {
  if (state_.phase == Phase::kChecking) {
    const double tenth = 0.1 * std::fabs(signal_of(force_trip_nn() / config_.spring_constant_n_m) - offset_);
    const double deflection = signal_of(free_deflection_nm_);
    if (std::fabs(value - deflection) > tenth)
      refuse(text(
          "SafeTip watches another signal than the deflection: it says %g where the deflection is %g: choose "
          "the deflection in the controller's SafeTip",
          value, deflection));
    return;
  }
  if (state_.phase == Phase::kTaring) {
    safe_tip_air_ = value;
    safe_tip_air_known_ = true;
  } else if (state_.phase == Phase::kTouching) {
    safe_tip_touch_ = value;
    safe_tip_touch_known_ = true;
  }
}

void AfmLogic::compare_safe_tip(std::int64_t now_ns) {
  const double deflection =
      signal_of(tare_nm_ + state_.measured_force_w_nn.z() / config_.spring_constant_n_m) -
      signal_of(tare_nm_);
  const double watched = safe_tip_touch_ - safe_tip_air_;
  // Half of it is for noise: SafeTip's signal may not be averaged.
  if (std::fabs(watched - deflection) <= 0.5 * std::fabs(deflection)) {
    touch_ = Touch::kUp;
    return;
  }
  refusal_ = text(
      "SafeTip watches another signal than the deflection: as the tip touched, the deflection changed by %g, "
      "and what SafeTip watches by %g: choose the deflection in the controller's SafeTip (the tip was "
      "withdrawn)",
      deflection, watched);
  withdraw(Cause::kController, now_ns);
}

void AfmLogic::checked(const Check& check, const Answer& answer) {
  if (check.keep) return keep(check, answer);
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
      outer_high_m_ = 0.5 * n[2];
      outer_low_m_ = -outer_high_m_;
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
      free_volts_.push_back(volts);
      for (const double v : {volts, (n[1] - lateral_offset_) / lateral_calibration_}) {
        if (std::fabs(v) > kEnd * config_.range_v)
          return refuse(
              port + text("a signal stands at %.4g V, an end of its range, [signals] range_v %g: align the "
                          "laser",
                          v, config_.range_v));
      }
      if (free_volts_.size() > 1) return watch_.learn(free_volts_);
      free_deflection_nm_ = config_.sensitivity_nm_v * volts;
      const double trip_v =
          volts + force_trip_nn() / (config_.spring_constant_n_m * config_.sensitivity_nm_v);
      if (std::fabs(trip_v) > kEnd * config_.range_v)
        return refuse(
            file + text(": [limits] force_max_nn: the force limit of %g nN would show as %.4g V, beyond the "
                        "end of the signal, [signals] range_v %g: lower the one or align the laser",
                        config_.force_max_nn, trip_v, config_.range_v));
      for (Check& later : checks_) {
        if (later.call.id == kLimitsSet) later.call.numbers = {outer_high_m_, outer_low_m_};
      }
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
    case kSafeTipSignalGet:
      return on_safe_tip_signal(n[0]);
    case kLimitsEnabledGet:
      if (n[0] != 1) return refuse(port + "the controller did not switch its Z limits on");
      return;
    case kLimitsGet: {
      const double least_m = 1e-6 * (outer_high_m_ - outer_low_m_);
      if (!(std::fabs(n[0] - outer_high_m_) <= least_m && std::fabs(n[1] - outer_low_m_) <= least_m))
        return refuse(port +
                      text("the controller did not take its Z limits: %g to %g m instead of %g to %g m", n[1],
                           n[0], outer_low_m_, outer_high_m_));
      return;
    }
    case kSetpointGet: {
      const std::string excess = setpoint_excess(n[0]);
      if (!excess.empty()) return refuse(file + ": [limits] force_max_nn: " + excess);
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

}  // namespace telenano::afm
