#include "telenano/master/view_model/profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"

namespace telenano::view_model {

Profile profile_of(const Ground& ground, const Vec3& from_w_nm, const Vec3& to_w_nm) {
  constexpr double kMost = 2000;
  const Vec3 way = to_w_nm - from_w_nm;
  const double level_nm = std::hypot(way.x(), way.y());
  const auto parts =
      static_cast<int>(std::clamp(std::ceil(2 * level_nm / ground.pixel_nm()), 1.0, kMost - 1));
  Profile profile;
  for (int i = 0; i <= parts; ++i) {
    const double part = static_cast<double>(i) / parts;
    const double x = from_w_nm.x() + part * way.x();
    const double y = from_w_nm.y() + part * way.y();
    const double z = ground.height_w_nm(x, y);
    profile.lowest_w_nm = i == 0 ? z : std::min(profile.lowest_w_nm, z);
    profile.highest_w_nm = i == 0 ? z : std::max(profile.highest_w_nm, z);
    profile.points.push_back({part * level_nm, Vec3(x, y, z)});
  }
  return profile;
}

std::string profile_csv(const Profile& profile) {
  std::string out = fmt::format(
      "# profile of the surface as drawn, between two places\n# distance: {:.6g} nm level, {:.6g} nm "
      "straight\n"
      "# height difference: {:.6g} nm\n# lowest, highest: {:.6g}, {:.6g} nm\nalong_nm,x_nm,y_nm,z_nm\n",
      profile.level_nm(), profile.straight_nm(), profile.rise_nm(), profile.lowest_w_nm,
      profile.highest_w_nm);
  for (const Profile::Point& point : profile.points)
    out += fmt::format("{:.6g},{:.6g},{:.6g},{:.6g}\n", point.along_nm, point.pos_w_nm.x(),
                       point.pos_w_nm.y(), point.pos_w_nm.z());
  return out;
}

std::optional<Vec3> seen_at(const Ground& ground, const Camera& camera, const Vec3& origin_w_nm,
                            double exaggeration, double x_px, double y_px, double width_px,
                            double height_px) noexcept {
  const double tangent = std::tan(0.5 * camera.field_of_view_deg * kPi / 180);
  const double u = (2 * x_px / width_px - 1) * tangent * width_px / height_px;
  const double v = (1 - 2 * y_px / height_px) * tangent;
  const Vec3 ray = -camera.direction() + u * camera.right() + v * camera.up();
  if (!(ray.z() < -1e-6)) return std::nullopt;
  const Vec3 eye = camera.position_nm();
  // Between the planes of the highest and of the lowest height it meets the ground, or passes it.
  const auto scene_z = [&](double z_w_nm) { return (z_w_nm - origin_w_nm.z()) * exaggeration; };
  const auto world = [&](double t) {
    const Vec3 p = eye + t * ray;
    return Vec3(origin_w_nm.x() + p.x(), origin_w_nm.y() + p.y(), origin_w_nm.z() + p.z() / exaggeration);
  };
  const auto below = [&](double t) {
    const Vec3 p = world(t);
    const bool over = p.x() >= ground.min_w_nm().x() && p.x() <= ground.max_w_nm().x() &&
                      p.y() >= ground.min_w_nm().y() && p.y() <= ground.max_w_nm().y();
    return over && p.z() <= ground.height_w_nm(p.x(), p.y());
  };
  const double room = 0.02 * ground.relief_nm() + 1e-3;  // a spline goes a little beyond its heights
  const double first = std::max((scene_z(ground.max_w_nm().z() + room) - eye.z()) / ray.z(), 0.0);
  const double last = (scene_z(ground.min_w_nm().z() - room) - eye.z()) / ray.z();
  constexpr int kSteps = 500;
  for (int i = 1; i <= kSteps; ++i) {
    double low = first + (last - first) * (i - 1) / kSteps;
    double high = first + (last - first) * i / kSteps;
    if (!below(high)) continue;
    for (int half = 0; half < 40; ++half) {
      const double middle = 0.5 * (low + high);
      (below(middle) ? high : low) = middle;
    }
    return world(high);
  }
  return std::nullopt;
}

void Measurement::choose(const Vec3& pos_w_nm) noexcept {
  if (chosen_ == 0) from_w_nm_ = pos_w_nm;
  if (chosen_ == 1) to_w_nm_ = pos_w_nm;
  chosen_ = (chosen_ + 1) % 3;
}

std::optional<Profile> Measurement::profile(const Ground& ground, const Vec3& open_end_w_nm) const {
  if (chosen_ == 0) return std::nullopt;
  const Vec3& to = chosen_ == 1 ? open_end_w_nm : to_w_nm_;
  if (!is_finite(to) || !is_finite(from_w_nm_)) return std::nullopt;
  return profile_of(ground, from_w_nm_, to);
}

}  // namespace telenano::view_model
