#include "telenano/master/view_model/pointer_hand.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::view_model {

void PointerHand::set_velocity_scale(double velocity_scale) noexcept {
  if (velocity_scale > 0 && std::isfinite(velocity_scale)) velocity_scale_ = velocity_scale;
}

void PointerHand::resist(const Vec3& force_w_nn, double half_nn) noexcept {
  const double size_nn = force_w_nn.norm();
  const bool known = std::isfinite(size_nn) && size_nn > 0 && half_nn > 0;
  resistance_ = known ? 1 + size_nn / half_nn : 1;
  push_w_ = known ? Vec3(force_w_nn / size_nn) : Vec3(Vec3::Zero());
}

Vec3 PointerHand::wall_below_nm() const noexcept {
  return (Vec3::Constant(-half_m_) - pos_h_m_) * (velocity_scale_ * kNmPerM);
}

Vec3 PointerHand::wall_above_nm() const noexcept {
  return (Vec3::Constant(half_m_) - pos_h_m_) * (velocity_scale_ * kNmPerM);
}

void PointerHand::move_tip(const Vec3& way_nm) noexcept {
  const double against_nm = std::min(way_nm.dot(push_w_), 0.0);
  const Vec3 tip_nm = way_nm - push_w_ * (against_nm * (1 - 1 / resistance_));
  const Vec3 moved = pos_h_m_ + tip_nm / (velocity_scale_ * kNmPerM);
  if (is_finite(moved)) pos_h_m_ = moved.cwiseMax(-half_m_).cwiseMin(half_m_);
}

void PointerHand::drag(double dx_px, double dy_px, const Axes& axes) noexcept {
  if (coming_back()) return;
  move_tip(axes.nm_per_pixel * (dx_px * axes.right - dy_px * axes.up));
}

void PointerHand::turn_wheel(double notches, double nm_per_notch, double time_s) noexcept {
  if (!coming_back()) move_tip(notches * nm_per_notch * Vec3::UnitZ());
  wheel_until_s_ = time_s + kWheelGripS;
}

void PointerHand::update(double time_s) noexcept {
  now_s_ = time_s;
  const bool grip = gripping(time_s);
  if (gripped_ && !grip) {
    pos_h_m_ = Vec3::Zero();
    ready_s_ = time_s + back_s_;
  }
  gripped_ = grip;
}

void PointerHand::let_go() noexcept {
  held_ = false;
  clutch_ = false;
  wheel_until_s_ = -1e300;
}

std::uint32_t PointerHand::buttons(double time_s) const noexcept {
  std::uint32_t bits = 0;
  if (gripping(time_s) && time_s >= ready_s_) bits |= device::kButtonDeadman;
  if (clutch_) bits |= device::kButtonClutch;
  return bits;
}

}  // namespace telenano::view_model
