#pragma once

#include <cstdint>

#include "telenano/master/device/haptic_device.h"

namespace telenano::support {

/// A haptic device with whoever holds it, in virtual time: what a test puts in the place of the simulated
/// omega.3 and its operator. Its owner advances it once a tick: read(), station step, write_force(),
/// advance().
class VirtualHand : public device::HapticDevice {
 public:
  /// Lets `dt_ns` of time pass with the last force held.
  virtual void advance(std::int64_t dt_ns) noexcept = 0;
  /// The session is up and engaged; before that the hand holds still.
  virtual void start_motion() noexcept = 0;
};

}  // namespace telenano::support
