#pragma once

#include <cstdint>

#include "telenano/common/base/vec3.h"

namespace telenano::physics {

/// Order of a guess for the next step.
enum class PathOrder : std::uint8_t { kNone, kParabola, kCubic };

/// How the apex of a balance goes on while its free end does: what lies beside p + (∂p/∂x) Δx.
///
/// Formula   Of a free end that moves by h a step, with the apex p and its rate p' h = (∂p/∂x) h known at the
///           ends of the last step: forward rest f = p − p₋ − p₋' h = p''h²/2 − p'''h³/3, backward rest b =
///           p₋ − p + p' h = p''h²/2 − p'''h³/6, both to third order and about p. So a further step of r h
///           has, beside p' r h, the rest
///             parabola  r² f                        error p''' h³/2 at r = 1
///             cubic     r² (2b − f) + r³ (b − f)    error p'''' h⁴/6 (Hermite's).
/// Choice    Of nothing, parabola and cubic the one that would have been best for the last step: over nodes
///           of a scan, where p'' steps, and in steps as long as a cell, the higher order is the worse one.
/// Validity  Steps of less than twice the last one's length, turned by less than 0.2 of it; else nothing. Any
///           guess is allowed: a wrong one costs time and nothing else.
struct PathTrend {
  Vec3 move_w_nm = Vec3::Zero();  ///< of the free end in the last step; 0: nothing to go by
  Vec3 forward_w_nm = Vec3::Zero();
  Vec3 backward_w_nm = Vec3::Zero();
  PathOrder order = PathOrder::kParabola;  ///< for the next step

  /// r for a step of `move`; 0 where it does not continue the last one.
  double part_of(const Vec3& move_w_nm_next) const noexcept {
    constexpr double kLonger = 2.0, kTurned = 0.2;
    const double last_sq = move_w_nm.squaredNorm();
    if (!(last_sq > 0.0)) return 0.0;
    const double part = move_w_nm_next.dot(move_w_nm) / last_sq;
    const double turned_sq = (move_w_nm_next - part * move_w_nm).squaredNorm();
    return part > 0.0 && part < kLonger && turned_sq < kTurned * kTurned * last_sq ? part : 0.0;
  }
  Vec3 parabola(double r) const noexcept { return (r * r) * forward_w_nm; }
  Vec3 cubic(double r) const noexcept {
    const Vec3 third = backward_w_nm - forward_w_nm;
    return (r * r) * (backward_w_nm + (1.0 + r) * third);
  }
  Vec3 guess(double r) const noexcept {
    if (order == PathOrder::kNone) return Vec3::Zero();
    return order == PathOrder::kCubic ? cubic(r) : parabola(r);
  }

  /// After a step of `move`, r times the last one, with these rests.
  void take(const Vec3& move, double r, const Vec3& forward, const Vec3& backward) noexcept {
    const double by_none = forward.squaredNorm();
    const double by_parabola = (forward - parabola(r)).squaredNorm();
    const double by_cubic = (forward - cubic(r)).squaredNorm();
    order = PathOrder::kParabola;
    if (r > 0.0) {
      if (by_cubic < by_parabola) order = PathOrder::kCubic;
      if (by_none < by_cubic && by_none < by_parabola) order = PathOrder::kNone;
    }
    move_w_nm = move;
    forward_w_nm = forward;
    backward_w_nm = backward;
  }
};

}  // namespace telenano::physics
