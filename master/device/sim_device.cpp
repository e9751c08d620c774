#include "master/device/sim_device.h"

#include <cmath>
#include <string>

#include "common/base/error.h"

namespace telenano::device {
namespace {

constexpr double kApproachS = 2;  // from the hand's start to a script's first waypoint

IntendedMotion checked(const SimDeviceConfig& config, const IntendedMotion& motion) {
  config.plant.validate();
  if (!(config.metres_per_nm > 0) || !std::isfinite(config.metres_per_nm)) {
    throw UserError("simulated device: metres_per_nm = " + std::to_string(config.metres_per_nm) +
                    ", expected > 0");
  }
  IntendedMotion whole = motion.beginning_at(Vec3(0, 0, config.start_height_nm), kApproachS);
  for (const auto& point : whole.waypoints()) {
    const Vec3 hand_h_m =
        config.start_pos_h_m + config.metres_per_nm * (point.pos_nm - Vec3(0, 0, config.start_height_nm));
    for (int axis = 0; axis < 3; ++axis) {
      const double half_m = config.plant.workspace_half_m[axis];
      if (std::fabs(hand_h_m[axis]) <= half_m) continue;
      throw UserError("motion: at " + std::to_string(point.time_s) + " s the hand would be at " +
                      "xyz"[axis] + " = " + std::to_string(hand_h_m[axis]) + " m, outside the device's +-" +
                      std::to_string(half_m) +
                      " m; raise scaling.velocity, start nearer to the surface or shorten the motion");
    }
  }
  return whole;
}

}  // namespace

DeviceInfo sim_device_info(const PlantConfig& plant) {
  DeviceInfo info;
  info.name = "sim";
  info.force_max_n = plant.force_max_n;
  info.position_quantum_m = plant.position_quantum_m;
  info.damping_n_s_m = plant.device_damping_n_s_m;
  info.mass_kg = plant.device_mass_kg;
  info.workspace_radius_m = plant.workspace_half_m.minCoeff();
  return info;
}

SimDevice::SimDevice(const SimDeviceConfig& config, const IntendedMotion& motion)
    : config_(config),
      motion_(checked(config, motion)),
      plant_(config.plant),
      info_(sim_device_info(config.plant)) {
  plant_.reset(config.start_pos_h_m);
  if (config.deadman_held) buttons_ |= kButtonDeadman;
  period_ns_ = static_cast<std::int64_t>(std::llround(config.plant.period_s * 1e9));
}

void SimDevice::read(DeviceReading& reading) noexcept {
  reading.status = DeviceStatus::kOk;
  reading.hand_pos_h_m = plant_.encoder_pos_m();
  reading.buttons = buttons_;
}

Vec3 SimDevice::write_force(const Vec3& hand_force_h_n) noexcept {
  applied_h_n_ = plant_.applied_force_n(hand_force_h_n);
  return applied_h_n_;
}

Vec3 SimDevice::intended_hand_pos_h_m(double time_s) const noexcept {
  return config_.start_pos_h_m +
         config_.metres_per_nm * (motion_.pos_nm(time_s) - Vec3(0, 0, config_.start_height_nm));
}

void SimDevice::advance(std::int64_t dt_ns) noexcept {
  carried_ns_ += dt_ns;
  for (; carried_ns_ >= period_ns_; carried_ns_ -= period_ns_) {
    if (started_) motion_ns_ += period_ns_;
    plant_.advance(applied_h_n_, intended_hand_pos_h_m(motion_time_s()));
  }
}

}  // namespace telenano::device
