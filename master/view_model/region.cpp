#include "telenano/master/view_model/region.h"

#include <algorithm>
#include <cmath>

namespace telenano::view_model {
namespace {

MapBox box_about(const Ground& ground, const Vec3& middle_w_nm, double wide_nm, double deep_nm) noexcept {
  const Vec3& low = ground.min_w_nm();
  const Vec3& high = ground.max_w_nm();
  const double x =
      std::clamp(middle_w_nm.x() - 0.5 * wide_nm, low.x(), std::max(low.x(), high.x() - wide_nm));
  const double y =
      std::clamp(middle_w_nm.y() - 0.5 * deep_nm, low.y(), std::max(low.y(), high.y() - deep_nm));
  return {x, x + wide_nm, y, y + deep_nm};
}

bool is_place(const Vec3& pos_w_nm) noexcept {
  return std::isfinite(pos_w_nm.x()) && std::isfinite(pos_w_nm.y());
}

}  // namespace

bool Region::narrow(const Ground& ground, const Vec3& middle_w_nm, double least_nm) noexcept {
  const double wide_nm = (box_ ? box_->width_nm() : ground.width_nm()) / kNarrower;
  const double deep_nm = (box_ ? box_->depth_nm() : ground.depth_nm()) / kNarrower;
  const double fewest_nm = ground.is_scan() ? kLeastPixels * ground.pixel_nm() : 0;
  if (!is_place(middle_w_nm) || std::max(wide_nm, deep_nm) < std::max(least_nm, fewest_nm)) {
    whole();
    return false;
  }
  box_ = box_about(ground, middle_w_nm, wide_nm, deep_nm);
  had_tip_ = true;
  return true;
}

void Region::move_to(const Ground& ground, const Vec3& middle_w_nm) noexcept {
  if (!box_ || !is_place(middle_w_nm)) return;
  box_ = box_about(ground, middle_w_nm, box_->width_nm(), box_->depth_nm());
  had_tip_ = false;
}

bool Region::follow(const Ground& ground, const Vec3& tip_w_nm) noexcept {
  if (!box_) return false;
  const bool had = had_tip_;
  had_tip_ = box_->contains(tip_w_nm);
  if (had_tip_ || !had || !is_place(tip_w_nm)) return false;
  const MapBox before = *box_;
  box_ = box_about(ground, tip_w_nm, before.width_nm(), before.depth_nm());
  // A tip beside the sample: the region waits at the border for it.
  had_tip_ = true;
  return before.x_min_nm != box_->x_min_nm || before.y_min_nm != box_->y_min_nm;
}

}  // namespace telenano::view_model
