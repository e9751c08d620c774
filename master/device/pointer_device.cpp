#include "telenano/master/device/pointer_device.h"

#include "telenano/master/device/plant.h"
#include "telenano/master/device/sim_device.h"

namespace telenano::device {

DeviceInfo forceless_device_info(const char* name, double half_m) {
  DeviceInfo info = sim_device_info(PlantConfig{});
  info.name = name;
  info.position_quantum_m = 0;
  info.workspace_radius_m = half_m;
  info.has_force = false;
  return info;
}

PointerDevice::PointerDevice(const rt::LatestValue<PointerState>& source, const PointerConfig& config)
    : source_(source),
      config_(config),
      info_(forceless_device_info("mouse", config.motion.half_m)),
      hand_(config.motion) {}

void PointerDevice::start_anew() noexcept {
  hand_.stand_at(Vec3::Zero());
  target_h_m_ = Vec3::Zero();
  buttons_ = 0;
}

void PointerDevice::advance(std::int64_t dt_ns) noexcept {
  if (dt_ns <= 0) return;
  const std::uint64_t count = source_.count();
  PointerState newest;
  if (count != seen_ && source_.try_load(newest)) {
    seen_ = count;
    silent_ns_ = 0;
    const Vec3 target_h_m(newest.hand_pos_h_m[0], newest.hand_pos_h_m[1], newest.hand_pos_h_m[2]);
    if (is_finite(target_h_m)) target_h_m_ = target_h_m;
    buttons_ = newest.buttons;
  } else {
    silent_ns_ += dt_ns;
    const bool silent = static_cast<double>(silent_ns_) * 1e-9 > config_.silence_s;
    if (silent && (buttons_ & kButtonDeadman) != 0) {
      buttons_ &= ~static_cast<std::uint32_t>(kButtonDeadman);
      // The tip stands: a way that the hand went meanwhile would be lost to it.
      target_h_m_ = hand_.pos_h_m();
    }
  }
  hand_.follow(target_h_m_, static_cast<double>(dt_ns) * 1e-9);
}

void PointerDevice::read(DeviceReading& reading) noexcept {
  reading = {};
  reading.hand_pos_h_m = hand_.pos_h_m();
  reading.buttons = buttons_;
}

Vec3 PointerDevice::write_force(const Vec3&) noexcept {
  return Vec3::Zero();
}

}  // namespace telenano::device
