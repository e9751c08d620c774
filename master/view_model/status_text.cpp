#include "telenano/master/view_model/status_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/link/messages.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"

namespace telenano::view_model {
namespace {

struct Fault {
  std::uint32_t bit;
  const char* text;
};

// The gravest first. Those that latch end with what a person has to do.
constexpr std::array<Fault, 13> kStationFaults = {{
    {station::kFaultDeviceFailed, "The device has failed: zero force. Check its cable and power, then clear"},
    {station::kFaultForceNonFinite, "The station's own force was no number: zero force. Please report this"},
    {station::kFaultHandPosNonFinite,
     "The device reported an impossible position: zero force. Look at it, then clear"},
    {station::kFaultAppliedNonFinite,
     "The device reported an impossible force: zero force. Look at it, then clear"},
    {station::kFaultVelocityTrip, "The hand moved too fast: zero force. Take hold again, then clear"},
    {station::kFaultSlaveStiffer,
     "The new sample is stiffer than what was planned for: start the session anew"},
    {station::kFaultOtherScene, "The server that came back has another sample: start the session anew"},
    {station::kFaultStopPressed, "Stopped by the operator: zero force, the tip retracts. Clear when ready"},
    {station::kFaultBadTick, "A tick without length: zero force in it"},
    {station::kFaultReplyNonFinite, "A reply was no number: left out, the force comes back by a ramp"},
    {station::kFaultOld,
     "The round trip is too long for this method: the force fades, the tip holds, until it is shorter"},
    {station::kFaultTwinLeft,
     "There is no twin any more: the force fades, and comes back at a lower scale, planned without it"},
    {station::kFaultStale, "No news from the server: the force is held, then fades to zero"},
}};

std::string with_unit(double value, const std::array<const char*, 4>& units) {
  // units: of 1e-3, 1, 1e3, 1e6
  if (!std::isfinite(value)) return "–";
  const double size = std::abs(value);
  std::size_t unit = 1;
  double shown = value;
  if (size >= 999.5e3) {
    unit = 3;
    shown = value * 1e-6;
  } else if (size >= 999.5) {
    unit = 2;
    shown = value * 1e-3;
  } else if (size < 0.9995 && size > 0) {
    unit = 0;
    shown = value * 1e3;
  }
  const double magnitude = std::abs(shown);
  const int digits = magnitude >= 99.95 ? 0 : magnitude >= 9.995 ? 1 : 2;
  return fmt::format("{:.{}f} {}", shown, digits, units[unit]);
}

}  // namespace

bool observes(const recording::Sample& now) noexcept {
  return (now.limit_flags & recording::kLimitObserves) != 0;
}

double silent_s(const recording::Sample& now) noexcept {
  // Before the first reply there is no age: since the start, then.
  const double silence_s = std::min(now.reply_age_ms * 1e-3, now.time_s);
  return silence_s > kSilentS ? silence_s : 0;
}

std::string silence_text(double silent_s, double give_up_s) {
  const std::string since =
      fmt::format("No answer from the server for {:.1f} s: what is shown is old", silent_s);
  if (!(give_up_s > 0)) return since;
  return since +
         fmt::format("; the session ends in {:.0f} s", std::ceil(std::max(give_up_s - silent_s, 0.0)));
}

Message mode_text(const recording::Sample& now) {
  switch (static_cast<station::Mode>(now.station_mode)) {
    case station::Mode::kIdle:
      return {"Connecting", Mood::kWarning};
    case station::Mode::kReady:
      if (observes(now)) return {"Observing", Mood::kWarning};
      return {(now.buttons & device::kButtonClutch) != 0 ? "Clutch: hand is free" : "Ready", Mood::kCalm};
    case station::Mode::kEngaged:
      if (observes(now)) return {"Observing", Mood::kWarning};
      return {(now.limit_flags & recording::kLimitRamp) != 0 ? "Engaging" : "Engaged", Mood::kGood};
    case station::Mode::kHeld:
      return {"Held", Mood::kWarning};
    case station::Mode::kHoming:
      return {"Homing", Mood::kWarning};
    case station::Mode::kStopped:
      return {"Stopped", Mood::kAlarm};
  }
  return {"Unknown", Mood::kAlarm};
}

std::vector<Message> force_text(const recording::Sample& now, device::ForceOffCause device_cause,
                                bool mouse_leads) {
  std::vector<Message> messages;
  if (device_cause != device::ForceOffCause::kNone)
    messages.push_back({std::string("Device: ") + device::force_off_text(device_cause), Mood::kAlarm});
  const auto mode = static_cast<station::Mode>(now.station_mode);
  for (const Fault& fault : kStationFaults) {
    if ((now.station_faults & fault.bit) == 0) continue;
    const bool grave = fault.bit != station::kFaultStale && fault.bit != station::kFaultOld &&
                       fault.bit != station::kFaultReplyNonFinite && fault.bit != station::kFaultBadTick &&
                       fault.bit != station::kFaultTwinLeft;
    messages.push_back({fault.text, grave ? Mood::kAlarm : Mood::kWarning});
  }
  if (observes(now))
    messages.push_back(
        {"Observing: the tip is another session's, or nobody's. Zero force, and your hand moves nothing",
         Mood::kWarning});
  if (mode == station::Mode::kIdle)
    messages.push_back({"No session: zero force until the server answers", Mood::kWarning});
  if (mode == station::Mode::kHeld)
    messages.push_back({"The server is silent: zero force, the tip's target stands still", Mood::kWarning});
  if (mode == station::Mode::kHoming)
    messages.push_back({"The device is not calibrated: zero force until it is", Mood::kWarning});
  if (mode == station::Mode::kReady && !observes(now)) {
    if ((now.buttons & device::kButtonClutch) != 0)
      messages.push_back({"Clutch held: move the hand where it is comfortable", Mood::kCalm});
    else if ((now.buttons & device::kButtonDeadman) == 0)
      messages.push_back({mouse_leads ? "Hold the left button in a picture and drag: the tip follows"
                                      : "Take hold: the deadman is not pressed",
                          Mood::kCalm});
  }
  const std::uint32_t limits = now.limit_flags;
  if ((limits & recording::kLimitForce) != 0)
    messages.push_back({"Force limit: you feel less than the tip does", Mood::kWarning});
  if ((limits & recording::kLimitClamp) != 0)
    messages.push_back({"Energy clamp: force held back to keep touch passive", Mood::kWarning});
  if ((limits & recording::kLimitDamper) != 0) messages.push_back({"Passivity damper at work", Mood::kCalm});
  return messages;
}

std::string reach_text(double reach_nm, bool mouse) {
  return fmt::format(
      "The {} leads the tip by at most {} from where it took hold: let go, then take hold again",
      mouse ? "mouse" : "hand", length_text(reach_nm));
}

const char* scene_text(SceneText answer) noexcept {
  switch (answer) {
    case SceneText::kNone:
      break;
    case SceneText::kLetsGo:
      return "Going to another sample: the force fades, the tip is let go";
    case SceneText::kAsked:
      return "Going to another sample: the server is asked for it";
    case SceneText::kRefused:
      return "The server does not have that sample, or no place at it now: the session goes on at this one";
    case SceneText::kRate:
      return "The server takes fewer commands a second at that sample: the session goes on at this one";
    case SceneText::kShuttingDown:
      return "The server is shutting down: the session goes on at this sample until it does";
    case SceneText::kNoAnswer:
      return "The server does not answer the wish for another sample: the session goes on at this one";
  }
  return "";
}

const char* undo_text(UndoText answer) noexcept {
  switch (answer) {
    case UndoText::kNone:
    case UndoText::kAsked:
      break;
    case UndoText::kDone:
      return "The last marks are undone: the sample is as it was before";
    case UndoText::kRefused:
      return "Marks not undone: none are left, or the tip is too near the ground";
    case UndoText::kAnothers:
      return "Marks not undone: another operator has made the last ones";
    case UndoText::kNoAnswer:
      return "Marks not undone: the server has not answered";
  }
  return "";
}

std::vector<Message> slave_text(std::uint32_t faults) {
  constexpr std::array<Fault, 10> kFaults = {{
      {link::kFaultNonFinite, "The slave met a value that is no number: zero force"},
      {link::kFaultRetracted, "The tip has been retracted"},
      {link::kFaultApproaching, "The tip is on its way to the sample: no force until it is there"},
      {link::kFaultForceLimit, "The slave holds the tip back at its force limit"},
      {link::kFaultWorkspace, "At the border of the workspace"},
      {link::kFaultStepLimit, "Too fast for the slave: the tip follows late"},
      {link::kFaultShare, "More than this session's share of the server: the tip follows late"},
      {link::kFaultUndo, "The last marks were not undone"},
      {link::kFaultUndoAnothers, "The last marks are another operator's"},
      {link::kFaultNoEquilibrium, "The slave's solver gave up in this step: tip held"},
  }};
  std::vector<Message> messages;
  for (const Fault& fault : kFaults) {
    if ((faults & fault.bit) == 0) continue;
    messages.push_back({fault.text, fault.bit == link::kFaultNonFinite ? Mood::kAlarm : Mood::kWarning});
  }
  return messages;
}

const char* particle_text(link::ParticleStatus status) {
  switch (status) {
    case link::ParticleStatus::kRests:
      return "particle at rest";
    case link::ParticleStatus::kPushed:
      return "particle touched";
    case link::ParticleStatus::kHeld:
      return "particle picked up";
    case link::ParticleStatus::kLost:
      return "particle lost";
  }
  return "particle";
}

const char* contact_text(std::uint32_t contact_state) {
  switch (static_cast<link::ContactState>(contact_state)) {
    case link::ContactState::kFree:
      return "free";
    case link::ContactState::kVanDerWaals:
      return "attracted";
    case link::ContactState::kNonContact:
      return "adhesive gap";
    case link::ContactState::kContact:
      return "in contact";
  }
  return "unknown";
}

std::string force_size_text(const Vec3& force_w_nn) {
  return (force_w_nn.z() < 0 ? "pull " : "push ") + force_text(force_w_nn.norm());
}

std::string force_parts_text(const Vec3& force_w_nn, bool named) {
  if (!is_finite(force_w_nn)) return "–";
  // As many digits as the largest part has three of.
  const double most = force_w_nn.cwiseAbs().maxCoeff();
  const int digits = most >= 99.95 ? 0 : most >= 9.995 ? 1 : 2;
  const double least = 0.5 * std::pow(10.0, -digits);
  const auto part = [&](double nn) { return std::abs(nn) < least ? 0.0 : nn; };  // no "-0.0"
  return fmt::format(
      fmt::runtime(named ? "x {:+.{}f}  y {:+.{}f}  z {:+.{}f} nN" : "{:+.{}f} {:+.{}f} {:+.{}f}"),
      part(force_w_nn.x()), digits, part(force_w_nn.y()), digits, part(force_w_nn.z()), digits);
}

std::string length_text(double nm) {
  return with_unit(nm, {"pm", "nm", "µm", "mm"});
}
std::string force_text(double nn) {
  return with_unit(nn, {"pN", "nN", "µN", "mN"});
}
std::string contact_area_text(const ShownContact& contact) {
  if (!contact.area_known) return "needs a twin";
  if (!(contact.radius_nm > 0)) return "none";
  const double area_nm2 = kPi * contact.radius_nm * contact.radius_nm;
  return fmt::format("radius {}, {:.3g} nm²", length_text(contact.radius_nm), area_nm2);
}

std::string adhesion_text(const ShownContact& contact) {
  return contact.adhesion_nn > 0 ? "lets go at " + force_text(contact.adhesion_nn) : "–";
}

std::string method_text(control::Method method, bool by_link) {
  return std::string(control::method_name(method)) + (by_link ? ", by the link" : "");
}

std::string time_text(double us) {
  return with_unit(us, {"ns", "µs", "ms", "s"});
}

}  // namespace telenano::view_model
