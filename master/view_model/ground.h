#pragma once

#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/surface/height_grid.h"

namespace telenano::view_model {

/// A rectangle of a map, frame W.
struct MapBox {
  double x_min_nm = 0;
  double x_max_nm = 0;
  double y_min_nm = 0;
  double y_max_nm = 0;
  double width_nm() const noexcept { return x_max_nm - x_min_nm; }
  double depth_nm() const noexcept { return y_max_nm - y_min_nm; }
  bool contains(const Vec3& pos_w_nm) const noexcept {
    return pos_w_nm.x() >= x_min_nm && pos_w_nm.x() <= x_max_nm && pos_w_nm.y() >= y_min_nm &&
           pos_w_nm.y() <= y_max_nm;
  }
};

/// The sample's surface as the picture knows it: a scan that the person at the station gave, or the plane at
/// the height that the server's Welcome names. It is drawn, never felt.
class Ground {
 public:
  /// A plane over a box of the workspace.
  Ground(double surface_z_w_nm, const Vec3& workspace_min_w_nm, const Vec3& workspace_max_w_nm);
  /// A scan; at least 2 × 2 heights.
  explicit Ground(surface::HeightGrid grid);

  /// What lies in `box`, which must lie in this one and have an area: the same heights, but lowest, highest,
  /// texture and exaggeration are its own. A copy of the whole's heights.
  Ground part(const MapBox& box) const;

  /// Its heights; none: a plane.
  const surface::HeightGrid& heights() const noexcept { return grid_; }
  bool is_scan() const noexcept { return !grid_.z_nm.empty(); }
  /// Catmull-Rom through the heights: smooth between pixels, exact on them; beyond the rim as at the rim.
  double height_w_nm(double x_w_nm, double y_w_nm) const noexcept;
  /// Downward slopes of that surface by central differences over a step: (−∂z/∂x, −∂z/∂y, 1), of length 1.
  Vec3 normal_w(double x_w_nm, double y_w_nm, double step_nm) const noexcept;

  const Vec3& min_w_nm() const noexcept { return min_w_nm_; }  ///< corner; z lowest height
  const Vec3& max_w_nm() const noexcept { return max_w_nm_; }
  double width_nm() const noexcept { return max_w_nm_.x() - min_w_nm_.x(); }
  double depth_nm() const noexcept { return max_w_nm_.y() - min_w_nm_.y(); }
  double relief_nm() const noexcept { return max_w_nm_.z() - min_w_nm_.z(); }
  double pixel_nm() const noexcept { return grid_.z_nm.empty() ? 1 : grid_.dx_nm; }
  /// 0 … 1 over the relief; ½ on a plane.
  double colour_height(double z_w_nm) const noexcept;

  /// Factor by which heights are drawn taller in the overview so that the relief shows: 1, 2, 3, 5, 10, 20.
  double overview_exaggeration() const noexcept;

  /// Heights and slopes at `side` × `side` places evenly over the ground, for a texture: h, ∂z/∂x, ∂z/∂y.
  std::vector<float> height_texture(int side) const;
  int texture_side() const noexcept;  ///< that shows every height, of a part twice as fine, at most 1024

 private:
  double at(int column, int row) const noexcept;

  surface::HeightGrid grid_;
  double plane_z_w_nm_ = 0;
  bool part_ = false;
  Vec3 min_w_nm_ = Vec3::Zero();
  Vec3 max_w_nm_ = Vec3::Zero();
};

}  // namespace telenano::view_model
