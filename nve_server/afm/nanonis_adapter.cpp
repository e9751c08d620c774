#include "telenano/nve_server/afm/nanonis_adapter.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/nve_server/afm/afm_units.h"

namespace telenano::afm {

using nanonis::Answer;
using nanonis::Call;
using nanonis::CommandId;
using nanonis::ZStatus;
using enum nanonis::CommandId;

namespace {

constexpr double kSwitchOff_s = 0.02;
constexpr double kSameLever = 0.693;  // logarithm of two
constexpr int kFreeReadings = 19;     // with the first one 20, as signal_watch.h reckons

}  // namespace

NanonisAdapter::NanonisAdapter(const AfmConfig& config) : config_(config) {
  const double d = config_.deflection_signal, l = config_.lateral_signal;
  steps_ = {{Role::kData, {kSignalNamesGet, {}}},
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
  const auto first = std::find_if(steps_.begin(), steps_.end(),
                                  [](const Step& step) { return step.call.id == kSignalValsGet; });
  steps_.insert(first + 1, kFreeReadings, Step{Role::kReads, {kSignalValsGet, {d, l, 0}}});
}

bool NanonisAdapter::averages(const AfmCommand& command) const noexcept {
  return command.op == AfmOp::kRead ||
         (command.op == AfmOp::kSetup && steps_[command.step()].call.id == kSignalValsGet);
}

Call NanonisAdapter::limits_call(double floor_nm) const {
  const double floor_m = 1e-9 * config_.z_sign * floor_nm;
  // Where larger Z is towards the sample, the floor is the high limit.
  if (config_.z_sign > 0) return {kLimitsSet, {outer_high_m_, std::max(floor_m, outer_low_m_)}};
  return {kLimitsSet, {std::min(floor_m, outer_high_m_), outer_low_m_}};
}

Call NanonisAdapter::call_of(const AfmCommand& command) const {
  const auto& n = command.numbers;
  switch (command.op) {
    case AfmOp::kSetup:
      return steps_[command.step()].call;
    case AfmOp::kGiveBack:
      return give_back_[command.step()].call;
    case AfmOp::kRead:
      return {kSignalValsGet, {1.0 * config_.deflection_signal, 1.0 * config_.lateral_signal, 0.0}};
    case AfmOp::kMoveZ:
      return {kZPosSet, {1e-9 * config_.z_sign * n[0]}};
    case AfmOp::kMoveXy:
      return {kXyPosSet, {1e-9 * n[0], 1e-9 * n[1], 0}};
    case AfmOp::kFeedback:
      return {kOnOffSet, {n[0]}};
    case AfmOp::kAskFeedback:
      return {kOnOffGet, {}};
    case AfmOp::kAskHeight:
      return {kZPosGet, {}};
    case AfmOp::kAskStatus:
      return {kStatusGet, {}};
    case AfmOp::kAskSetpoint:
      return {kSetpointGet, {}};
    case AfmOp::kAskWatched:
      return {kSafeTipSignalGet, {}};
    case AfmOp::kAskHeld: {
      const Call calls[kHeld] = {{kSignalCalibrGet, {1.0 * config_.deflection_signal}},
                                 {kSafeTipOnOffGet, {}},
                                 {kSafeTipPropsGet, {}},
                                 {kLimitsEnabledGet, {}},
                                 {kAcqPeriodGet, {}},
                                 {kSignalCalibrGet, {1.0 * config_.lateral_signal}}};
      return calls[command.step() % kHeld];
    }
    case AfmOp::kFloor:
      return limits_call(n[0]);
    case AfmOp::kWithdraw:
      return {kWithdraw, {0, -1}};
    case AfmOp::kStop:
      break;
  }
  return {kStop, {}};
}

std::vector<std::uint8_t> NanonisAdapter::encode(Role role, const AfmCommand& command) {
  Line& l = line(role);
  l.busy = true;
  l.command = command;
  l.call = call_of(command);
  return nanonis::encode_call(l.call);
}

AfmPort::Next NanonisAdapter::next(Role role, AfmReading& reading) {
  Line& l = line(role);
  for (;;) {
    nanonis::Header header;
    std::span<const std::uint8_t> body;
    const auto status = l.reader.next(header, body);
    if (status == nanonis::FrameReader::Status::kNeedMore) return Next::kNeedMore;
    if (status == nanonis::FrameReader::Status::kBroken) return Next::kBroken;
    const nanonis::Command& command = nanonis::command(l.call.id);
    if (!l.busy || header.name != command.name) {
      // The guard keeps its connection: what comes late there is from before it was asked anew.
      if (role == Role::kEmergency) continue;
      return Next::kBroken;
    }
    Answer answer;
    if (!nanonis::decode_answer(command, body, answer)) return Next::kBroken;
    l.busy = false;
    const bool setup = l.command.op == AfmOp::kSetup;
    if (setup && steps_[l.command.step()].keep) {
      reading = {};
      keep(steps_[l.command.step()], answer);
      return Next::kReading;
    }
    std::string unfit;
    if (setup) unfit = set_up(steps_[l.command.step()], answer);
    if (l.command.op == AfmOp::kAskHeld && answer.error == 0) unfit = held(l.call, answer);
    reading = reading_of(l.call, answer);
    reading.unfit = std::move(unfit);
    return Next::kReading;
  }
}

AfmReading NanonisAdapter::reading_of(const Call& call, const Answer& answer) const {
  AfmReading r;
  if (answer.error != 0) {
    r.refused = nanonis::command(call.id).name;
    r.why = answer.error_text;
    return r;
  }
  const auto& n = answer.numbers;
  switch (call.id) {
    case kPiezoRangeGet:
      r.kind = ReadingKind::kRange;
      r.numbers = {1e9 * std::min(n[0], n[1]), 1e9 * n[2]};
      break;
    case kStatusGet:
      r.kind = ReadingKind::kStatus;
      r.numbers = {n[0]};
      if (n[0] == static_cast<double>(ZStatus::kOff)) r.status = AfmStatus::kOff;
      if (n[0] == static_cast<double>(ZStatus::kSafeTip)) r.status = AfmStatus::kProtected;
      break;
    case kZPosGet:
      r.kind = ReadingKind::kHeight;
      r.numbers = {1e9 * config_.z_sign * n[0]};
      break;
    case kXyPosGet:
      r.kind = ReadingKind::kPlace;
      r.numbers = {1e9 * n[0], 1e9 * n[1]};
      break;
    case kSignalValsGet:
      if (n.size() != 2) {
        r.refused = nanonis::command(call.id).name;
        r.why = "does not return what was asked for";
        break;
      }
      r.kind = ReadingKind::kSignals;
      r.numbers = {(n[0] - offset_) / calibration_m_v_, (n[1] - lateral_offset_) / lateral_calibration_,
                   config_.sensitivity_nm_v * (n[0] - offset_) / calibration_m_v_,
                   config_.lateral_nn_v * (n[1] - lateral_offset_) / lateral_calibration_};
      break;
    case kSetpointGet:
      r.kind = ReadingKind::kSetpoint;
      r.numbers = {n[0], config_.sensitivity_nm_v * (n[0] - offset_) / calibration_m_v_};
      break;
    case kSafeTipSignalGet:
      r.kind = ReadingKind::kWatched;
      r.numbers = {n[0]};
      break;
    case kOnOffGet:
      r.kind = ReadingKind::kFeedback;
      r.numbers = {n[0] != 0 ? 1.0 : 0.0};
      break;
    default:
      break;
  }
  return r;
}

/// One line where somebody has changed it since the start.
std::string NanonisAdapter::held(const Call& call, const Answer& answer) const {
  const auto& n = answer.numbers;
  const auto differs = [](double is, double was) { return std::fabs(is - was) > 1e-6 * std::fabs(was); };
  switch (call.id) {
    case kSignalCalibrGet: {
      const bool deflection = call.numbers[0] == config_.deflection_signal;
      const double was = deflection ? calibration_m_v_ : lateral_calibration_;
      if (!differs(n[0], was) && !differs(n[1], deflection ? offset_ : lateral_offset_)) return {};
      return "the calibration of the " + std::string(deflection ? "deflection" : "lateral signal") +
             text(" was changed: %g a volt instead of %g", n[0], was);
    }
    case kSafeTipOnOffGet:
      return n[0] == 1 ? "" : "SafeTip was switched off";
    case kSafeTipPropsGet:
      return n[0] == 0 && !differs(n[2], threshold_) ? "" : "SafeTip's settings were changed";
    case kLimitsEnabledGet:
      return n[0] == 1 ? "" : "the Z limits were switched off";
    case kAcqPeriodGet:
      if (!differs(n[0], config_.period_s())) return {};
      return text("the acquisition period was changed: %g s instead of %g s", n[0], config_.period_s());
    default:
      return {};
  }
}

/// A setting as it was found. What a controller does not tell is not given back.
void NanonisAdapter::keep(const Step& step, const Answer& answer) {
  if (answer.error != 0) return;
  const auto& n = answer.numbers;
  const auto later = [&](CommandId id, std::vector<double> numbers) {
    give_back_.push_back({step.role, {id, std::move(numbers)}});
  };
  switch (step.call.id) {
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
      give_back_.insert(give_back_.begin(), {step.role, {kSafeTipOnOffSet, {n[0] == 1 ? 1.0 : 2.0}}});
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

void NanonisAdapter::set_later(CommandId id, const std::vector<double>& numbers) {
  for (Step& later : steps_) {
    if (later.call.id == id) later.call.numbers = numbers;
  }
}

/// What the answer to a step of the start says about this controller, kept; and one line where it does not
/// fit.
std::string NanonisAdapter::set_up(const Step& step, const Answer& answer) {
  const std::string port = "port of " + std::string(name(step.role)) + ": ";
  const std::string& file = config_.path;
  if (answer.error != 0) {
    if (step.call.id == kSignalValsGet || step.call.id == kSignalCalibrGet)
      return port + "signals " + std::to_string(config_.deflection_signal) + " and " +
             std::to_string(config_.lateral_signal) + " are not answered: " + answer.error_text;
    return port + std::string(nanonis::command(step.call.id).name) + " is refused (" + answer.error_text +
           "): is this the port for that role? --ports lists motion, reads, data, emergency";
  }
  const auto& n = answer.numbers;
  switch (step.call.id) {
    case kSignalNamesGet:
      for (const auto& [key, index] : {std::pair{"deflection", config_.deflection_signal},
                                       std::pair{"lateral", config_.lateral_signal}}) {
        const auto place = static_cast<std::size_t>(index);
        if (place >= answer.texts.size() || answer.texts[place].empty())
          return file + ": [signals] " + key + ": there is no signal " + std::to_string(index) +
                 "; the controller has " + std::to_string(answer.texts.size()) + " places";
      }
      in_metres_ = answer.texts[static_cast<std::size_t>(config_.deflection_signal)].ends_with("(m)");
      return {};
    case kSignalCalibrGet: {
      const bool deflection = step.call.numbers[0] == config_.deflection_signal;
      if (n[0] == 0)
        return file + ": [signals] " + (deflection ? "deflection" : "lateral") +
               ": the controller has no calibration for it";
      if (!deflection) {
        lateral_calibration_ = n[0];
        lateral_offset_ = n[1];
        return {};
      }
      calibration_m_v_ = n[0];
      offset_ = n[1];
      if ((n[0] > 0) != (config_.sensitivity_nm_v > 0))
        return file + ": [calibration] sensitivity_nm_v: " + text("%g", config_.sensitivity_nm_v) +
               " has the other sign than the controller's calibration of the signal, " +
               text("%g a volt", n[0]);
      // Its own value for the same lever: what differs by much is a unit.
      if (in_metres_ && std::fabs(std::log(1e9 * n[0] / config_.sensitivity_nm_v)) > kSameLever)
        return file + text(
                          ": [calibration] sensitivity_nm_v: %g, where the controller's own calibration of "
                          "the signal is %g nm a volt: more than a factor of two apart",
                          config_.sensitivity_nm_v, 1e9 * n[0]);
      return {};
    }
    case kPiezoRangeGet:
      outer_high_m_ = 0.5 * n[2];
      outer_low_m_ = -outer_high_m_;
      return {};
    case kSignalValsGet: {
      if (n.size() != 2) return port + "Signals.ValsGet does not return what was asked for";
      if (std::exchange(threshold_known_, true)) return {};
      set_later(kLimitsSet, {outer_high_m_, outer_low_m_});
      // SafeTip looks at the signal itself: its size where the lever is free, and what is added to it two
      // steps above where the slave withdraws by itself (AfmLogic::force_trip_nn(), without the noise).
      const double k = config_.spring_constant_n_m;
      const double per_nn = std::fabs(calibration_m_v_ / (config_.sensitivity_nm_v * k));
      const double trip_nn = config_.force_max_nn + k * 2 * config_.step_nm;
      set_later(kSafeTipPropsSet, {0, 0, std::fabs(n[0]) + per_nn * (trip_nn + 2 * config_.step_nm * k)});
      return {};
    }
    case kLimitsEnabledGet:
      return n[0] == 1 ? "" : port + "the controller did not switch its Z limits on";
    case kLimitsGet: {
      const double least_m = 1e-6 * (outer_high_m_ - outer_low_m_);
      if (std::fabs(n[0] - outer_high_m_) <= least_m && std::fabs(n[1] - outer_low_m_) <= least_m) return {};
      return port + text("the controller did not take its Z limits: %g to %g m instead of %g to %g m", n[1],
                         n[0], outer_low_m_, outer_high_m_);
    }
    case kSafeTipPropsGet: {
      double set = 0;
      for (const Step& s : steps_) {
        if (s.call.id == kSafeTipPropsSet) set = s.call.numbers[2];
      }
      threshold_ = set;
      if (n[0] == 0 && std::fabs(n[2] - set) <= 1e-6 * std::fabs(set)) return {};
      return port + "the controller did not take the settings of SafeTip";
    }
    case kSafeTipOnOffGet:
      return n[0] == 1 ? "" : port + "the controller did not switch SafeTip on";
    default:
      return {};
  }
}

}  // namespace telenano::afm
