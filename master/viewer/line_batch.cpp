#include "telenano/master/viewer/line_batch.h"

#include <Eigen/Geometry>
#include <cmath>

namespace telenano::viewer {

void LineBatch::push(const Eigen::Vector4d& clip, const view_model::Rgb& colour, double alpha) {
  for (int i = 0; i < 4; ++i) corners_.push_back(static_cast<float>(clip[i]));
  corners_.insert(corners_.end(), {colour.r, colour.g, colour.b, static_cast<float>(alpha)});
}

void LineBatch::add_point(const Vec3& at_nm, const view_model::Rgb& colour, double alpha) {
  push(clip_of_scene_ * at_nm.homogeneous(), colour, alpha);
}

void LineBatch::add(const Vec3& from_nm, const Vec3& to_nm, const view_model::Rgb& colour, double alpha,
                    double wide_px) {
  const Eigen::Vector4d a = clip_of_scene_ * from_nm.homogeneous();
  const Eigen::Vector4d b = clip_of_scene_ * to_nm.homogeneous();
  if (a.w() <= 0 || b.w() <= 0) return;
  const Eigen::Vector2d half(0.5 * width_px_, 0.5 * height_px_);
  const Eigen::Vector2d pa = (a.head<2>() / a.w()).cwiseProduct(half);
  const Eigen::Vector2d pb = (b.head<2>() / b.w()).cwiseProduct(half);
  Eigen::Vector2d along = pb - pa;
  const double length = along.norm();
  along = length > 1e-9 ? Eigen::Vector2d(along / length) : Eigen::Vector2d::UnitX();
  const Eigen::Vector2d side = 0.5 * wide_px * Eigen::Vector2d(-along.y(), along.x());
  const auto corner = [&](const Eigen::Vector4d& clip, const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d ndc = pixel.cwiseQuotient(half);
    return Eigen::Vector4d(ndc.x() * clip.w(), ndc.y() * clip.w(), clip.z(), clip.w());
  };
  const Eigen::Vector4d a1 = corner(a, pa - side);
  const Eigen::Vector4d a2 = corner(a, pa + side);
  const Eigen::Vector4d b1 = corner(b, pb - side);
  const Eigen::Vector4d b2 = corner(b, pb + side);
  for (const auto& c : {a1, b1, a2, a2, b1, b2}) push(c, colour, alpha);
}

}  // namespace telenano::viewer
