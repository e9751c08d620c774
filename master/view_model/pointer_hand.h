#pragma once

#include <cstdint>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/vec3.h"

namespace telenano::view_model {

/// The mouse as a hand: turns drags and the wheel into a position of the hand (frame H) such that the tip
/// keeps up with the cursor: a pixel moves the tip by what a pixel of that picture spans.
///
/// Gripping is the deadman: the left button or Space while held, and half a second after a turn of the wheel.
/// A window that loses the focus lets go.
///
/// The hand's box is small and the sample is large: letting go brings the hand back to the middle of its box
/// (the tip stands still meanwhile), and a new grip counts only once it is back there.
class PointerHand {
 public:
  /// Directions in frame W that right and up on the screen stand for.
  struct Axes {
    Vec3 right = Vec3::UnitX();
    Vec3 up = Vec3::UnitY();
    double nm_per_pixel = 1;
  };

  /// `half_m`: half the edge of the hand's box; `back_s`: the time in which it comes back to the middle.
  PointerHand(double half_m, double back_s) noexcept : half_m_(half_m), back_s_(back_s) {}

  /// α_v, to cross from the tip to the hand.
  void set_velocity_scale(double velocity_scale) noexcept;
  /// A hand without motors feels by the way that the pointer must go: the part of it that goes against the
  /// force on the tip leads the tip by 1/(1 + |F|/half) of what it else would; the rest, and the way back,
  /// whole. At `half_nn` the pointer goes twice as far. What is led is never more, so nothing leaps.
  void resist(const Vec3& force_w_nn, double half_nn) noexcept;
  /// How far the pointer must go against the force: 1: as far as the tip.
  double resistance() const noexcept { return resistance_; }
  void drag(double dx_px, double dy_px, const Axes& axes) noexcept;  ///< dy down, as screens count
  void turn_wheel(double notches, double nm_per_notch, double time_s) noexcept;

  void hold(bool held) noexcept { held_ = held; }
  /// Once a frame, after the events of that frame.
  void update(double time_s) noexcept;
  void clutch(bool held) noexcept { clutch_ = held; }
  void let_go() noexcept;

  const Vec3& hand_pos_h_m() const noexcept { return pos_h_m_; }
  /// Half the edge of the hand's box at the tip, nm: how far from the grip the tip can be led to any side.
  double reach_nm() const noexcept { return half_m_ * velocity_scale_ * kNmPerM; }
  /// Where the walls of the hand's box are for the tip: so far from where it is now, nm, frame W.
  Vec3 wall_below_nm() const noexcept;
  Vec3 wall_above_nm() const noexcept;
  bool gripped() const noexcept { return gripped_; }
  /// The hand is at the border of its box: the cursor has gone further than the tip follows.
  bool at_border() const noexcept { return gripped_ && (pos_h_m_.array().abs() >= half_m_).any(); }
  std::uint32_t buttons(double time_s) const noexcept;  ///< device::ButtonBits

 private:
  void move_tip(const Vec3& way_nm) noexcept;
  bool gripping(double time_s) const noexcept { return held_ || time_s < wheel_until_s_; }

  bool coming_back() const noexcept { return now_s_ < ready_s_; }

  double half_m_;
  double back_s_;
  double velocity_scale_ = 1e-6;
  double resistance_ = 1;
  Vec3 push_w_ = Vec3::Zero();  // direction of the force on the tip; zero: none
  Vec3 pos_h_m_ = Vec3::Zero();
  bool held_ = false;
  bool clutch_ = false;
  double wheel_until_s_ = -1e300;
  bool gripped_ = false;
  double now_s_ = -1e300;
  double ready_s_ = -1e300;  // from when on a new grip counts
};

inline constexpr double kWheelGripS = 0.5;

}  // namespace telenano::view_model
