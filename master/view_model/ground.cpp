#include "telenano/master/view_model/ground.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace telenano::view_model {
namespace {

constexpr int kTextureMax = 1024;
constexpr int kPartTextureLeast = 64;
constexpr double kLeastPlane_nm = 100;

// Cubic through p1 (t = 0) and p2 (t = 1) whose slopes are the central differences there (Catmull & Rom
// 1974).
double catmull_rom(double p0, double p1, double p2, double p3, double t) noexcept {
  return p1 + 0.5 * t * (p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0)));
}

}  // namespace

Ground::Ground(double surface_z_w_nm, const Vec3& workspace_min_w_nm, const Vec3& workspace_max_w_nm)
    : plane_z_w_nm_(surface_z_w_nm), min_w_nm_(workspace_min_w_nm), max_w_nm_(workspace_max_w_nm) {
  // A server may leave an axis without limits: the picture needs some.
  for (int axis = 0; axis < 2; ++axis) {
    if (max_w_nm_[axis] - min_w_nm_[axis] >= kLeastPlane_nm) continue;
    const double middle = 0.5 * (min_w_nm_[axis] + max_w_nm_[axis]);
    min_w_nm_[axis] = middle - 0.5 * kLeastPlane_nm;
    max_w_nm_[axis] = middle + 0.5 * kLeastPlane_nm;
  }
  min_w_nm_.z() = max_w_nm_.z() = surface_z_w_nm;
}

Ground::Ground(surface::HeightGrid grid) : grid_(std::move(grid)) {
  const auto [lowest, highest] = std::minmax_element(grid_.z_nm.begin(), grid_.z_nm.end());
  min_w_nm_ = {grid_.x_first_nm, grid_.y_first_nm, *lowest};
  max_w_nm_ = {grid_.x_first_nm + (grid_.columns - 1) * grid_.dx_nm,
               grid_.y_first_nm + (grid_.rows - 1) * grid_.dy_nm, *highest};
}

Ground Ground::part(const MapBox& box) const {
  Ground part = *this;
  part.part_ = true;
  part.min_w_nm_ = {box.x_min_nm, box.y_min_nm, min_w_nm_.z()};
  part.max_w_nm_ = {box.x_max_nm, box.y_max_nm, max_w_nm_.z()};
  if (!is_scan()) return part;
  // Lowest and highest as it is drawn: at the places of its texture.
  const int side = part.texture_side();
  double lowest = max_w_nm_.z();
  double highest = min_w_nm_.z();
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      const double z = height_w_nm(box.x_min_nm + box.width_nm() * column / (side - 1),
                                   box.y_min_nm + box.depth_nm() * row / (side - 1));
      lowest = std::min(lowest, z);
      highest = std::max(highest, z);
    }
  }
  part.min_w_nm_.z() = lowest;
  part.max_w_nm_.z() = highest;
  return part;
}

double Ground::at(int column, int row) const noexcept {
  const auto c = static_cast<std::size_t>(std::clamp(column, 0, grid_.columns - 1));
  const auto r = static_cast<std::size_t>(std::clamp(row, 0, grid_.rows - 1));
  return grid_.z_nm[r * static_cast<std::size_t>(grid_.columns) + c];
}

double Ground::height_w_nm(double x_w_nm, double y_w_nm) const noexcept {
  if (grid_.z_nm.empty()) return plane_z_w_nm_;
  if (!std::isfinite(x_w_nm) || !std::isfinite(y_w_nm)) return min_w_nm_.z();
  const double u = std::clamp((x_w_nm - grid_.x_first_nm) / grid_.dx_nm, 0.0, grid_.columns - 1.0);
  const double v = std::clamp((y_w_nm - grid_.y_first_nm) / grid_.dy_nm, 0.0, grid_.rows - 1.0);
  const int column = static_cast<int>(u);
  const int row = static_cast<int>(v);
  double lines[4];
  for (int i = 0; i < 4; ++i) {
    const int r = row - 1 + i;
    lines[i] =
        catmull_rom(at(column - 1, r), at(column, r), at(column + 1, r), at(column + 2, r), u - column);
  }
  return catmull_rom(lines[0], lines[1], lines[2], lines[3], v - row);
}

Vec3 Ground::normal_w(double x_w_nm, double y_w_nm, double step_nm) const noexcept {
  const double dx =
      (height_w_nm(x_w_nm + step_nm, y_w_nm) - height_w_nm(x_w_nm - step_nm, y_w_nm)) / (2 * step_nm);
  const double dy =
      (height_w_nm(x_w_nm, y_w_nm + step_nm) - height_w_nm(x_w_nm, y_w_nm - step_nm)) / (2 * step_nm);
  return Vec3(-dx, -dy, 1).normalized();
}

double Ground::colour_height(double z_w_nm) const noexcept {
  const double relief = relief_nm();
  return relief > 0 ? (z_w_nm - min_w_nm_.z()) / relief : 0.5;
}

double Ground::overview_exaggeration() const noexcept {
  const double relief = relief_nm();
  const double wanted = relief > 0 ? 0.12 * std::max(width_nm(), depth_nm()) / relief : 1;
  double factor = 1;
  for (const double step : {2.0, 3.0, 5.0, 10.0, 20.0}) {
    if (step <= wanted) factor = step;
  }
  return factor;
}

int Ground::texture_side() const noexcept {
  if (grid_.z_nm.empty()) return 2;
  if (!part_) return std::clamp(std::max(grid_.columns, grid_.rows), 2, kTextureMax);
  const double pixels = std::max(width_nm() / grid_.dx_nm, depth_nm() / grid_.dy_nm);
  return std::clamp(static_cast<int>(std::ceil(2 * pixels)) + 1, kPartTextureLeast, kTextureMax);
}

std::vector<float> Ground::height_texture(int side) const {
  std::vector<float> texels;
  texels.reserve(static_cast<std::size_t>(3 * side * side));
  const double dx = width_nm() / (side - 1);
  const double dy = depth_nm() / (side - 1);
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      const double x = min_w_nm_.x() + column * dx;
      const double y = min_w_nm_.y() + row * dy;
      const double left = std::max(x - dx, min_w_nm_.x());
      const double right = std::min(x + dx, max_w_nm_.x());
      const double front = std::max(y - dy, min_w_nm_.y());
      const double back = std::min(y + dy, max_w_nm_.y());
      texels.push_back(static_cast<float>(height_w_nm(x, y)));
      texels.push_back(static_cast<float>((height_w_nm(right, y) - height_w_nm(left, y)) / (right - left)));
      texels.push_back(static_cast<float>((height_w_nm(x, back) - height_w_nm(x, front)) / (back - front)));
    }
  }
  return texels;
}

}  // namespace telenano::view_model
