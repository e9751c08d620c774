#pragma once

#include <string>

namespace telenano::app {

/// Why this file cannot be read, and what to do; empty: it can be tried. The path as a person typed it.
std::string read_fault(const std::string& path);

/// Why no recording can begin in this file, and what to do; empty: it can be tried.
std::string recording_fault(const std::string& path);

}  // namespace telenano::app
