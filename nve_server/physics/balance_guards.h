#pragma once

#include <cmath>

#include "common/base/vec3.h"

/// What keeps Newton's method of tip_equilibrium.cpp from going round in circles.
namespace telenano::physics {

/// The radius that the law is given: that of the foot. On a rough surface the foot wanders far for a small
/// motion of the tip, most of all in a pit nearly as narrow as the tip, and the radius with it: giving the
/// law each new foot's radius can swing for ever. So after kFree updates the radius goes only part of the
/// way, less at each turn, and after kUpdates it stays; the next step goes on from there.
class RadiusIteration {
 public:
  double next(double found_nm) noexcept {
    if (count_ < kFree) {
      last_change_ = found_nm - given_;
      given_ = found_nm;
    } else if (!settled(found_nm)) {
      const double change = found_nm - given_;
      if (change * last_change_ < 0.0) weight_ *= 0.5;
      given_ += weight_ * change;
      last_change_ = change;
    }
    ++count_;
    return given_;
  }
  bool settled(double found_nm) const noexcept {
    return count_ >= kUpdates || std::abs(found_nm - given_) < kDone * given_;
  }

 private:
  static constexpr int kFree = 8;
  static constexpr int kUpdates = 24;
  static constexpr double kDone = 1e-11;  // the force follows the radius, and so would the energy of a loop
  int count_ = 0;
  double given_ = 0.0;
  double weight_ = 1.0;
  double last_change_ = 0.0;
};

/// Newton's method between two places that send it to each other: in a pit nearly as narrow as the tip the
/// foot swings from one side to the other within a fraction of a nanometre, and with it the normal, and from
/// neither side does Newton see the steep stretch between. So when a step turns back on the one before, the
/// place between is sought (by halving) where it does not, and Newton goes on from there, with that place's
/// own, steep, slope.
class Swing {
 public:
  /// Takes the step found at p; changes it to where to go instead. True while a swing is being searched.
  bool guard(const Vec3& p, Vec3& step) noexcept {
    if (searching_) {
      const double along = step.dot(direction_);
      if (std::abs(along) < kTurnedBack * direction_.squaredNorm() || ++halvings_ == kHalvings) {
        searching_ = false;
      } else {
        (along > 0.0 ? low_ : high_) = at_;
        at_ = 0.5 * (low_ + high_);
        step = origin_ + at_ * direction_ - p;
        return true;
      }
    } else if (armed_ && step.norm() > kLeast &&
               step.dot(direction_) < -kTurnedBack * direction_.squaredNorm()) {
      searching_ = true;
      halvings_ = 0;
      low_ = 0.0;
      high_ = 1.0;
      at_ = 0.5;
      step = origin_ + at_ * direction_ - p;
      return true;
    }
    armed_ = true;
    origin_ = p;
    direction_ = step;
    return false;
  }
  void forget() noexcept { armed_ = searching_ = false; }

 private:
  static constexpr double kTurnedBack = 0.3;
  static constexpr double kLeast = 1e-5;  // nm: shorter swings are rounding
  static constexpr int kHalvings = 12;
  bool armed_ = false;
  bool searching_ = false;
  int halvings_ = 0;
  double low_ = 0, high_ = 1, at_ = 0;
  Vec3 origin_ = Vec3::Zero();
  Vec3 direction_ = Vec3::Zero();
};

}  // namespace telenano::physics
