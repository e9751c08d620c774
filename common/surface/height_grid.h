#pragma once

#include <vector>

namespace telenano::surface {

/// Heights on a uniform grid, frame W: z(column, row) at x = x_first + column·dx, y = y_first + row·dy (row 0
/// lowest).
struct HeightGrid {
  int columns = 0;
  int rows = 0;
  double dx_nm = 1;
  double dy_nm = 1;
  double x_first_nm = 0;
  double y_first_nm = 0;
  std::vector<double> z_nm;  ///< row-major, rows·columns
};

}  // namespace telenano::surface
