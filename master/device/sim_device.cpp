#include "telenano/master/device/sim_device.h"

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "telenano/common/base/error.h"

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
                      " m; raise scaling.velocity (run --velocity-scale), start nearer to the surface or "
                      "shorten the motion");
    }
  }
  return whole;
}

Vec3 reach_of(const IntendedMotion& motion, double start_height_nm) {
  Vec3 reach_nm = Vec3::Zero();
  for (const auto& point : motion.waypoints())
    reach_nm = reach_nm.cwiseMax((point.pos_nm - Vec3(0, 0, start_height_nm)).cwiseAbs());
  return reach_nm;
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
      change_(config.start_pos_h_m, config.start_height_nm, config.plant.workspace_half_m),
      plant_(config.plant),
      info_(sim_device_info(config.plant)) {
  IntendedMotion first = checked(config, motion);
  const Vec3 reach_nm = reach_of(first, config.start_height_nm);
  tasks_.push_back({std::move(first), reach_nm});
  plant_.reset(config.start_pos_h_m);
  if (config.deadman_held) buttons_ |= kButtonDeadman;
  period_ns_ = static_cast<std::int64_t>(std::llround(config.plant.period_s * 1e9));
}

int SimDevice::add_task(const IntendedMotion& motion) {
  IntendedMotion whole = motion.beginning_at(Vec3(0, 0, config_.start_height_nm), kApproachS);
  const Vec3 reach_nm = reach_of(whole, config_.start_height_nm);
  tasks_.push_back({std::move(whole), reach_nm});
  return static_cast<int>(tasks_.size()) - 1;
}

int SimDevice::add_free_task(const rt::LatestValue<PointerState>& source) {
  PointerConfig pointer;
  pointer.motion.half_m = info_.workspace_radius_m;
  free_hand_.emplace(source, pointer);
  tasks_.push_back({IntendedMotion({{0, Vec3(0, 0, config_.start_height_nm)}}), Vec3::Zero(), true});
  return static_cast<int>(tasks_.size()) - 1;
}

bool SimDevice::begin_task(int task) noexcept {
  if (!started_ || task < 0 || task >= static_cast<int>(tasks_.size())) return false;
  const Vec3 reach_m = seen_.metres_per_nm * tasks_[static_cast<std::size_t>(task)].reach_nm;
  if ((reach_m.array() > config_.plant.workspace_half_m.array()).any()) return false;
  change_.begin(change_.active()           ? change_.intended_pos_h_m()
                : now().free && free_hand_ ? plant_.pos_m()
                                           : intended_hand_pos_h_m(motion_time_s()));
  task_ = task;
  motion_ns_ = 0;
  return true;
}

double SimDevice::motion_duration_s() const noexcept {
  return now().free ? std::numeric_limits<double>::infinity() : now().motion.duration_s();
}

void SimDevice::read(DeviceReading& reading) noexcept {
  reading.status = DeviceStatus::kOk;
  reading.hand_pos_h_m = plant_.encoder_pos_m();
  reading.buttons = buttons_;
  if (change_.active()) {
    if (change_.clutch()) reading.buttons |= kButtonClutch;
  } else if (now().free) {
    DeviceReading pointer;
    free_hand_->read(pointer);
    reading.buttons = pointer.buttons;
  }
}

Vec3 SimDevice::write_force(const Vec3& hand_force_h_n) noexcept {
  applied_h_n_ = plant_.applied_force_n(hand_force_h_n);
  return applied_h_n_;
}

Vec3 SimDevice::intended_hand_pos_h_m(double time_s) const noexcept {
  return config_.start_pos_h_m +
         config_.metres_per_nm * (now().motion.pos_nm(time_s) - Vec3(0, 0, config_.start_height_nm));
}

Vec3 SimDevice::next_intention_h_m() noexcept {
  const double period_s = static_cast<double>(period_ns_) * 1e-9;
  if (change_.active()) {
    change_.advance(period_s);
    if (change_.active()) return change_.intended_pos_h_m();
    config_.metres_per_nm = seen_.metres_per_nm;
    if (free_hand_) free_hand_->start_anew();
  } else if (started_ && !seen_.held) {
    // Nobody goes on while the tip stands still: it would be as far from the sample afterwards as the hand
    // went meanwhile.
    motion_ns_ += period_ns_;
  }
  if (!now().free) return intended_hand_pos_h_m(motion_time_s());
  free_hand_->advance(period_ns_);
  DeviceReading pointer;
  free_hand_->read(pointer);
  return config_.start_pos_h_m + pointer.hand_pos_h_m;
}

void SimDevice::advance(std::int64_t dt_ns) noexcept {
  carried_ns_ += dt_ns > kLongestTickNs ? period_ns_ : dt_ns;
  for (; carried_ns_ >= period_ns_; carried_ns_ -= period_ns_) {
    const Vec3 intention_h_m = next_intention_h_m();
    plant_.advance(applied_h_n_, intention_h_m);
  }
}

}  // namespace telenano::device
