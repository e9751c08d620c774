#include "telenano/master/device/task_change.h"

#include <algorithm>

namespace telenano::device {
namespace {

constexpr double kReachM_s = 0.15;   // greatest speed of the free hand; trips lie at 0.5
constexpr double kLoadedM_s = 0.05;  // with the tip in hand
constexpr double kLeastS = 0.2;      // of any way, so that the clutch is never a click
constexpr double kSettleS = 0.3;     // the hand comes to rest behind its intention
constexpr double kGripS = 0.25;      // the station's own ramp
constexpr double kFits = 0.9;        // of the box is used

double least_jerk(double tau) noexcept {
  return tau * tau * tau * (10 + tau * (-15 + 6 * tau));
}

}  // namespace

void TaskChange::enter(Phase phase, const Vec3& to_h_m, double speed_m_s) noexcept {
  constexpr double kPeakOverMean = 1.875;  // of the motion of least jerk
  phase_ = phase;
  from_h_m_ = pos_h_m_;
  to_h_m_ = to_h_m;
  elapsed_s_ = 0;
  phase_s_ = std::max(kLeastS, kPeakOverMean * (to_h_m - from_h_m_).norm() / speed_m_s);
}

/// Where the hand would have to be for its way to the start to take the tip to the start.
Vec3 TaskChange::wanted_h_m() const noexcept {
  return start_h_m_ + seen_.metres_per_nm * (seen_.target_nm - Vec3(0, 0, start_height_nm_));
}

void TaskChange::begin(const Vec3& intended_h_m) noexcept {
  pos_h_m_ = intended_h_m;
  const Vec3 reach = kFits * half_m_;
  enter(Phase::kReach, wanted_h_m().cwiseMax(-reach).cwiseMin(reach), kReachM_s);
}

void TaskChange::next() noexcept {
  const Vec3 up(pos_h_m_.x(), pos_h_m_.y(), std::max(pos_h_m_.z(), start_h_m_.z()));
  switch (phase_) {
    case Phase::kReach:
      phase_ = Phase::kSettle;
      elapsed_s_ = 0;
      phase_s_ = kSettleS;
      break;
    case Phase::kSettle:
      phase_ = Phase::kGrip;
      elapsed_s_ = 0;
      phase_s_ = kGripS;
      break;
    case Phase::kGrip:
      if (seen_.engaged) enter(Phase::kLift, up, kLoadedM_s);
      break;
    case Phase::kLift: {
      // Lifted as far as the box allows, but not out of the sample yet: another stroke.
      const double below_nm = start_height_nm_ - seen_.target_nm.z();
      constexpr double kEnough_nm = 1;
      if (below_nm > kEnough_nm) {
        begin(pos_h_m_);
      } else {
        enter(Phase::kOver, start_h_m_, kLoadedM_s);
      }
      break;
    }
    case Phase::kOver: {
      constexpr double kThereFraction = 0.02;  // of the box: what friction leaves the hand behind
      const Vec3 off = (wanted_h_m() - start_h_m_).cwiseQuotient(half_m_).cwiseAbs();
      if (off.maxCoeff() > kThereFraction) {
        begin(pos_h_m_);
      } else {
        phase_ = Phase::kNone;
      }
      break;
    }
    case Phase::kNone:
      break;
  }
}

void TaskChange::advance(double dt_s) noexcept {
  if (phase_ == Phase::kNone) return;
  const bool loaded = phase_ == Phase::kLift || phase_ == Phase::kOver;
  if (loaded && !seen_.engaged) {
    begin(pos_h_m_);
    return;
  }
  elapsed_s_ += dt_s;
  if (phase_ == Phase::kReach || loaded)
    pos_h_m_ = from_h_m_ + least_jerk(std::min(elapsed_s_ / phase_s_, 1.0)) * (to_h_m_ - from_h_m_);
  if (elapsed_s_ >= phase_s_) next();
}

}  // namespace telenano::device
