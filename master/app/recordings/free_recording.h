#pragma once

#include <string>

namespace telenano::app {

/// session.h5, session-2.h5 …: the first of these that does not exist, since a recording is never replaced.
/// Empty stays empty.
std::string free_recording(const std::string& wanted);

}  // namespace telenano::app
