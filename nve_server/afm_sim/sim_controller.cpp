#include "telenano/nve_server/afm_sim/sim_controller.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "telenano/common/base/det_math.h"

namespace telenano::afm_sim {

using nanonis::Call;
using nanonis::CommandId;
using nanonis::ZStatus;

namespace {

constexpr double kPi = 3.14159265358979323846;
// Shortest steps while something moves, and while there is only drift.
constexpr double kMovingStep_s = 5e-4;
constexpr double kIdleStep_s = 2e-3;

std::int64_t ns(double seconds) {
  return static_cast<std::int64_t>(std::llround(seconds * 1e9));
}

constexpr const char* kNoSuchSignal = "there is no signal of that index";

void deny(SimController::Pending& pending, std::uint32_t code, const char* why) {
  pending.answer = {{}, {}, code, why};
}

bool is_signal(double index) noexcept {
  return index >= 0 && index < kSignalCount;
}

std::vector<std::string> signal_names() {
  std::vector<std::string> names(kSignalCount);
  names[0] = "Current (A)";
  names[kDeflectionSignal] = "Deflection (m)";
  names[kLateralSignal] = "Lateral (V)";
  names[kZSignal] = "Z (m)";
  return names;
}

/// Which port may say what, where roles are restricted.
bool suits(CommandId id, int port) noexcept {
  using enum CommandId;
  switch (id) {
    case kXyPosSet:
    case kSpeedSet:
    case kZPosSet:
    case kOnOffSet:
      return port == 0;
    case kSetpointGet:
      return port == 0 || port == 2;
    case kSignalValsGet:
    case kSignalValGet:
      return port == 1;
    case kStop:
      return port == 0 || port == 3;
    case kWithdraw:
      return port != 1;
    case kStatusGet:
    case kZPosGet:
    case kXyPosGet:
    case kOnOffGet:
    case kPiezoRangeGet:
    case kLimitsEnabledSet:
    case kLimitsSet:
    case kLimitsGet:
      return port != 1;
    case kSpeedGet:
      return port == 0 || port == 2;
    default:
      return port == 2;
  }
}

}  // namespace

SimController::SimController(const SimConfig& config, std::shared_ptr<const scene::Scene> scene)
    : config_(config), tip_(config, std::move(scene)), random_(config.seed), at_start_(config) {
  limit_high_m_ = 0.5e-9 * config_.range_z_nm;
  limit_low_m_ = -limit_high_m_;
  piezo_nm_.z() = retracted_nm();
  acquisition_ns_ = ns(config_.acquisition_s);
  next_acquisition_ns_ = acquisition_ns_;
  tip_.step(piezo_nm_, 0);
}

void SimController::restart() noexcept {
  config_ = at_start_;
  status_ = ZStatus::kOff;
  limits_on_ = safe_tip_on_ = false;
  limit_high_m_ = 0.5e-9 * config_.range_z_nm;
  limit_low_m_ = -limit_high_m_;
  target_nm_ = piezo_nm_;
  acquisition_ns_ = ns(config_.acquisition_s);
}

double SimController::retracted_nm() const noexcept {
  const double end = 0.5 * config_.range_z_nm;
  if (!limits_on_) return end;
  return std::min(end, 1e9 * (config_.z_sign > 0 ? limit_high_m_ : -limit_low_m_));
}

double SimController::withdraw_to_nm() const noexcept {
  return half_way_ ? half_way_nm_ : retracted_nm();
}

double SimController::lowest_nm() const noexcept {
  const double end = -0.5 * config_.range_z_nm;
  if (!limits_on_) return end;
  return std::max(end, 1e9 * (config_.z_sign > 0 ? limit_low_m_ : -limit_high_m_));
}

bool SimController::busy() const noexcept {
  return status_ == ZStatus::kOn || status_ == ZStatus::kWithdrawing || status_ == ZStatus::kSafeTip ||
         status_ == ZStatus::kSwitchingOff || piezo_nm_.head<2>() != target_nm_.head<2>();
}

void SimController::set_sensor_fault(SensorFault fault) noexcept {
  if (sensor_fault_ == SensorFault::kNone) frozen_bend_nm_ = tip_.deflection_nm();
  sensor_fault_ = fault;
}

/// The lever's bending as the photodiode shows it, without offset and noise.
double SimController::sensed_nm(double bend_nm) const noexcept {
  const double end_nm = config_.signal_range_v * std::fabs(config_.deflection_nm_v);
  switch (sensor_fault_) {
    case SensorFault::kFrozen:
      return frozen_bend_nm_;
    case SensorFault::kHighEnd:
      return end_nm - config_.deflection_offset_nm;
    case SensorFault::kLowEnd:
      return -end_nm - config_.deflection_offset_nm;
    case SensorFault::kInverted:
      return -bend_nm;
    case SensorFault::kSwapped:
      return config_.deflection_nm_v * tip_.force_w_nn().x() / config_.lateral_nn_v -
             config_.deflection_offset_nm;
    default:
      return photodiode_gain_ * bend_nm + photodiode_zero_nm_ - (now_ns_ <= dip_until_ns_ ? dip_nm_ : 0);
  }
}

double SimController::safe_tip_signal() const noexcept {
  const double sign = config_.safe_tip_signal < 0 ? -1 : 1;
  switch (std::abs(config_.safe_tip_signal)) {
    case kDeflectionSignal:
      return sign * calibration_factor_ * 1e-9 *
             (sensed_nm(tip_.deflection_nm()) + config_.deflection_offset_nm);
    case kLateralSignal:
      return sign * tip_.force_w_nn().x() / config_.lateral_nn_v;
    case kZSignal:
      return sign * 1e-9 * config_.z_sign * piezo_nm_.z();
    default:
      return 0;
  }
}

double SimController::converted_v(double volts) const noexcept {
  const double within = std::clamp(volts, -config_.signal_range_v, config_.signal_range_v);
  return config_.quantum_v > 0 ? config_.quantum_v * std::nearbyint(within / config_.quantum_v) : within;
}

void SimController::step(double dt_s) noexcept {
  const double move = speed_nm_s_ * dt_s;
  const Vec3 to = Vec3(target_nm_.x() - piezo_nm_.x(), target_nm_.y() - piezo_nm_.y(), 0);
  const double way = to.norm();
  if (way > 0) piezo_nm_ += way > move ? Vec3(to * (move / way)) : to;
  switch (status_) {
    case ZStatus::kOn: {
      const double force_nn = sensor_fault_ == SensorFault::kNone
                                  ? tip_.force_w_nn().z()
                                  : sensed_nm(tip_.deflection_nm()) / tip_.deflection_nm_nn();
      const double error_nn = config_.setpoint_nn - force_nn;
      const double rate =
          std::clamp(config_.feedback_nm_s_nn * error_nn, -config_.approach_nm_s, config_.approach_nm_s);
      piezo_nm_.z() = std::clamp(piezo_nm_.z() - rate * dt_s, lowest_nm(), retracted_nm());
      break;
    }
    case ZStatus::kWithdrawing:
    case ZStatus::kSafeTip:
      piezo_nm_.z() = std::min(piezo_nm_.z() + config_.withdraw_nm_s * dt_s, withdraw_to_nm());
      if (status_ == ZStatus::kWithdrawing && piezo_nm_.z() >= withdraw_to_nm() - 1e-3)
        status_ = ZStatus::kOff;
      break;
    case ZStatus::kSwitchingOff:
      if (now_ns_ >= off_at_ns_) {
        status_ = ZStatus::kOff;
        piezo_nm_.z() = std::clamp(piezo_nm_.z() + config_.tip_lift_nm, lowest_nm(), retracted_nm());
      }
      break;
    default:
      break;
  }
  tip_.step(piezo_nm_, dt_s);
  const double bend_nm = sensed_nm(tip_.deflection_nm());
  sum_s_ += dt_s;
  sum_deflection_ += dt_s * bend_nm;
  sum_lateral_ += dt_s * (sensor_fault_ == SensorFault::kSwapped
                              ? config_.lateral_nn_v * (tip_.deflection_nm() + config_.deflection_offset_nm) /
                                    config_.deflection_nm_v
                              : tip_.force_w_nn().x());
  if (safe_tip_on_ && std::fabs(safe_tip_signal()) > safe_tip_[2] && status_ != ZStatus::kSafeTip &&
      status_ != ZStatus::kWithdrawing) {
    status_ = ZStatus::kSafeTip;
    half_way_ = false;
    target_nm_ = piezo_nm_;
    ++safe_tips_;
  }
}

void SimController::end_acquisition() noexcept {
  if (!(sum_s_ > 0)) return;
  const double time_s = 1e-9 * static_cast<double>(now_ns_);
  const double thermal_nm =
      config_.thermal_nm * det_sin_cos(std::fmod(2 * kPi * time_s / config_.thermal_period_s, 2 * kPi)).sin;
  const double bandwidth = std::sqrt(0.5 / sum_s_);  // of an average over that time
  double noise_nm = config_.noise_nm_sqrt_hz * bandwidth * random_.normal();
  if (sensor_fault_ == SensorFault::kNoisy) noise_nm *= 100;
  const double last_m = value_deflection_m_, last_v = value_lateral_v_;
  value_deflection_m_ =
      1e-9 * (sum_deflection_ / sum_s_ + config_.deflection_offset_nm + thermal_nm + noise_nm);
  value_lateral_v_ =
      (sum_lateral_ / sum_s_ + config_.lateral_noise_nn_sqrt_hz * bandwidth * random_.normal()) /
      config_.lateral_nn_v;
  const double nm_v = std::fabs(config_.deflection_nm_v);
  if (config_.quantum_v > 0 || std::fabs(value_deflection_m_) > 1e-9 * nm_v * config_.signal_range_v)
    value_deflection_m_ = 1e-9 * nm_v * converted_v(1e9 * value_deflection_m_ / nm_v);
  value_lateral_v_ = converted_v(value_lateral_v_);
  if (sensor_fault_ == SensorFault::kFrozen) {
    value_deflection_m_ = last_m;
    value_lateral_v_ = last_v;
  }
  sum_s_ = sum_deflection_ = sum_lateral_ = 0;
}

void SimController::advance_to(std::int64_t to_ns) noexcept {
  while (now_ns_ < to_ns) {
    const std::int64_t longest = ns(busy() ? kMovingStep_s : kIdleStep_s);
    std::int64_t until = std::min({now_ns_ + longest, to_ns, next_acquisition_ns_});
    if (dip_until_ns_ > now_ns_) until = std::min(until, dip_until_ns_);
    const double dt_s = 1e-9 * static_cast<double>(until - now_ns_);
    now_ns_ = until;
    step(dt_s);
    if (now_ns_ >= next_acquisition_ns_) {
      end_acquisition();
      next_acquisition_ns_ += acquisition_ns_;
    }
  }
}

double SimController::true_value(int index) const noexcept {
  switch (index) {
    case kDeflectionSignal:
      return calibration_factor_ * value_deflection_m_;
    case kLateralSignal:
      return value_lateral_v_;
    case kZSignal:
      return 1e-9 * config_.z_sign * piezo_nm_.z();
    default:
      return 0;
  }
}

void SimController::move_across(const Call& call, Pending& pending) {
  const auto& in = call.numbers;
  const double x = 1e9 * in[0], y = 1e9 * in[1];
  if (!(std::fabs(x) <= 0.5 * config_.range_xy_nm && std::fabs(y) <= 0.5 * config_.range_xy_nm))
    return deny(pending, 6, "X or Y is out of the piezo's range");
  ++moves_;
  target_nm_ = Vec3(x, y, 0);
  if (in[2] != 0) {
    pending.wait = Pending::Wait::kArrived;
    pending.deadline_ns = INT64_MAX;
  }
}

void SimController::set_z(double z_m, Pending& pending) {
  if (status_ != ZStatus::kOff) return deny(pending, 4, "the Z controller is not off");
  const double height = 1e9 * config_.z_sign * z_m;
  if (height > retracted_nm() + 1e-3 || height < lowest_nm() - 1e-3)
    return deny(pending, 5, "Z is out of the piezo's range or limits");
  ++moves_;
  piezo_nm_.z() = height;
}

void SimController::switch_z(bool on, std::int64_t now_ns) noexcept {
  ++moves_;
  if (on) {
    status_ = ZStatus::kOn;
  } else if (status_ == ZStatus::kOn) {
    status_ = ZStatus::kSwitchingOff;
    off_at_ns_ = now_ns + ns(config_.switch_off_delay_s);
  } else if (status_ == ZStatus::kSafeTip) {
    status_ = ZStatus::kOff;
  }
}

void SimController::withdraw(const Call& call, std::int64_t now_ns, Pending& pending) {
  const auto& in = call.numbers;
  const bool fails = withdraw_faults_ != 0;
  if (withdraw_faults_ > 0) --withdraw_faults_;
  if (fails && withdraw_fault_ == WithdrawFault::kUndone) return;
  half_way_ = fails;
  half_way_nm_ = 0.5 * (piezo_nm_.z() + retracted_nm());
  status_ = ZStatus::kWithdrawing;
  if (in[0] == 0) return;
  pending.wait = Pending::Wait::kWithdrawn;
  pending.deadline_ns = in[1] < 0 ? INT64_MAX : now_ns + ns(1e-3 * in[1]);
}

void SimController::set_limits(double high_m, double low_m, Pending& pending) {
  if (!(high_m > low_m) || std::fabs(high_m) > 0.501e-9 * config_.range_z_nm ||
      std::fabs(low_m) > 0.501e-9 * config_.range_z_nm)
    return deny(pending, 8, "limits: high is above low, both within the piezo's range");
  if (!limits_on_) return;  // as documented: without effect while they are off
  limit_high_m_ = high_m;
  limit_low_m_ = low_m;
}

/// The average under way is given up: it would be of two periods.
void SimController::set_acquisition(double period_s, Pending& pending) {
  if (!(period_s >= 1e-4 && period_s <= 10))
    return deny(pending, 7, "an acquisition period is 0.1 ms to 10 s");
  acquisition_ns_ = ns(period_s);
  next_acquisition_ns_ = (now_ns_ / acquisition_ns_ + 1) * acquisition_ns_;
  sum_s_ = sum_deflection_ = sum_lateral_ = 0;
}

/// The values themselves are read when their period has ended: finish().
void SimController::ask_signals(const Call& call, Pending& pending) const {
  const auto& in = call.numbers;
  for (std::size_t i = 0; i + 1 < in.size(); ++i) {
    if (!is_signal(in[i])) return deny(pending, 9, kNoSuchSignal);
  }
  pending.reads = true;
  pending.ready_ns =
      std::max(pending.ready_ns, next_acquisition_ns_ + (in.back() != 0 ? acquisition_ns_ : std::int64_t{0}));
}

void SimController::tell_calibration(double index, Pending& pending) const {
  if (!is_signal(index)) return deny(pending, 9, kNoSuchSignal);
  pending.answer.numbers = {
      index == kDeflectionSignal ? calibration_factor_ * 1e-9 * config_.deflection_nm_v : 1.0, 0.0};
}

/// The answer to a question that takes no arguments and cannot be refused; empty: it is no such question.
std::vector<double> SimController::told(CommandId question) const {
  using enum CommandId;
  const auto flag = [](bool on) { return on ? 1.0 : 0.0; };
  switch (question) {
    case kXyPosGet:
      return {1e-9 * piezo_nm_.x(), 1e-9 * piezo_nm_.y()};
    case kSpeedGet:
      return {1e-9 * speed_nm_s_, flag(custom_speed_)};
    case kOnOffGet:
      return {flag(status_ == ZStatus::kOn || status_ == ZStatus::kSwitchingOff)};
    case kZPosGet:
      return {1e-9 * config_.z_sign * piezo_nm_.z()};
    case kStatusGet:
      return {static_cast<double>(status_)};
    case kSetpointGet:
      return {1e-9 * (config_.setpoint_nn * tip_.deflection_nm_nn() + config_.deflection_offset_nm)};
    case kSafeTipOnOffGet:
      return {flag(safe_tip_on_)};
    case kSafeTipPropsGet:
      return {safe_tip_[0], safe_tip_[1], safe_tip_[2]};
    case kSafeTipSignalGet:
      return {safe_tip_signal()};
    case kPiezoRangeGet:
      return {1e-9 * config_.range_xy_nm, 1e-9 * config_.range_xy_nm, 1e-9 * config_.range_z_nm};
    case kAcqPeriodGet:
      return {1e-9 * static_cast<double>(acquisition_ns_)};
    case kWithdrawRateGet:
      return {1e-9 * config_.withdraw_nm_s};
    case kTipLiftGet:
      return {1e-9 * config_.tip_lift_nm};
    case kSwitchOffDelayGet:
      return {config_.switch_off_delay_s};
    case kLimitsEnabledGet:
      return {flag(limits_on_)};
    case kLimitsGet:
      return {limit_high_m_, limit_low_m_};
    default:
      return {};
  }
}

/// Without a default, so that the compiler finds a command that nobody carries out.
void SimController::execute(const Call& call, std::int64_t now_ns, Pending& pending) {
  using enum CommandId;
  const auto& in = call.numbers;
  switch (call.id) {
    case kXyPosSet:
      return move_across(call, pending);
    case kSpeedSet:
      if (!(in[0] > 0)) return deny(pending, 7, "a speed is more than 0");
      speed_nm_s_ = 1e9 * in[0];
      custom_speed_ = in[1] != 0;
      return;
    case kStop:
      target_nm_ = piezo_nm_;
      return;
    case kOnOffSet:
      return switch_z(in[0] != 0, now_ns);
    case kZPosSet:
      return set_z(in[0], pending);
    case kSetpointSet:
      config_.setpoint_nn = (1e9 * in[0] - config_.deflection_offset_nm) / tip_.deflection_nm_nn();
      return;
    case kWithdraw:
      return withdraw(call, now_ns, pending);
    case kWithdrawRateSet:
      if (!(in[0] > 0)) return deny(pending, 7, "a rate is more than 0");
      config_.withdraw_nm_s = 1e9 * in[0];
      return;
    case kTipLiftSet:
      config_.tip_lift_nm = 1e9 * in[0];
      return;
    case kSwitchOffDelaySet:
      if (!(in[0] >= 0)) return deny(pending, 7, "a delay is not negative");
      config_.switch_off_delay_s = in[0];
      return;
    case kLimitsEnabledSet:
      limits_on_ = in[0] != 0;
      return;
    case kLimitsSet:
      return set_limits(in[0], in[1], pending);
    case kSafeTipOnOffSet:
      if (in[0] == 1) safe_tip_on_ = true;
      if (in[0] == 2) safe_tip_on_ = false;
      return;
    case kSafeTipPropsSet:
      safe_tip_ = {in[0], in[1], in[2]};
      return;
    case kAcqPeriodSet:
      return set_acquisition(in[0], pending);
    case kSignalNamesGet:
      pending.answer.texts = signal_names();
      return;
    case kSignalValGet:
    case kSignalValsGet:
      return ask_signals(call, pending);
    case kSignalCalibrGet:
      return tell_calibration(in[0], pending);
    case kXyPosGet:
    case kSpeedGet:
    case kOnOffGet:
    case kZPosGet:
    case kStatusGet:
    case kSetpointGet:
    case kSafeTipOnOffGet:
    case kSafeTipPropsGet:
    case kSafeTipSignalGet:
    case kPiezoRangeGet:
    case kAcqPeriodGet:
    case kWithdrawRateGet:
    case kTipLiftGet:
    case kSwitchOffDelayGet:
    case kLimitsEnabledGet:
    case kLimitsGet:
      pending.answer.numbers = told(call.id);
      if (pending.answer.numbers.empty()) deny(pending, 2, "this simulation has no answer to that");
      return;
  }
}

SimController::Pending SimController::begin(const Call& call, int port, std::int64_t now_ns) {
  advance_to(now_ns);
  Pending pending;
  pending.call = call;
  pending.ready_ns = now_ns + ns(config_.latency_s * (1 + 2 * random_.uniform()));
  if (config_.restrict_roles && port >= 0 && !suits(call.id, port)) {
    deny(pending, 3, "this port does not take that command");
    return pending;
  }
  execute(call, now_ns, pending);
  return pending;
}

bool SimController::finish(Pending& pending, std::int64_t now_ns) {
  advance_to(now_ns);
  if (now_ns < pending.ready_ns) return false;
  if (pending.wait == Pending::Wait::kWithdrawn && piezo_nm_.z() < withdraw_to_nm() - 1e-3 &&
      now_ns < pending.deadline_ns)
    return false;
  if (pending.wait == Pending::Wait::kArrived && piezo_nm_.head<2>() != target_nm_.head<2>()) return false;
  if (pending.reads && pending.answer.error == 0) {
    pending.answer.numbers.clear();
    for (std::size_t i = 0; i + 1 < pending.call.numbers.size(); ++i)
      pending.answer.numbers.push_back(true_value(static_cast<int>(pending.call.numbers[i])));
  }
  return true;
}

}  // namespace telenano::afm_sim
