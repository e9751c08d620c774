#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "telenano/master/device/hand_motion.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/intended_motion.h"
#include "telenano/master/device/plant.h"
#include "telenano/master/device/played_motion.h"
#include "telenano/master/device/pointer_device.h"
#include "telenano/master/device/task_change.h"

namespace telenano::device {

struct SimDeviceConfig {
  PlantConfig plant{};
  Vec3 start_pos_h_m = Vec3::Zero();  ///< of the hand when the session starts
  double metres_per_nm = 1e-3;        ///< hand over tip: 1/(α_v·1e9)
  double start_height_nm = 40;  ///< of the tip above the surface there, the motion's z at the hand's start
  bool deadman_held = true;
};

/// What a SimDevice of this plant reports, known before there is one.
DeviceInfo sim_device_info(const PlantConfig& plant);

/// Simulated omega.3 with a simulated operator's hand. Its owner advances it once a tick, in virtual or real
/// time: read(), station step, write_force(), advance(). A tick of another length than the plant's period is
/// made of whole periods; the rest is carried to the next tick.
///
/// The operator may know several tasks and go from one to another (TaskChange): task 0 is the motion that it
/// is made with, further ones are added before the session.
class SimDevice final : public HapticDevice, public PlayedMotion {
 public:
  /// Throws UserError, e.g. if the motion leaves the device's workspace.
  SimDevice(const SimDeviceConfig& config, const IntendedMotion& motion);

  /// Further tasks, before the session; each returns its number. A motion that leaves the workspace is
  /// refused when it is asked for. A free one, of which there can be one: a pointer leads the operator's
  /// hand, which feels the force; `source` must outlive the device.
  int add_task(const IntendedMotion& motion);
  int add_free_task(const rt::LatestValue<PointerState>& source);
  /// How far from the hand's start each task takes the tip, nm, by axis: it fits into the device's box where
  /// this times metres_per_nm does.
  const Vec3& reach_nm(int task) const { return tasks_.at(static_cast<std::size_t>(task)).reach_nm; }

  const DeviceInfo& info() const noexcept override { return info_; }
  void read(DeviceReading& reading) noexcept override;
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override;

  /// Lets `dt_ns` of time pass with the force held. The intended motion moves only while started, and not
  /// while the tip is held (TipSeen). A tick that is far too late (50 ms) is taken for one period: the
  /// simulated hand and its operator stand still with the program that makes them.
  void advance(std::int64_t dt_ns) noexcept override;

  void start_motion() noexcept override { started_ = true; }
  bool motion_started() const noexcept override { return started_; }
  double motion_time_s() const noexcept override { return static_cast<double>(motion_ns_) * 1e-9; }
  double motion_duration_s() const noexcept override;
  bool begin_task(int task) noexcept override;
  TaskState task() const noexcept override {
    return {task_, change_.active(), motion_time_s(), motion_duration_s()};
  }
  void see_tip(const TipSeen& seen) noexcept override { change_.see(seen_ = seen); }
  void set_buttons(std::uint32_t buttons) noexcept { buttons_ = buttons; }

  const Plant& plant() const noexcept { return plant_; }  ///< the truth, for tests and studies
  Vec3 intended_hand_pos_h_m(double time_s) const noexcept;

 private:
  struct SimTask {
    IntendedMotion motion;
    Vec3 reach_nm = Vec3::Zero();
    bool free = false;
  };
  const SimTask& now() const noexcept { return tasks_[static_cast<std::size_t>(task_)]; }
  Vec3 next_intention_h_m() noexcept;  ///< a period later

  SimDeviceConfig config_;
  std::vector<SimTask> tasks_;
  int task_ = 0;
  TaskChange change_;
  TipSeen seen_{};
  std::optional<PointerDevice> free_hand_;
  Plant plant_;
  DeviceInfo info_;
  Vec3 applied_h_n_ = Vec3::Zero();
  std::uint32_t buttons_ = 0;
  bool started_ = false;
  std::int64_t period_ns_ = 0;
  std::int64_t carried_ns_ = 0;
  std::int64_t motion_ns_ = 0;
};

}  // namespace telenano::device
