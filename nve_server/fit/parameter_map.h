#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace telenano::fit {

/// What curves at the places of a grid have given, as a picture that Gwyddion and others read.
struct ParameterMap {
  int columns = 0;
  int rows = 0;
  double width_nm = 0;   ///< of the grid, pixel borders included
  double length_nm = 0;  ///< the same along y
  std::string title;
  std::string unit;  ///< of the values: "Pa", "J/m2"
  /// Line by line from the lower left. What is no number is a place whose curve tells nothing.
  std::vector<double> values;
};

/// Gwyddion Simple Field, rows from top to bottom, float32. A place without a number has the median of the
/// others, since not all programs read files with holes; `filled` receives how many. Needs at least one
/// number and as many values as columns × rows.
std::string format_map(const ParameterMap& map, std::size_t& filled);

}  // namespace telenano::fit
