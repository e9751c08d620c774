// AfmLogic: the checks before anything moves.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm/afm_units.h"

namespace telenano::afm {

namespace {

constexpr double kEnd = 0.99;      // of a signal's range
constexpr double kNearEnd = 0.25;  // of the range: withdrawn, or as far from it as can be

}  // namespace

std::string AfmLogic::setpoint_excess(const AfmReading& reading) const {
  const double setpoint = reading.numbers[0], deflection_nm = reading.numbers[1];
  const double force_nn = config_.spring_constant_n_m * (deflection_nm - free_deflection_nm_);
  if (force_nn <= config_.force_max_nn) return {};
  return text(
      "the Z controller's set point, %g in the signal's unit, presses with %.4g nN, over the limit of %.4g "
      "nN: lower it",
      setpoint, force_nn, config_.force_max_nn);
}

bool AfmLogic::gives_back() const noexcept {
  if (given_back_ >= port_->give_back_steps()) return false;
  return state_.phase == Phase::kRefused ||
         (state_.phase == Phase::kWithdrawn && (ending_ || !refusal_.empty()));
}

bool AfmLogic::finished() const noexcept {
  const bool all = given_back_ >= port_->give_back_steps();
  if (state_.phase == Phase::kRefused) return all || !at(port_->give_back_role(given_back_)).connected;
  return state_.phase == Phase::kWithdrawn && (ending_ || !refusal_.empty()) && all;
}

/// SafeTip's signal in the air: that of the deflection, within a tenth of what the force limit adds.
void AfmLogic::on_watched(double value) {
  if (state_.phase == Phase::kChecking) {
    const double tenth = 0.1 * std::fabs(port_->signal_of(force_trip_nn() / config_.spring_constant_n_m) -
                                         port_->signal_of(0));
    const double deflection = port_->signal_of(free_deflection_nm_);
    if (std::fabs(value - deflection) > tenth)
      refuse(
          text("SafeTip watches another signal than the deflection: it reads %g where the deflection is %g; "
               "choose the deflection in the controller's SafeTip",
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
      port_->signal_of(tare_nm_ + state_.measured_force_w_nn.z() / config_.spring_constant_n_m) -
      port_->signal_of(tare_nm_);
  const double watched = safe_tip_touch_ - safe_tip_air_;
  // Half of it is for noise: SafeTip's signal may not be averaged.
  if (std::fabs(watched - deflection) <= 0.5 * std::fabs(deflection)) {
    touch_ = Touch::kUp;
    return;
  }
  refusal_ = text(
      "SafeTip watches another signal than the deflection: as the tip touched, the deflection changed by %g, "
      "and what SafeTip watches by %g; choose the deflection in the controller's SafeTip (the tip was "
      "withdrawn)",
      deflection, watched);
  withdraw(Cause::kController, now_ns);
}

/// The same signal by two ways: while the base rests, what SafeTip sees cannot differ from the reading by half
/// of the force limit. It may not be averaged: three times in a row.
void AfmLogic::watch_safe_tip(double value, std::int64_t sent_ns, std::int64_t now_ns) {
  const std::int64_t from_ns = std::min(sent_ns, reading_from_ns_) - ns(config_.period_s());
  if (!state_.force_known || history_.between(from_ns, now_ns).path_nm > 0.5 * config_.step_nm) return;
  const double k = config_.spring_constant_n_m;
  const double read =
      port_->signal_of(tare_nm_ + state_.measured_force_w_nn.z() / k) - port_->signal_of(tare_nm_);
  const double half = 0.5 * std::fabs(port_->signal_of(config_.force_max_nn / k) - port_->signal_of(0));
  safe_tip_differs_ = std::fabs(value - safe_tip_air_ - read) > half ? safe_tip_differs_ + 1 : 0;
  if (safe_tip_differs_ < 3) return;
  withdraw(Cause::kSignal, now_ns);
  tell("withdrawing: SafeTip does not see the force that is read: another signal is read, or watched");
}

/// What a step of the start has told. What only concerns one kind of controller its adapter has judged.
void AfmLogic::checked(Role role, const AfmReading& reading) {
  if (!reading.unfit.empty()) return refuse(reading.unfit);
  const std::string port = "port of " + std::string(name(role)) + ": ";
  const std::string& file = config_.path;
  if (!reading.refused.empty()) return refuse(port + reading.refused + " is refused (" + reading.why + ")");
  const auto& n = reading.numbers;
  switch (reading.kind) {
    case ReadingKind::kRange: {
      const double across = n[0];
      range_z_nm_ = n[1];
      if (2 * config_.half_width_nm > across)
        return refuse(file + ": [limits] half_width_nm: " + text("%g", config_.half_width_nm) +
                      " is beyond the piezo's range across, " + text("%g nm in all", across));
      if (config_.top_nm + config_.depth_nm > range_z_nm_ || config_.lift_nm > range_z_nm_)
        return refuse(file + ": [limits] top_nm and depth_nm: " +
                      text("%g + %g nm are beyond the piezo's range along Z, %g nm", config_.top_nm,
                           config_.depth_nm, range_z_nm_));
      return;
    }
    case ReadingKind::kStatus:
      if (reading.status != AfmStatus::kOff)
        return refuse(port + text("the Z controller is not off (status %g): withdraw the tip first", n[0]));
      return;
    case ReadingKind::kHeight: {
      top_height_nm_ = height_nm_ = n[0];
      const double z_nm = config_.z_sign * height_nm_;  // as the controller shows it
      if (height_nm_ < -kNearEnd * range_z_nm_)
        return refuse(
            file + ": [calibration] z_sign: the tip stands at Z = " + text("%g nm", z_nm) +
            ", which by this sign is at the sample's end of the range: wrong sign, or the tip is not "
            "withdrawn");
      if (height_nm_ < kNearEnd * range_z_nm_)
        return refuse(port + text("the tip stands at Z = %g nm: withdraw it first", z_nm));
      return;
    }
    case ReadingKind::kPlace:
      start_x_nm_ = n[0];
      start_y_nm_ = n[1];
      return;
    case ReadingKind::kSignals: {
      const double volts = n[0];
      free_volts_.push_back(volts);
      free_lateral_v_.push_back(n[1]);
      for (const double v : {volts, n[1]}) {
        if (std::fabs(v) > kEnd * config_.range_v)
          return refuse(
              port + text("a signal stands at %.4g V, an end of its range, [signals] range_v %g: align the "
                          "laser",
                          v, config_.range_v));
      }
      if (free_volts_.size() > 1) {
        watch_.learn_lateral(free_lateral_v_);
        return watch_.learn(free_volts_);
      }
      free_deflection_nm_ = config_.sensitivity_nm_v * volts;
      const double trip_v =
          volts + force_trip_nn() / (config_.spring_constant_n_m * config_.sensitivity_nm_v);
      if (std::fabs(trip_v) > kEnd * config_.range_v)
        return refuse(file +
                      text(": [limits] force_max_nn: the force limit of %g nN would show as %.4g V, beyond "
                           "the end of the signal, [signals] range_v %g: lower the limit or align the laser",
                           config_.force_max_nn, trip_v, config_.range_v));
      return;
    }
    case ReadingKind::kSetpoint: {
      const std::string excess = setpoint_excess(reading);
      if (!excess.empty()) return refuse(file + ": [limits] force_max_nn: " + excess);
      return;
    }
    case ReadingKind::kWatched:
      return on_watched(n[0]);
    default:
      return;
  }
}

}  // namespace telenano::afm
