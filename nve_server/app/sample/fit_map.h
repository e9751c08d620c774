#pragma once

#include <cstddef>
#include <vector>

#include "telenano/nve_server/app/sample/fit_options.h"
#include "telenano/nve_server/fit/parameter_map.h"

namespace telenano::app {

/// The pictures that are asked for, without values; as many curves as places. Throws UserError.
fit::ParameterMap map_of(const FitOptions& options, std::size_t curves);

/// Throws UserError if one of the pictures is there already.
void check_map_targets(const FitOptions& options);

void write_maps(const FitOptions& options, fit::ParameterMap map, const std::vector<FittedCurve>& curves);

}  // namespace telenano::app
