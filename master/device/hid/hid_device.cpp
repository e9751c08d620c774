#include "telenano/master/device/hid/hid_device.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/master/device/pointer_device.h"

namespace telenano::device {
namespace {

constexpr double kHalfOfForce = 0.25;  // of the greatest of a hand with motors: against it half the speed

HidConfig checked(const HidConfig& config) {
  const auto require = [](bool good, const char* key, double value, const char* range) {
    if (!good)
      throw UserError("device." + std::string(key) + " = " + std::to_string(value) + ", expected " + range);
  };
  require(config.speed_m_s > 0 && config.speed_m_s <= config.motion.speed_max_m_s, "speed_m_s",
          config.speed_m_s, "more than 0, at most 0.25");
  require(config.hold_s >= 0.05 && config.hold_s <= 10, "hold_s", config.hold_s, "0.05 to 10");
  require(config.dead_zone >= 0 && config.dead_zone <= 0.5, "dead_zone", config.dead_zone, "0 to 0.5");
  require(config.full_scale >= 1 && config.full_scale <= 32767, "full_scale", config.full_scale,
          "1 to 32767");
  if (config.buttons.deadman == 0) {
    throw UserError(
        "device.deadman_buttons is empty: a SpaceMouse moves only while its deadman button is held");
  }
  return config;
}

}  // namespace

HidDevice::HidDevice(const rt::LatestValue<HidNews>& news, const HidConfig& config)
    : source_(news),
      config_(checked(config)),
      info_(forceless_device_info("hid", config.motion.half_m)),
      hand_(config.motion) {}

Vec3 HidDevice::wanted_velocity_h_m_s() const noexcept {
  Vec3 deflection_d;
  for (int axis = 0; axis < 3; ++axis) {
    const double part = news_.puck.axes[static_cast<std::size_t>(axis)] / config_.full_scale;
    // Nothing inside the dead zone, and no jump where it ends.
    const double beyond = std::max(0.0, std::fabs(part) - config_.dead_zone) / (1 - config_.dead_zone);
    deflection_d[axis] = std::copysign(std::min(beyond, 1.0), part);
  }
  const double norm = deflection_d.norm();
  if (norm > 1) deflection_d /= norm;
  return config_.speed_m_s * config_.axes.to_hand(deflection_d);
}

Vec3 HidDevice::resisted(const Vec3& velocity_h_m_s) const noexcept {
  const double force_n = force_h_n_.norm();
  if (!(force_n > 0)) return velocity_h_m_s;
  const Vec3 push = force_h_n_ / force_n;
  const double against_m_s = std::min(velocity_h_m_s.dot(push), 0.0);
  const double half_n = kHalfOfForce * info_.force_max_n;
  return velocity_h_m_s - push * (against_m_s * (force_n / (force_n + half_n)));
}

void HidDevice::advance(std::int64_t dt_ns) noexcept {
  if (dt_ns <= 0) return;
  HidNews newest;
  const bool looked = source_.try_load(newest);
  const bool motion = looked && newest.reports != news_.reports;
  silent_ns_ = motion ? 0 : silent_ns_ + dt_ns;
  if (looked) {
    if (begun_ && pressed_since(news_, newest, config_.buttons.stop)) stop_pressed_ = true;
    news_ = newest;
    begun_ = true;
  }
  const double dt_s = static_cast<double>(dt_ns) * 1e-9;
  const bool held = !news_.gone && (news_.puck.buttons & config_.buttons.deadman) != 0;
  const bool heard = static_cast<double>(silent_ns_) * 1e-9 <= config_.hold_s;
  if (!held) {
    const double reach_m = config_.speed_m_s * dt_s;
    const double away_m = target_h_m_.norm();
    target_h_m_ *= away_m > reach_m ? 1 - reach_m / away_m : 0;
  } else if (heard) {
    target_h_m_ = hand_.kept_inside(target_h_m_ + dt_s * resisted(wanted_velocity_h_m_s()));
  }
  hand_.follow(target_h_m_, dt_s);
}

void HidDevice::read(DeviceReading& reading) noexcept {
  reading = {};
  reading.hand_pos_h_m = hand_.pos_h_m();
  reading.buttons = config_.buttons.mapped(news_.puck.buttons);
  if (stop_pressed_) reading.buttons |= kButtonStop;
  stop_pressed_ = false;
  if (!news_.gone) return;
  reading.status = DeviceStatus::kFailed;
  reading.cause = ForceOffCause::kUnplugged;
  reading.buttons &= kButtonStop;
}

Vec3 HidDevice::write_force(const Vec3& hand_force_h_n) noexcept {
  force_h_n_ = is_finite(hand_force_h_n) ? hand_force_h_n : Vec3(Vec3::Zero());
  return Vec3::Zero();
}

}  // namespace telenano::device
