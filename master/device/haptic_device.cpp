#include "telenano/master/device/haptic_device.h"

namespace telenano::device {

const char* force_off_text(ForceOffCause cause) noexcept {
  switch (cause) {
    case ForceOffCause::kNone:
      return "force is on";
    case ForceOffCause::kButton:
      return "force switched off at the device's button: press it again";
    case ForceOffCause::kVelocity:
      return "the device was moved too fast and cut its force: let go, then press its force button";
    case ForceOffCause::kWatchdog:
      return "the device heard nothing within its watchdog's time and cut its force: press its force button; "
             "if it comes back, run deploy/rt_check.sh";
    case ForceOffCause::kSoftware:
      return "force switched off by software: end other programs that use the device, press its force button";
    case ForceOffCause::kUsb:
      return "the device lost its USB connection and cut its force: check the cable, press its force button";
    case ForceOffCause::kDeadman:
      return "the device's own deadman switch is open: hold the handle";
    case ForceOffCause::kUnknown:
      return "the device shows no force and does not say why: press its force button";
    case ForceOffCause::kNoPower:
      return "the device has no power: check its supply";
    case ForceOffCause::kUnplugged:
      return "the device is unplugged or does not answer: check the cable, start again";
    case ForceOffCause::kDeviceError:
      return "the device reports an error: switch it off and on, start again";
  }
  return "unknown";
}

}  // namespace telenano::device
