#pragma once

#include <string>
#include <vector>

namespace telenano::view_model {

/// What a window says once its session is over. No lines: the window closes with the session.
struct SessionEnd {
  bool failed = false;             ///< the first line is the cause
  std::vector<std::string> lines;  ///< else a summary
};

}  // namespace telenano::view_model
