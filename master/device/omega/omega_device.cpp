#include "telenano/master/device/omega/omega_device.h"

#include <algorithm>
#include <utility>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

constexpr const char* kVendor = "1451";
constexpr double kPublishedForceN = 12;  // omega.3
constexpr int kWatchdogUnitUs = 125;
constexpr int kWatchdogMsMax = 255 * kWatchdogUnitUs / 1000;
constexpr int kMotorSaturated = 2;

// Indices of dhdGetStatus.
constexpr std::size_t kPower = 0;
constexpr std::size_t kConnected = 1;
constexpr std::size_t kCalibrated = 3;
constexpr std::size_t kForce = 5;
constexpr std::size_t kError = 9;
constexpr std::size_t kForceOffCauseIndex = 14;

ForceOffCause cause_of(int code) noexcept {
  constexpr int kLast = static_cast<int>(ForceOffCause::kDeadman);
  return code >= 1 && code <= kLast ? static_cast<ForceOffCause>(code) : ForceOffCause::kUnknown;
}

/// Why a device that the kernel shows cannot be opened.
std::string why_not(const UsbNode& node, const std::string& sdk_says) {
  if (!node.may_open) {
    return "no permission to open " + node.node +
           ": copy deploy/udev/70-telenano-haptic.rules to /etc/udev/rules.d, run udevadm control --reload, "
           "plug the "
           "device in again";
  }
  if (!node.held_by.empty()) return "busy: " + node.held_by + " has " + node.node + " open; end it first";
  return "the SDK cannot open " + node.node + " (it says: " + sdk_says +
         "); end other programs that use it, switch the device off and on";
}

std::string none_attached() {
  return "no Force Dimension device found (USB vendor 1451): plug it in and switch its power on";
}

/// Opened for as long as this lives.
class OpenDevice {
 public:
  OpenDevice(const Sdk& sdk, int index) : sdk_(sdk) {
    // An id is an index below 127: the SDK takes it as char.
    const char wanted = static_cast<char>(index);
    id_ = sdk.has_drd() ? sdk.drdOpenID(wanted) : sdk.dhdOpenID(wanted);
  }
  ~OpenDevice() {
    if (id_ < 0) return;
    const char id = static_cast<char>(id_);
    if (sdk_.has_drd()) {
      sdk_.drdClose(id);
    } else {
      sdk_.dhdClose(id);
    }
  }
  OpenDevice(const OpenDevice&) = delete;
  OpenDevice& operator=(const OpenDevice&) = delete;

  bool good() const noexcept { return id_ >= 0; }
  char id() const noexcept { return static_cast<char>(id_); }
  char keep() noexcept { return static_cast<char>(std::exchange(id_, -1)); }
  std::string name() const {
    const char* const name = sdk_.dhdGetSystemName(id());
    return name != nullptr && *name != '\0' ? name : "type " + std::to_string(sdk_.dhdGetSystemType(id()));
  }
  std::optional<unsigned> serial() const {
    unsigned short serial = 0;
    if (sdk_.dhdGetSerialNumber(&serial, id()) < 0) return std::nullopt;
    return serial;
  }

 private:
  const Sdk& sdk_;
  int id_ = -1;
};

std::string sdk_error(const Sdk& sdk) {
  const char* const text = sdk.dhdErrorGetLastStr();
  return text != nullptr && *text != '\0' ? text : "no reason given";
}

}  // namespace

DeviceInfo omega_device_info(const OmegaConfig& config) {
  DeviceInfo info;
  info.name = "omega";
  info.force_max_n = config.force_max_n.value_or(kPublishedForceN);
  info.position_quantum_m = config.position_quantum_m;
  info.damping_n_s_m = config.damping_n_s_m;
  info.mass_kg = config.mass_kg;
  info.workspace_radius_m = config.workspace_half_m;
  info.moves_by_itself = true;
  return info;
}

OmegaDevice::OmegaDevice(const OmegaConfig& config, const SdkSearch& search, const UsbRoots& usb)
    : config_(config) {
  if (config.watchdog_ms < 0 || config.watchdog_ms > kWatchdogMsMax) {
    throw UserError("device.watchdog_ms = " + std::to_string(config.watchdog_ms) + ", expected 0 to " +
                    std::to_string(kWatchdogMsMax));
  }
  sdk_ = load_sdk(search);
  open(usb);
  try {
    set_up();
  } catch (...) {
    sdk_.dhdStop(id_);
    sdk_.dhdClose(id_);
    throw;
  }
}

OmegaDevice::~OmegaDevice() {
  sdk_.dhdSetForce(0, 0, 0, id_);
  sdk_.dhdStop(id_);
  if (sdk_.has_drd()) {
    sdk_.drdClose(id_);
  } else {
    sdk_.dhdClose(id_);
  }
}

std::string OmegaDevice::last_error() const {
  return sdk_error(sdk_);
}

void OmegaDevice::open(const UsbRoots& usb) {
  const int count = sdk_.dhdGetDeviceCount();
  const std::vector<UsbNode> nodes = usb_nodes(kVendor, usb);
  if (count <= 0) {
    throw RunError("omega: " + (nodes.empty() ? none_attached() : why_not(nodes.front(), last_error())));
  }
  std::string others;
  std::string why;
  for (int index = 0; index < count; ++index) {
    OpenDevice device(sdk_, index);
    if (!device.good()) {
      const std::string says = last_error();
      // Which node belongs to which index is the SDK's secret: the one that cannot be opened is the likely
      // one.
      const auto closed = std::find_if(nodes.begin(), nodes.end(),
                                       [](const UsbNode& n) { return !n.may_open || !n.held_by.empty(); });
      why = closed != nodes.end() ? why_not(*closed, says)
            : !nodes.empty()      ? why_not(nodes.front(), says)
                             : "the SDK cannot open device " + std::to_string(index) + " (it says: " + says +
                                   "); end other programs that use it, check the rights on its USB node";
      continue;
    }
    const auto serial = device.serial();
    const std::string serial_text = serial ? std::to_string(*serial) : "unknown";
    if (config_.serial && serial != config_.serial) {
      others += (others.empty() ? "" : ", ") + serial_text;
      continue;
    }
    description_ =
        device.name() + ", serial number " + serial_text + ", SDK " + sdk_.version + " at " + sdk_.path;
    info_.name = device.name();
    id_ = device.keep();
    return;
  }
  if (config_.serial && !others.empty()) {
    throw UserError("omega: no device with serial number " + std::to_string(*config_.serial) +
                    " (device.serial); attached: " + others);
  }
  throw RunError("omega: " + why);
}

void OmegaDevice::set_up() {
  if (sdk_.dhdSetForce(0, 0, 0, id_) < 0)
    throw RunError("omega: zero force was refused (" + last_error() + "); switch the device off and on");
  int status[17] = {};
  if (sdk_.dhdGetStatus(status, id_) < 0)
    throw RunError("omega: the device does not tell its state (" + last_error() + "); switch it off and on");
  if (status[kPower] == 0) throw RunError(std::string("omega: ") + force_off_text(ForceOffCause::kNoPower));
  if (status[kError] != 0)
    throw RunError(std::string("omega: ") + force_off_text(ForceOffCause::kDeviceError));

  const bool calibrated = status[kCalibrated] != 0 && (!sdk_.has_drd() || sdk_.drdIsInitialized(id_));
  if (!calibrated && config_.home) {
    if (!sdk_.has_drd())
      throw UserError("omega: " + sdk_.path +
                      " cannot home a device; calibrate it by hand, or give the SDK's libdrd");
    if (sdk_.drdAutoInit(id_) < 0)
      throw RunError("omega: homing failed (" + last_error() + "); nothing may be in the device's way");
    if (sdk_.drdStop(true, id_) < 0)
      throw RunError("omega: homing does not end (" + last_error() + "); switch the device off and on");
  } else if (!calibrated) {
    notes_.push_back(
        "the device is not calibrated: force stays off until it is; move its handle by hand to its "
        "calibration point, or "
        "let its motors do it with --home (keep hands and things out of its way)");
  }

  if (config_.watchdog_ms > 0) {
    // Armed for good by the first tick: until then nobody would feed it.
    const auto units = static_cast<unsigned char>(config_.watchdog_ms * 1000 / kWatchdogUnitUs);
    if (sdk_.dhdSetWatchdog(units, id_) < 0 || sdk_.dhdSetWatchdog(0, id_) < 0) {
      throw RunError(
          "omega: the watchdog of this device cannot be armed (" + last_error() +
          "); device.watchdog_ms = 0 runs without: then a program that hangs leaves its last force on");
    }
  } else {
    notes_.emplace_back("device.watchdog_ms = 0: a program that hangs leaves its last force on");
  }
  if (sdk_.dhdSetGravityCompensation(1, id_) < 0)
    notes_.push_back("gravity compensation is not available (" + last_error() + ")");
  if (sdk_.dhdEnableForce(1, id_) < 0)
    notes_.push_back("force cannot be switched on (" + last_error() + "): press the device's force button");

  const std::string name = info_.name;
  info_ = omega_device_info(config_);
  info_.name = name;
  const double sdk_max_n = sdk_.dhdGetMaxForce(id_);
  if (!config_.force_max_n && sdk_max_n > 0) info_.force_max_n = sdk_max_n;
}

void OmegaDevice::fail(ForceOffCause cause) noexcept {
  status_ = DeviceStatus::kFailed;
  cause_ = cause;
}

void OmegaDevice::look_at_status() noexcept {
  int status[17] = {};
  calls_.enter("dhdGetStatus");
  const int code = sdk_.dhdGetStatus(status, id_);
  calls_.leave();
  if (code < 0 || status[kConnected] == 0) return fail(ForceOffCause::kUnplugged);
  if (status[kPower] == 0) return fail(ForceOffCause::kNoPower);
  if (status[kError] != 0) return fail(ForceOffCause::kDeviceError);
  status_ = DeviceStatus::kOk;
  cause_ = ForceOffCause::kNone;
  if (status[kForce] == 0) {
    status_ = DeviceStatus::kForceOff;
    cause_ = cause_of(status[kForceOffCauseIndex]);
  }
  if (status[kCalibrated] == 0) status_ = DeviceStatus::kHoming;
}

void OmegaDevice::read(DeviceReading& reading) noexcept {
  reading = {};
  if (status_ != DeviceStatus::kFailed && --ticks_to_status_ < 0) {
    ticks_to_status_ = kStatusEveryTicks - 1;
    look_at_status();
  }
  double x_m = 0;
  double y_m = 0;
  double z_m = 0;
  calls_.enter("dhdGetPosition");
  const int code = sdk_.dhdGetPosition(&x_m, &y_m, &z_m, id_);
  calls_.leave();
  if (code < 0) {
    fail(ForceOffCause::kUnplugged);
  } else {
    hand_pos_h_m_ = config_.axes.to_hand(Vec3(x_m, y_m, z_m) - config_.centre_d_m);
  }
  calls_.enter("dhdGetButtonMask");
  const std::uint32_t pressed = sdk_.dhdGetButtonMask(id_);
  calls_.leave();
  reading.status = status_;
  reading.cause = cause_;
  reading.hand_pos_h_m = hand_pos_h_m_;
  // A device that has failed may say that all buttons are pressed: none is believed but a stop.
  reading.buttons = config_.buttons.mapped(pressed);
  if (status_ == DeviceStatus::kFailed) reading.buttons &= kButtonStop;
}

Vec3 OmegaDevice::write_force(const Vec3& hand_force_h_n) noexcept {
  const bool shown = status_ == DeviceStatus::kOk && is_finite(hand_force_h_n);
  const Vec3 force_d_n = shown ? config_.axes.to_device(hand_force_h_n) : Vec3::Zero();
  calls_.enter("dhdSetForce");
  const int code = sdk_.dhdSetForce(force_d_n.x(), force_d_n.y(), force_d_n.z(), id_);
  calls_.leave();
  if (code < 0) {
    // What acts now is what acted before, until the watchdog ends it.
    fail(ForceOffCause::kUnplugged);
    return applied_h_n_;
  }
  applied_h_n_ = shown ? hand_force_h_n : Vec3::Zero();
  if (code == kMotorSaturated) {
    double x_n = 0;
    double y_n = 0;
    double z_n = 0;
    calls_.enter("dhdGetForce");
    const int got = sdk_.dhdGetForce(&x_n, &y_n, &z_n, id_);
    calls_.leave();
    if (got >= 0) applied_h_n_ = config_.axes.to_hand(Vec3(x_n, y_n, z_n));
  }
  if (!watchdog_runs_ && config_.watchdog_ms > 0) {
    watchdog_runs_ = true;
    calls_.enter("dhdSetWatchdog");
    const auto units = static_cast<unsigned char>(config_.watchdog_ms * 1000 / kWatchdogUnitUs);
    if (sdk_.dhdSetWatchdog(units, id_) < 0) fail(ForceOffCause::kDeviceError);
    calls_.leave();
  }
  return applied_h_n_;
}

std::vector<FoundDevice> find_omegas(const SdkSearch& search, const UsbRoots& usb) {
  std::vector<FoundDevice> found;
  const std::vector<UsbNode> nodes = usb_nodes(kVendor, usb);
  const auto add_nodes = [&](const std::string& why) {
    for (const auto& node : nodes) {
      const std::string name = node.product.empty() ? "Force Dimension device" : node.product;
      found.push_back(
          {"omega", name, "", node.node, false, why.empty() ? why_not(node, "no device counted") : why});
    }
  };
  Sdk sdk;
  try {
    sdk = load_sdk(search);
  } catch (const UserError& error) {
    add_nodes(error.what());
    if (nodes.empty()) found.push_back({"omega", "", "", "", false, error.what()});
    return found;
  }
  const int count = sdk.dhdGetDeviceCount();
  if (count <= 0) {
    add_nodes("");
    if (nodes.empty()) found.push_back({"omega", "", "", "", false, none_attached()});
    return found;
  }
  for (int index = 0; index < count; ++index) {
    const OpenDevice device(sdk, index);
    FoundDevice one;
    one.backend = "omega";
    const bool one_each = nodes.size() == static_cast<std::size_t>(count);
    if (one_each) one.node = nodes[static_cast<std::size_t>(index)].node;
    if (device.good()) {
      one.name = device.name();
      if (const auto serial = device.serial()) one.serial = std::to_string(*serial);
      one.usable = true;
      int status[17] = {};
      if (sdk.dhdGetStatus(status, device.id()) < 0) {
        one.usable = false;
        one.why = "it does not tell its state (" + sdk_error(sdk) + "): switch it off and on";
      } else if (status[kPower] == 0) {
        one.usable = false;
        one.why = force_off_text(ForceOffCause::kNoPower);
      } else if (status[kError] != 0) {
        one.usable = false;
        one.why = force_off_text(ForceOffCause::kDeviceError);
      } else if (status[kCalibrated] == 0) {
        one.why = "not calibrated: move its handle by hand to its calibration point, or run with --home";
      } else if (status[kForce] == 0 && status[kForceOffCauseIndex] != 0) {
        one.why = force_off_text(cause_of(status[kForceOffCauseIndex]));
      }
    } else {
      const std::string says = sdk_error(sdk);
      one.name = "device " + std::to_string(index);
      one.why = one_each ? why_not(nodes[static_cast<std::size_t>(index)], says)
                         : "the SDK cannot open it (it says: " + says +
                               "); end other programs that use it, check the rights on its USB node";
    }
    found.push_back(std::move(one));
  }
  return found;
}

}  // namespace telenano::device
