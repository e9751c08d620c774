#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/calibration/axis_dynamics.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::calibration {

/// When a call into the device acted: between its begin and its end, nobody knows where.
struct CallTime {
  double begin_s = 0;
  double end_s = 0;

  static CallTime at(double time_s) { return {time_s, time_s}; }
  double middle_s() const { return 0.5 * (begin_s + end_s); }
  double took_s() const { return end_s - begin_s; }
};

struct MeasurementConfig {
  double rate_hz = 1000;         ///< of the ticks
  double seconds_per_axis = 20;  ///< 10 to 300
  double force_max_n = 1.5;      ///< most on an axis at any time; 0.2 to 2
  double reach_max_m = 0.035;    ///< further from its start, no force at once
  double speed_max_m_s = 0.6;    ///< faster on an axis, no force at once
};

enum class MeasurementEnd : std::uint8_t {
  kRunning,
  kDone,
  kMoves,    ///< it did not rest before anything was commanded
  kTooFar,   ///< beyond reach_max_m
  kTooFast,  ///< beyond speed_max_m_s
  kDevice,   ///< the device shows no force, or failed; its reading says why
  kStopped,  ///< stop() was called
};
/// One phrase for a person; empty while running and when done.
const char* end_text(MeasurementEnd end) noexcept;

/// Moves a device's handle about the place where it rests by small known forces, one axis after the other,
/// and keeps what it did. A tick: read the device, force(), write it, applied(), each with its time.
///
/// Force     k (x₀ − x) − d ẋ + Σ a_i sin(2π f_i t + φ_i) on the axis under measurement, the first two alone
///           on the others; k = 60 N/m, d = 4 N·s/m, a_i 0.2 N at seven frequencies of 0.7 to 8 Hz that have
///           no common one (phases by Schroeder's rule, IEEE Trans. Inf. Theory 16, 1970: a low peak),
///           clipped to force_max_n. The spring and the damper are part of the known force: they take nothing
///           from the truth, keep a handle without friction from running away, and hold it against what
///           gravity compensation leaves.
/// Safety    zero force for half a second first, ramps of half a second; beyond its reach or its speed, with
///           a device that is not well, and after the end: zero, for good.
/// Nothing is allocated after the construction.
class DynamicsMeasurement {
 public:
  /// Throws UserError naming the value and its range.
  explicit DynamicsMeasurement(const MeasurementConfig& config);

  /// The force to command now. `when` is that of the reading; times grow from call to call, from any start.
  Vec3 force(const CallTime& when, const device::DeviceReading& reading) noexcept;
  /// What the device really shows of it, and when it was commanded: not before its reading.
  void applied(const CallTime& when, const Vec3& force_h_n) noexcept;
  void stop() noexcept;

  MeasurementEnd end() const noexcept { return end_; }
  double done() const noexcept;                ///< 0 to 1
  int axis() const noexcept { return axis_; }  ///< under measurement: 0 x, 1 y, 2 z
  /// Of an axis; empty before its turn.
  std::span<const DynamicsSample> track(int axis) const { return tracks_.at(static_cast<std::size_t>(axis)); }

 private:
  void finish(MeasurementEnd end) noexcept;
  void see(double time_s, const Vec3& pos_h_m) noexcept;
  bool is_safe(const Vec3& pos_h_m) noexcept;

  MeasurementConfig config_;
  std::array<std::vector<DynamicsSample>, 3> tracks_;
  MeasurementEnd end_ = MeasurementEnd::kRunning;
  bool began_ = false;
  double began_s_ = 0;
  double elapsed_s_ = 0;
  int axis_ = 0;
  bool keeps_ = false;  ///< the last tick belongs to the track
  Vec3 centre_m_ = Vec3::Zero();
  Vec3 rest_low_m_ = Vec3::Zero();
  Vec3 rest_high_m_ = Vec3::Zero();
  // For the velocity: positions of the last ticks, as a ring.
  static constexpr std::size_t kRing = 16;
  std::array<Vec3, kRing> seen_m_{};
  std::array<double, kRing> seen_s_{};
  std::size_t seen_ = 0;
  Vec3 velocity_m_s_ = Vec3::Zero();
};

}  // namespace telenano::calibration
