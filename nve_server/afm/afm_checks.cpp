// AfmLogic: the checks before anything moves.
#include <algorithm>
#include <cmath>

#include "nve_server/afm/afm_logic.h"
#include "nve_server/afm/afm_units.h"

namespace telenano::afm {

using nanonis::Answer;
using nanonis::ZStatus;
using enum nanonis::CommandId;

namespace {

constexpr double kSwitchOff_s = 0.02;
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
             {Role::kMotion, {kZPosGet, {}}},
             {Role::kMotion, {kXyPosGet, {1}}},
             {Role::kData, {kAcqPeriodSet, {config_.period_s()}}},
             {Role::kReads, {kSignalValsGet, {d, l, 1}}},
             {Role::kData, {kSetpointGet, {}}},
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
