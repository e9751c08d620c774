#pragma once

#include <chrono>
#include <string>

namespace telenano::app {

struct ConvertLimits {
  std::chrono::milliseconds time{60'000};
  std::size_t bytes_max = std::size_t{1} << 30;  ///< of what it writes
  std::string program = "gwyddion";              ///< looked up in PATH
};

/// The bytes of a .gwy that Gwyddion makes of `path`, one of the some 170 kinds of files that it reads:
/// `gwyddion --convert-to-gwy=OUT FILE` as a child process without a shell, without a display, with its
/// standard input closed, in a folder of its own that is removed again, also when this program is told to
/// end. Throws UserError (one line with the file) when Gwyddion is not installed, cannot read the file,
/// crashes, writes too much or takes too long; RunError when no process can be started.
std::string convert_by_gwyddion(const std::string& path, const ConvertLimits& limits = {});

}  // namespace telenano::app
