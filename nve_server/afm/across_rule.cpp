#include "telenano/nve_server/afm/across_rule.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::afm {
namespace {

constexpr double kSides[] = {1, -1};

}  // namespace

AcrossRule::AcrossRule(const Limits& limits) noexcept
    : limits_(limits), over_z_n_m_(0.5 * std::sqrt(limits.across_n_m * limits.lever_n_m)) {}

bool AcrossRule::held(const Since& since) const noexcept {
  return std::fabs(since.force_x_nn) > 0.5 * most_nn();
}

double AcrossRule::across_nn(double side, const Vec3& at, const Since& since) const noexcept {
  const double from_nm = std::min(side * since.low_w_nm.x(), side * since.high_w_nm.x());
  const double along_nm = std::max(since.high_w_nm.y() - at.y(), at.y() - since.low_w_nm.y());
  return limits_.across_n_m * (std::max(0.0, side * at.x() - from_nm) + 0.5 * std::max(0.0, along_nm));
}

Vec3 AcrossRule::allowed(const Vec3& base_w_nm, const Vec3& move_w_nm, const Since& since) const noexcept {
  const double down_nn = over_z_n_m_ * std::max(0.0, since.high_w_nm.z() - base_w_nm.z());
  Vec3 move(move_w_nm.x(), move_w_nm.y(), 0);
  // Along the lever as far as across it, whatever the force across is: nothing else bounds it.
  const double y_may_nm =
      kAcrossPart * most_nn() / limits_.across_n_m - (since.high_w_nm.y() - since.low_w_nm.y());
  double part = 1;
  if (std::fabs(move.y()) > 0) part = std::clamp(y_may_nm / std::fabs(move.y()), 0.0, 1.0);
  for (const bool both : {true, false}) {
    for (const double side : kSides) {
      // A force that pushes back along −σ is a negative one for σ = 1.
      const double left_nn = most_nn() + side * since.force_x_nn;
      const double now_nn = across_nn(side, base_w_nm, since);
      const double may_nn = std::min(kAcrossPart * left_nn, left_nn - down_nn) - now_nn;
      const double adds_nn =
          limits_.across_n_m * (std::max(0.0, side * move.x()) + 0.5 * std::fabs(move.y()));
      if (adds_nn > 0) part = std::min(part, std::clamp(may_nn / adds_nn, 0.0, 1.0));
    }
    if (part > 0 || !both || move.y() == 0) break;
    // Away from a wall goes what does not go along it.
    move.y() = 0;
    part = 1;
  }
  return part * move;
}

double AcrossRule::back_nm(const Vec3& base_w_nm, const Since& since) const noexcept {
  const double over_nn = std::fabs(since.force_x_nn) - most_nn();
  if (over_nn <= 0) return 0;
  // From where it was nearest to the reading's place: what it has gone back since then has not been read yet.
  const double way_nm = over_nn / limits_.across_n_m;
  return since.force_x_nn < 0 ? std::min(0.0, since.high_w_nm.x() - way_nm - base_w_nm.x())
                              : std::max(0.0, since.low_w_nm.x() + way_nm - base_w_nm.x());
}

double AcrossRule::lowest_nm(const Vec3& base_w_nm, const Since& since) const noexcept {
  double lowest_nm = -1e300;
  for (const double side : kSides) {
    const double left_nn = most_nn() + side * since.force_x_nn;
    const double may_nm = (left_nn - across_nn(side, base_w_nm, since)) / over_z_n_m_;
    lowest_nm = std::max(lowest_nm, std::min(since.high_w_nm.z() - may_nm, base_w_nm.z()));
  }
  return lowest_nm;
}

double AlongRule::force_down_nn(double adhesion_nn) const noexcept {
  if (!slope_known()) return std::numeric_limits<double>::infinity();
  const double m = limits_.slope;
  return (1 - limits_.part * m) * most_nn() / m - adhesion_nn;
}

double AlongRule::allowed_nm(double at_nm, double move_nm, double from_nm) const noexcept {
  if (slope_known()) return move_nm;
  const double low_nm = std::min(at_nm, from_nm - way_nm()), high_nm = std::max(at_nm, from_nm + way_nm());
  return std::clamp(at_nm + move_nm, low_nm, high_nm) - at_nm;
}

}  // namespace telenano::afm
