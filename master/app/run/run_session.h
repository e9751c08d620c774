#pragma once

#include <optional>

#include "telenano/master/app/run/next_run.h"
#include "telenano/master/app/run/run_options.h"

namespace telenano::app {

/// One session from handshake to Bye: checks what was asked, opens the device, connects, measures the link,
/// plans, and runs the loop beside window, recorder and metrics. Returns the program's exit code. `next`,
/// also when it throws: is there where there is a window, and knows whether a person asked in it for the same
/// session once more. Throws UserError and RunError.
int run_session(const RunOptions& options, std::optional<NextRun>& next);

}  // namespace telenano::app
