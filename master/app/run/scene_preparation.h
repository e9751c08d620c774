#pragma once

#include <cstddef>

#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/run/session_parts.h"

namespace telenano::app {

/// The session once more, with the same slave and another wish about the log of steps.
void connect_again(SessionParts& parts, std::size_t step_ring);

/// Before there is a loop: measures the link, then waits for a twin of the scene, and for what a picture or a recording
/// needs of the scene. A window shows the sample meanwhile. On a stop the rest is left out.
LinkDelay prepare_scene(SessionParts& parts, const RunOptions& options);

}  // namespace telenano::app
