#pragma once

#include <string>

#include "master/device/intended_motion.h"
#include "master/device/plant.h"
#include "master/station/station_config.h"

namespace telenano::app {

/// Everything that deploy/station.toml may say; what it leaves out keeps its default.
struct StationFile {
  station::StationConfig station{};
  device::PlantConfig simulated_device{};  ///< its period follows station.rate_hz
  device::TaskOptions task{};              ///< start_height_nm comes from the session, not from here
  std::string content;                     ///< of the file, for the recording
};

/// Throws UserError: one line with file, line, key and expected range; unknown keys are refused.
StationFile load_station_file(const std::string& path);
StationFile parse_station_file(std::string content, const std::string& name);

/// After flags have changed it: checks the whole and makes the simulated device follow the rate.
void finish_station_file(StationFile& file, const std::string& source);

}  // namespace telenano::app
