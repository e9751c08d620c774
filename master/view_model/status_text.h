#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/method.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/recording/sample.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/view_model/view_port.h"

namespace telenano::view_model {

enum class Mood : std::uint8_t { kCalm, kGood, kWarning, kAlarm };

struct Message {
  std::string text;
  Mood mood = Mood::kCalm;
};

/// Is the tip another session's, or nobody's?
bool observes(const recording::Sample& now) noexcept;

/// From when on a silence is one: long against the time between replies, too short to be worked in.
inline constexpr double kSilentS = 0.2;
/// How long nothing has been heard; 0: not worth telling.
double silent_s(const recording::Sample& now) noexcept;
/// That, and when the station gives up; `give_up_s` 0: not known.
std::string silence_text(double silent_s, double give_up_s);

/// The station's mode in a word or two.
Message mode_text(const recording::Sample& now);

/// Why the hand feels no force, or less than it should, in words that say what to do; empty when all is as
/// it should be. One line for each cause, the gravest first. `mouse_leads`: the hand is held by a mouse.
std::vector<Message> force_text(const recording::Sample& now,
                                device::ForceOffCause device_cause = device::ForceOffCause::kNone,
                                bool mouse_leads = false);

/// That the mouse's hand can lead the tip no further than `reach_nm` from where it took hold.
std::string reach_text(double reach_nm, bool mouse);
/// What became of a wish to take marks back; empty: nothing yet.
const char* undo_text(UndoText answer) noexcept;
/// Of the wish for another sample, likewise.
const char* scene_text(SceneText answer) noexcept;

/// What the slave reports (link::FaultBits).
std::vector<Message> slave_text(std::uint32_t slave_faults);

/// What the particle is doing (link::ParticleStatus).
const char* particle_text(link::ParticleStatus status);

/// What the tip is doing (link::ContactState).
const char* contact_text(std::uint32_t contact_state);

/// A force's size, and which way its part along z goes: "push 12.7 nN", "pull 450 pN".
std::string force_size_text(const Vec3& force_w_nn);
/// Its parts in nN, e.g. "x +12.6  y -0.1  z +1.7 nN", or bare, "+12.6 -0.1 +1.7".
std::string force_parts_text(const Vec3& force_w_nn, bool named = true);

/// "radius 3.2 nm, 32 nm²", "none", or what is missing to know it.
std::string contact_area_text(const ShownContact& contact);
/// "lets go at 39 nN"; "–" where it is not known.
std::string adhesion_text(const ShownContact& contact);
/// The method's name and who has chosen it.
std::string method_text(control::Method method, bool by_link);

/// A length with a fitting unit and three digits: "12.3 nm", "450 pm", "1.20 µm".
std::string length_text(double nm);
/// Likewise "12.3 nN", "450 pN", "1.20 µN".
std::string force_text(double nn);
/// Likewise "83 µs", "12.4 ms", "1.2 s".
std::string time_text(double us);

}  // namespace telenano::view_model
