#pragma once

#include <cstdint>
#include <memory>

#include "telenano/master/device/device_map.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/hid/hid_reader.h"

namespace telenano::device {

/// A device with foot pedals besides: their buttons count like the device's own. A pedal that was pressed and
/// released between two ticks counts as a stop if that is its meaning; pedals that have gone are a stop,
/// since whoever relied on them has lost one.
class PedalledDevice final : public HapticDevice {
 public:
  /// `pedals` must outlive this.
  PedalledDevice(std::unique_ptr<HapticDevice> device, const rt::LatestValue<HidNews>& pedals,
                 const ButtonMap& map);

  const DeviceInfo& info() const noexcept override { return device_->info(); }
  void advance(std::int64_t dt_ns) noexcept override { device_->advance(dt_ns); }
  void read(DeviceReading& reading) noexcept override;
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override {
    return device_->write_force(hand_force_h_n);
  }

 private:
  std::unique_ptr<HapticDevice> device_;
  const rt::LatestValue<HidNews>& source_;
  ButtonMap map_;
  HidNews news_{};
  bool begun_ = false;  // presses before the first look are none of ours
};

}  // namespace telenano::device
