#pragma once

#include <filesystem>
#include <vector>

#include "telenano/common/net/impairment.h"

namespace telenano::studies {

/// Reads "time_s,delay_ms,lost" (that header, then a row each): times rise and count from the first one,
/// delays are 0 to 60000, lost is 0 or 1. Throws UserError that names file, line, column and range.
std::vector<net::TraceRow> load_trace(const std::filesystem::path& file);

}  // namespace telenano::studies
