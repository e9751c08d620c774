#pragma once

#include <string>

#include "telenano/master/app/view/session_view.h"

namespace telenano::app {

/// Shows a recording in a window, to be played and moved about in, or draws one picture of it at
/// `options.at_s` of its own time. Returns one line for a person. No server, no device. Throws UserError for
/// what is no recording, and without a display.
std::string view_recording(const std::string& file, const ViewOptions& options);

}  // namespace telenano::app
