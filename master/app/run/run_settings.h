#pragma once

#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/station_file.h"

namespace telenano::app {

/// How a run is to go: the file of --config, then the flags, which win. Throws UserError on what cannot be.
StationFile station_file(const RunOptions& options);

}  // namespace telenano::app
