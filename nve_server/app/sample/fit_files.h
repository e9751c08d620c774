#pragma once

#include <string>

#include "telenano/nve_server/app/sample/fit_options.h"

namespace telenano::app {

std::string number_text(double value, int digits = 4);

/// Throws UserError for what is no file of at most 256 MiB.
std::string read_curve_bytes(const std::string& path);

/// Throws UserError if `path`, which `flag` names, is there already or is one of the curves.
void check_target(const std::string& path, const char* flag, const FitOptions& options);

}  // namespace telenano::app
