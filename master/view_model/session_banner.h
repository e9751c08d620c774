#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/recording/sample.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/twin_run.h"
#include "telenano/master/view_model/live_session.h"
#include "telenano/master/view_model/status_text.h"

namespace telenano::view_model {

/// All that the words about a session's state depend on.
struct SessionInputs {
  const recording::Sample& now;
  Origin origin = Origin::kUnknown;
  double give_up_s = 0;  ///< of silence, after which the session ends; 0: not known
  bool ended = false;
  bool played = false;  ///< a recording is shown: nothing of it happens now
  station::TwinState twin = station::TwinState::kNone;
  device::ForceOffCause device_cause = device::ForceOffCause::kNone;
  bool mouse_leads = false;
};

/// One word in the corner of the picture. Filled: it holds now.
struct Badge {
  enum class Kind : std::uint8_t { kPlayed, kSource, kLink, kMode, kTwin, kEnd };
  Kind kind = Kind::kMode;
  std::string word;
  Mood mood = Mood::kCalm;
  bool filled = false;
};

/// What a session's state is, why, and what to do about it: the only place where that is decided.
struct SessionBanner {
  std::vector<Badge> badges;   ///< in the order in which they are drawn
  std::vector<Message> lines;  ///< cause and what to do, the gravest first; empty: all is as it should be
};

/// - The source (SIM: computed, AFM: measured) is filled only in a session that goes on and is answered.
/// - A silence is NO ANSWER before the first reply, STALE while the station still shows a force of what it
///   heard last, LOST from when it holds the tip; each with its age and, where known, the time until the
///   session ends.
///   The station's mode is then not told unless it is one that the hand must know: a mode is what the last
///   reply made it.
/// - A twin is told where it is felt (method twin), or was given up: confirmed is filled only while replies
///   come that can confirm it. Apart has a line that says what happens.
/// - Stopped and Observing are told in every state but the end, also together.
SessionBanner session_banner(const SessionInputs& inputs);

}  // namespace telenano::view_model
