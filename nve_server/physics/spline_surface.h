#pragma once

#include <vector>

#include "nve_server/physics/height_grid.h"
#include "nve_server/physics/sample_tops.h"
#include "nve_server/physics/surface.h"

namespace telenano::physics {

/// Value and derivatives of the height field at a point, nm and its powers.
struct HeightJet {
  double z = 0;
  double zx = 0, zy = 0;
  double zxx = 0, zxy = 0, zyy = 0;
};

/// Bicubic B-spline through the heights of a grid: C², so normals are smooth and curvatures continuous.
///
///   z(x, y) = Σ_ij c_ij β³(x/dx − i) β³(y/dy − j),  with c from the interpolation condition
///   (c_{i−1} + 4c_i + c_{i+1})/6 = f_i along rows, then columns, the coefficients mirrored about the first
///   and the last sample (Unser, IEEE Signal Processing Magazine 16(6):22, 1999). Mirrored ends have no slope
///   across the rim, so that continuing the rim's height outwards, as is done beyond the grid, keeps the
///   field C¹.
///
/// Fourth-order accurate for smooth heights. The field between samples overshoots a step by up to about 14 %
/// of it.
class SplineSurface final : public Surface {
 public:
  /// Needs at least 2×2 finite samples and positive spacing.
  explicit SplineSurface(const HeightGrid& grid);

  HeightJet jet(double x_nm, double y_nm) const noexcept;
  bool inside(double x_nm, double y_nm) const noexcept;

  SurfaceContact nearest(const Vec3& centre_w_nm, Search search, FootMemory& memory) const noexcept override;
  double height_nm(double x_nm, double y_nm) const noexcept override;
  double lowest_nm() const noexcept override { return tops_.lowest_nm(); }
  double highest_nm() const noexcept override { return tops_.highest_nm(); }
  bool is_flat() const noexcept override { return false; }

  double x_first_nm() const noexcept { return x_first_; }
  double y_first_nm() const noexcept { return y_first_; }
  double x_last_nm() const noexcept { return x_last_; }
  double y_last_nm() const noexcept { return y_last_; }

 private:
  struct Foot;
  Foot descend(const Vec3& centre_w_nm, double x_nm, double y_nm) const noexcept;

  int columns_, rows_;
  double dx_, dy_, inv_dx_, inv_dy_;
  double x_first_, y_first_, x_last_, y_last_;
  int stride_;                        // of the coefficients: columns + 2, one more at either end
  std::vector<double> coefficients_;  // padded, so that a cell's 4×4 are always there

  SampleTops tops_;  // for the global search
};

}  // namespace telenano::physics
