#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/master/device/call_watch.h"
#include "telenano/master/device/device_map.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/omega/sdk.h"
#include "telenano/master/device/omega/usb_nodes.h"

namespace telenano::device {

struct OmegaConfig {
  std::optional<unsigned> serial;  ///< which one, when several are attached; else the first
  /// The maker's frame: x towards the operator, y to the right, z up.
  AxisMap axes = AxisMap::parse({"+y", "-x", "+z"}, "default");
  Vec3 centre_d_m = Vec3::Zero();  ///< of the workspace, in the device's frame
  ButtonMap buttons{0, 1, 0};      ///< the handle's button is the deadman
  int watchdog_ms = 10;            ///< the device cuts its force after so much silence: 1 to 31; 0 = without
  bool home = false;               ///< may be moved by its motors to calibrate itself
  // The maker publishes a workspace of Ø160 × 110 mm and a resolution below 0.01 mm, but neither damping nor
  // mass. The limit on energy holds for a device with at least this damping: 0.1 N·s/m is pessimistic, so
  // that a device that nobody measured gives a weak touch and not a false promise; `telenano-master calibrate
  // --dynamics` measures one.
  double damping_n_s_m = 0.1;
  double mass_kg = 0.25;
  double workspace_half_m = 0.055;
  double position_quantum_m = 1e-5;
  std::optional<double> force_max_n;  ///< else what the SDK says, else 12 N
};

/// What such a device reports, as far as it is known before one is open.
DeviceInfo omega_device_info(const OmegaConfig& config);

/// A Force Dimension device through its SDK. The first command of force is zero and goes out before anything
/// else can ask for one; the watchdog of the SDK runs from the first tick on, so whatever stops the loop, a
/// stuck call of the SDK included, ends in zero force after its time.
///
/// What read() and write_force() cost is a call of the SDK each, two more every kStatusEveryTicks. Neither
/// allocates. The energy that is counted over a tick that was stuck longer than the watchdog's time is that of
/// the force commanded, which the device no longer showed: counted too much, by at most that force times the
/// way of the hand meanwhile.
class OmegaDevice final : public HapticDevice {
 public:
  static constexpr int kStatusEveryTicks = 10;

  /// Throws UserError (no SDK, a serial number that is not there, a mistake in the configuration) or RunError
  /// (no device, no rights, busy, failing): one line with what to do.
  explicit OmegaDevice(const OmegaConfig& config, const SdkSearch& search = SdkSearch::of_this_machine(),
                       const UsbRoots& usb = {});
  /// Zero force, brakes on, device closed.
  ~OmegaDevice() override;
  OmegaDevice(const OmegaDevice&) = delete;
  OmegaDevice& operator=(const OmegaDevice&) = delete;

  const DeviceInfo& info() const noexcept override { return info_; }
  /// A loop that paused for as long as the watchdog waits looks at the device's state in its next read.
  void advance(std::int64_t dt_ns) noexcept override {
    if (dt_ns >= std::int64_t{1'000'000} * config_.watchdog_ms) ticks_to_status_ = 0;
  }
  void read(DeviceReading& reading) noexcept override;
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override;

  /// For a monitor in another thread.
  const CallWatch& calls() const noexcept { return calls_; }
  /// For a person, when it was opened: name, serial number, SDK; then whatever should be known.
  const std::string& description() const noexcept { return description_; }
  const std::vector<std::string>& notes() const noexcept { return notes_; }

 private:
  void open(const UsbRoots& usb);
  void set_up();
  void look_at_status() noexcept;
  void fail(ForceOffCause cause) noexcept;
  std::string last_error() const;

  OmegaConfig config_;
  Sdk sdk_;
  DeviceInfo info_;
  std::string description_;
  std::vector<std::string> notes_;
  CallWatch calls_;
  char id_ = -1;
  int ticks_to_status_ = 0;
  bool watchdog_runs_ = false;
  DeviceStatus status_ = DeviceStatus::kOk;
  ForceOffCause cause_ = ForceOffCause::kNone;
  Vec3 hand_pos_h_m_ = Vec3::Zero();
  Vec3 applied_h_n_ = Vec3::Zero();
};

/// Every Force Dimension device that the SDK or the kernel shows. Opens and closes each; none is moved. Never
/// throws for what is wrong with one: that is its `why`.
std::vector<FoundDevice> find_omegas(const SdkSearch& search = SdkSearch::of_this_machine(),
                                     const UsbRoots& usb = {});

}  // namespace telenano::device
