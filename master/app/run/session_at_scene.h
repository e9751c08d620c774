#pragma once

#include <optional>

#include "telenano/master/app/run/session_parts.h"

namespace telenano::app {

/// The session at one scene; its exit code, or nothing: it goes on at another one.
std::optional<int> run_at_scene(SessionParts& parts);

/// Before the session begins at another scene: a file of the first one's is of no use, and a log of steps that was given
/// up there may be of use here.
void go_on(SessionParts& parts);

}  // namespace telenano::app
