#include "telenano/master/calibration/dynamics_measurement.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::calibration {
namespace {

constexpr double kRest_s = 0.5;
constexpr double kRamp_s = 0.5;
constexpr double kMayCreep_m = 0.002;  // while it rests
constexpr double kSpring_n_m = 60;
constexpr double kDamper_n_s_m = 4;
constexpr double kSine_n = 0.2;
constexpr std::array<double, 7> kFrequencies_hz = {0.71, 1.13, 1.69, 2.51, 3.67, 5.39, 7.93};
constexpr double kVelocityReach_s = 0.008;
constexpr double kMostRate_hz = 1.3;  // of the ticks told, room for

void require(bool good, const char* what, double value, const char* range) {
  if (!good) throw UserError(std::string(what) + " = " + std::to_string(value) + ", expected " + range);
}

double excitation(double time_s) noexcept {
  double sum = 0;
  constexpr auto kCount = static_cast<double>(kFrequencies_hz.size());
  for (std::size_t i = 0; i < kFrequencies_hz.size(); ++i) {
    const auto n = static_cast<double>(i);
    const double phase = -std::numbers::pi * n * (n + 1) / kCount;
    sum += kSine_n * std::sin(2 * std::numbers::pi * kFrequencies_hz[i] * time_s + phase);
  }
  return sum;
}

}  // namespace

const char* end_text(MeasurementEnd end) noexcept {
  switch (end) {
    case MeasurementEnd::kRunning:
    case MeasurementEnd::kDone:
      return "";
    case MeasurementEnd::kMoves:
      return "the handle moves before any force: put it down, let go, start again";
    case MeasurementEnd::kTooFar:
      return "the handle moved too far from its rest position: keep hands off, and check that nothing pulls "
             "at it";
    case MeasurementEnd::kTooFast:
      return "the handle moved too fast: keep hands off";
    case MeasurementEnd::kDevice:
      return "the device shows no force";
    case MeasurementEnd::kStopped:
      return "stopped";
  }
  return "";
}

DynamicsMeasurement::DynamicsMeasurement(const MeasurementConfig& config) : config_(config) {
  const auto between = [](double value, double low, double high) { return value >= low && value <= high; };
  require(between(config.rate_hz, 500, 8000), "rate of the measurement", config.rate_hz, "500 to 8000 Hz");
  require(between(config.seconds_per_axis, 10, 300), "seconds for each axis", config.seconds_per_axis,
          "10 to 300");
  require(between(config.force_max_n, 0.2, 2), "largest force", config.force_max_n, "0.2 to 2 N");
  const auto room = static_cast<std::size_t>(kMostRate_hz * config.rate_hz * (config.seconds_per_axis + 1));
  for (auto& track : tracks_) track.reserve(room);
}

void DynamicsMeasurement::finish(MeasurementEnd end) noexcept {
  if (end_ == MeasurementEnd::kRunning) end_ = end;
  keeps_ = false;
}

void DynamicsMeasurement::stop() noexcept {
  finish(MeasurementEnd::kStopped);
}

double DynamicsMeasurement::done() const noexcept {
  const double all_s = kRest_s + 3 * (config_.seconds_per_axis + 2 * kRamp_s);
  return end_ == MeasurementEnd::kDone ? 1 : std::min(1.0, elapsed_s_ / all_s);
}

void DynamicsMeasurement::see(double time_s, const Vec3& pos_h_m) noexcept {
  // The oldest within reach; the ring is as long as that at 2 kHz and shorter above.
  velocity_m_s_.setZero();
  for (std::size_t back = std::min(seen_, kRing); back > 0; --back) {
    const std::size_t at = (seen_ - back) % kRing;
    const double dt = time_s - seen_s_[at];
    if (dt > kVelocityReach_s && back > 1) continue;
    if (dt > 0) velocity_m_s_ = (pos_h_m - seen_m_[at]) / dt;
    break;
  }
  seen_m_[seen_ % kRing] = pos_h_m;
  seen_s_[seen_ % kRing] = time_s;
  ++seen_;
}

bool DynamicsMeasurement::is_safe(const Vec3& pos_h_m) noexcept {
  if (!is_finite(pos_h_m) || (pos_h_m - centre_m_).cwiseAbs().maxCoeff() > config_.reach_max_m) {
    finish(MeasurementEnd::kTooFar);
  } else if (velocity_m_s_.cwiseAbs().maxCoeff() > config_.speed_max_m_s) {
    finish(MeasurementEnd::kTooFast);
  }
  return end_ == MeasurementEnd::kRunning;
}

Vec3 DynamicsMeasurement::force(const CallTime& when, const device::DeviceReading& reading) noexcept {
  const double time_s = when.middle_s();
  keeps_ = false;
  if (end_ != MeasurementEnd::kRunning) return Vec3::Zero();
  if (reading.status != device::DeviceStatus::kOk) {
    finish(MeasurementEnd::kDevice);
    return Vec3::Zero();
  }
  const Vec3& pos_h_m = reading.hand_pos_h_m;
  if (!began_) {
    began_ = true;
    began_s_ = time_s;
    rest_low_m_ = rest_high_m_ = pos_h_m;
  }
  elapsed_s_ = time_s - began_s_;
  see(time_s, pos_h_m);
  if (elapsed_s_ < kRest_s) {
    rest_low_m_ = rest_low_m_.cwiseMin(pos_h_m);
    rest_high_m_ = rest_high_m_.cwiseMax(pos_h_m);
    centre_m_ = pos_h_m;
    if (!is_finite(pos_h_m) || (rest_high_m_ - rest_low_m_).maxCoeff() > kMayCreep_m)
      finish(MeasurementEnd::kMoves);
    return Vec3::Zero();
  }
  if (!is_safe(pos_h_m)) return Vec3::Zero();
  const double turn_s = config_.seconds_per_axis + 2 * kRamp_s;
  const double at_s = elapsed_s_ - kRest_s;
  axis_ = static_cast<int>(at_s / turn_s);
  if (axis_ > 2) {
    axis_ = 2;
    finish(MeasurementEnd::kDone);
    return Vec3::Zero();
  }
  const double in_turn_s = at_s - axis_ * turn_s;
  const double ramp = std::clamp(std::min(in_turn_s, turn_s - in_turn_s) / kRamp_s, 0.0, 1.0);
  // What holds it comes with the first ramp and stays.
  const double hold = std::min(1.0, at_s / kRamp_s);
  Vec3 force_h_n = hold * (kSpring_n_m * (centre_m_ - pos_h_m) - kDamper_n_s_m * velocity_m_s_);
  force_h_n[axis_] += ramp * excitation(in_turn_s);
  auto& track = tracks_[static_cast<std::size_t>(axis_)];
  keeps_ = ramp >= 1 && track.size() < track.capacity();
  if (keeps_) track.push_back({time_s, pos_h_m[axis_], time_s, 0, when.took_s(), 0});
  return force_h_n.cwiseMax(-config_.force_max_n).cwiseMin(config_.force_max_n);
}

void DynamicsMeasurement::applied(const CallTime& when, const Vec3& force_h_n) noexcept {
  if (!keeps_) return;
  DynamicsSample& sample = tracks_[static_cast<std::size_t>(axis_)].back();
  sample.force_time_s = when.middle_s();
  sample.force_n = force_h_n[axis_];
  sample.command_took_s = when.took_s();
}

}  // namespace telenano::calibration
