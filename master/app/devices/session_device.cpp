#include "telenano/master/app/devices/session_device.h"

#include <charconv>

#include "telenano/common/base/error.h"
#include "telenano/master/app/devices/hand_track_file.h"
#include "telenano/master/device/hid/hid_device.h"
#include "telenano/master/device/hid/hid_port.h"
#include "telenano/master/device/hid/pedalled_device.h"
#include "telenano/master/device/omega/omega_device.h"
#include "telenano/master/device/replay_device.h"
#include "telenano/master/device/sim_device.h"

namespace telenano::app {
namespace {

/// Buttons that the file gives, over those of the backend. A button that is given one meaning loses the one
/// that it has by default.
device::ButtonMap button_map(device::ButtonMap map, const DeviceSettings& settings) {
  const std::uint32_t given = settings.deadman_buttons.value_or(0) | settings.clutch_buttons.value_or(0) |
                              settings.stop_buttons.value_or(0);
  map.deadman = settings.deadman_buttons.value_or(map.deadman & ~given);
  map.clutch = settings.clutch_buttons.value_or(map.clutch & ~given);
  map.stop = settings.stop_buttons.value_or(map.stop & ~given);
  return map;
}

device::OmegaConfig omega_config(const DeviceSettings& settings, bool may_home) {
  device::OmegaConfig config;
  if (settings.serial) {
    unsigned serial = 0;
    const std::string& text = *settings.serial;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), serial);
    if (error != std::errc{} || end != text.data() + text.size() || serial > 65535)
      throw UserError("device.serial = \"" + text + "\", expected 0 to 65535 for an omega");
    config.serial = serial;
  }
  config.home = may_home;
  config.axes = settings.axes.value_or(config.axes);
  config.centre_d_m = settings.centre_m.value_or(config.centre_d_m);
  config.workspace_half_m = settings.workspace_half_m.value_or(config.workspace_half_m);
  config.buttons = button_map(config.buttons, settings);
  config.watchdog_ms = settings.watchdog_ms.value_or(config.watchdog_ms);
  config.force_max_n = settings.force_max_n;
  config.damping_n_s_m = settings.damping_n_s_m.value_or(config.damping_n_s_m);
  config.mass_kg = settings.mass_kg.value_or(config.mass_kg);
  return config;
}

device::HidConfig hid_config(const DeviceSettings& settings) {
  device::HidConfig config;
  config.axes = settings.axes.value_or(config.axes);
  config.buttons = button_map(config.buttons, settings);
  config.speed_m_s = settings.speed_m_s.value_or(config.speed_m_s);
  config.hold_s = settings.hold_s.value_or(config.hold_s);
  config.dead_zone = settings.dead_zone.value_or(config.dead_zone);
  config.motion.half_m = settings.workspace_half_m.value_or(config.motion.half_m);
  return config;
}

SessionDevice open_omega(const DeviceSettings& settings, bool may_home) {
  auto omega = std::make_unique<device::OmegaDevice>(omega_config(settings, may_home));
  SessionDevice opened;
  opened.calls = &omega->calls();
  opened.description = omega->description();
  opened.notes = omega->notes();
  opened.device = std::move(omega);
  return opened;
}

SessionDevice open_hid(const DeviceSettings& settings) {
  SessionDevice opened;
  const device::HidConfig config = hid_config(settings);
  opened.reader = std::make_unique<device::HidReader>(
      device::open_puck({settings.serial}, opened.description), device::take_puck_report);
  opened.device = std::make_unique<device::HidDevice>(opened.reader->news(), config);
  opened.notes.emplace_back("a SpaceMouse shows no force; it moves while its deadman button is held");
  return opened;
}

SessionDevice open_replay(const std::string& file) {
  SessionDevice opened;
  auto replay = std::make_unique<device::ReplayDevice>(load_hand_track(file), file);
  opened.motion = replay.get();
  opened.device = std::move(replay);
  opened.description = "the hand of " + file;
  return opened;
}

SessionDevice open_mouse(const DeviceSettings& settings,
                         const rt::LatestValue<device::PointerState>* pointer) {
  if (pointer == nullptr) {
    throw UserError(
        "--device mouse: the mouse moves the hand in the viewer's window, and this command opens no "
        "window; use " +
        any_of_text(device_names([](const DeviceRow& row) { return !row.needs_window; })));
  }
  SessionDevice opened;
  device::PointerConfig config;
  config.motion.half_m = settings.workspace_half_m.value_or(config.motion.half_m);
  opened.device = std::make_unique<device::PointerDevice>(*pointer, config);
  opened.description = "mouse and keyboard in the viewer's window, without force";
  return opened;
}

}  // namespace

std::optional<device::DeviceInfo> planned_device(const DeviceSpec& spec, const StationFile& file) {
  switch (spec.kind) {
    case DeviceSpec::Kind::kSim:
      return device::sim_device_info(file.plant);
    case DeviceSpec::Kind::kOmega:
      return device::omega_device_info(omega_config(file.device, false));
    case DeviceSpec::Kind::kHid:
    case DeviceSpec::Kind::kMouse:
    case DeviceSpec::Kind::kReplay:
      break;
  }
  return std::nullopt;
}

SessionDevice open_session_device(const DeviceSpec& spec, const DeviceSettings& settings, bool may_home,
                                  const rt::LatestValue<device::PointerState>* pointer) {
  using Kind = DeviceSpec::Kind;
  if (may_home && !device_row(spec.kind).has_motors)
    throw UserError("--home: only --device " +
                    any_of_text(device_names([](const DeviceRow& row) { return row.has_motors; })) +
                    " has motors that can home it");
  switch (spec.kind) {
    case Kind::kOmega:
      return open_omega(settings, may_home);
    case Kind::kHid:
      return open_hid(settings);
    case Kind::kReplay:
      return open_replay(spec.file);
    case Kind::kMouse:
      return open_mouse(settings, pointer);
    case Kind::kSim:
      break;
  }
  return {};
}

void add_pedals(SessionDevice& opened, const PedalSettings& settings) {
  if (settings.vendor == 0) return;
  std::string description;
  opened.pedals = std::make_unique<device::HidReader>(
      device::open_pedals(settings.vendor, settings.product, description), device::take_pedal_report);
  opened.device = std::make_unique<device::PedalledDevice>(std::move(opened.device), opened.pedals->news(),
                                                           settings.buttons);
  opened.notes.push_back("pedals: " + description);
}

}  // namespace telenano::app
