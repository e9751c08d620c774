#pragma once

#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"

namespace telenano::app {

/// Where the commanded end is to be, and when.
struct PathPoint {
  double t_s = 0;
  Vec3 end_w_nm = Vec3::Zero();
};

/// A CSV whose first line is `t_s,x_nm,y_nm,z_nm`: frame W, time rising from row to row. Empty lines and
/// lines that begin with # are passed over. Throws UserError: one line naming file, line and what is
/// expected.
std::vector<PathPoint> read_path(const std::string& path);
std::vector<PathPoint> parse_path(const std::string& text, const std::string& name);

}  // namespace telenano::app
