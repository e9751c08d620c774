#pragma once

#include "telenano/master/app/run/run_options.h"

namespace telenano::app {

/// One session from handshake to Bye: checks what was asked, opens the device, connects, measures the link,
/// plans, and runs the loop beside window, recorder and metrics. Returns the program's exit code. Throws
/// UserError and RunError.
int run_session(const RunOptions& options);

}  // namespace telenano::app
