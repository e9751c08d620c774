#include "telenano/master/device/hid/pedalled_device.h"

#include <utility>

namespace telenano::device {

PedalledDevice::PedalledDevice(std::unique_ptr<HapticDevice> device, const rt::LatestValue<HidNews>& pedals,
                               const ButtonMap& map)
    : device_(std::move(device)), source_(pedals), map_(map) {}

void PedalledDevice::read(DeviceReading& reading) noexcept {
  device_->read(reading);
  const HidNews last = news_;
  if (source_.try_load(news_)) {
    if (begun_ && pressed_since(last, news_, map_.stop)) reading.buttons |= kButtonStop;
    begun_ = true;
  }
  reading.buttons |= news_.gone ? kButtonStop : map_.mapped(news_.puck.buttons);
}

}  // namespace telenano::device
