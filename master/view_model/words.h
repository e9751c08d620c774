#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/link/messages.h"
#include "common/recording/sample.h"
#include "master/device/haptic_device.h"

namespace telenano::view_model {

enum class Mood : std::uint8_t { kCalm, kGood, kWarning, kAlarm };

struct Message {
  std::string text;
  Mood mood = Mood::kCalm;
};

/// The station's mode in a word or two.
Message mode_words(const recording::Sample& now);

/// Why the hand feels no force, or less than it should, in words that say what to do; empty when all is as
/// it should be. One line for each cause, the gravest first. `mouse_leads`: the hand is held by a mouse.
std::vector<Message> force_words(const recording::Sample& now,
                                 device::ForceOffCause device_cause = device::ForceOffCause::kNone,
                                 bool mouse_leads = false);

/// What the slave reports (link::FaultBits).
std::vector<Message> slave_words(std::uint32_t slave_faults);

/// What the particle is doing (link::ParticleStatus).
const char* particle_words(link::ParticleStatus status);

/// What the tip is doing (link::ContactState).
const char* contact_words(std::uint32_t contact_state);

/// A length with a fitting unit and three digits: "12.3 nm", "450 pm", "1.20 µm".
std::string length_text(double nm);
/// Likewise "12.3 nN", "450 pN", "1.20 µN".
std::string force_text(double nn);
/// Likewise "83 µs", "12.4 ms", "1.2 s".
std::string time_text(double us);

}  // namespace telenano::view_model
