#include "tests/studies/stress/wrong_slave.h"

#include <algorithm>
#include <cmath>

namespace telenano::studies::stress {
namespace {

constexpr double kTilt = 0.17453292519943295;  // 10°
constexpr double kPeriodS = 1e-3;

void mirror(double& value, double about) noexcept {
  value = 2 * about - value;
}

}  // namespace

void WrongSlave::before(const slave::SlaveLimits& limits, double dt_s, slave::SlaveInput& input) noexcept {
  Vec3& to = input.tip_target_pos_w_nm;
  Vec3& by = input.tip_target_vel_w_nm_s;
  const Vec3& start = limits.start_pos_w_nm;
  switch (mutant_) {
    case Mutant::kSlaveReversed:
      mirror(to.x(), start.x());
      by.x() = -by.x();
      return;
    case Mutant::kSlaveSwapped: {
      const Vec3 d = to - start;
      to = {start.x() + d.y(), start.y() + d.x(), to.z()};
      by = {by.y(), by.x(), by.z()};
      return;
    }
    case Mutant::kSlaveLow:
      to.z() += 3;
      return;
    case Mutant::kSlaveCreeping:
      to.z() -= std::min(1.0 * passed_s_, 5.0);
      return;
    case Mutant::kSlaveHoldsOn:
      if (!input.retract) return;
      input.retract = false;
      input.follow = false;
      return;
    case Mutant::kSlaveSlow:
      if (!input.retract || withdrawals_++ % 50 == 0) return;
      input.retract = false;
      input.follow = false;
      return;
    case Mutant::kSlaveGoesBack: {
      const Vec3 told = to;
      if (++steps_ % 50 == 0 && input.follow) to = before_w_nm_;
      before_w_nm_ = last_w_nm_;
      last_w_nm_ = told;
      return;
    }
    case Mutant::kSlaveDrifts:
      if (!input.follow || input.retract || !sums_) {
        summed_w_nm_ = to;
        sums_ = input.follow && !input.retract;
        return;
      }
      summed_w_nm_ += by * std::min(dt_s, kPeriodS);
      to = summed_w_nm_;
      return;
    case Mutant::kSlaveSoft:
      if (to.z() < limits.surface_z_w_nm) to.z() += 0.7 * (limits.surface_z_w_nm - to.z());
      return;
    default:
      return;
  }
}

Vec3 WrongSlave::wrong_force_w_nn(double dt_s, const slave::SlaveOutput& output) noexcept {
  const Vec3& right = output.force_w_nn;
  const bool touches = output.contact_state == link::ContactState::kContact;
  touching_s_ = touches ? touching_s_ + dt_s : 0;
  free_s_ = touches ? 0 : free_s_ + dt_s;
  switch (mutant_) {
    case Mutant::kSlaveTooStrong:
      return 1.5 * right;
    case Mutant::kSlaveNoForce:
      return Vec3::Zero();
    case Mutant::kSlaveHalfForce:
      return 0.5 * right;
    case Mutant::kSlaveLate: {
      const Vec3 then = late_[at_];
      late_[at_] = right;
      at_ = (at_ + 1) % late_.size();
      return then;
    }
    case Mutant::kSlaveNoAdhesion:
      return {right.x(), right.y(), std::max(right.z(), 0.0)};
    case Mutant::kSlaveNoFriction:
      return {0, 0, right.z()};
    case Mutant::kSlaveTilted:
      return {std::cos(kTilt) * right.x() + std::sin(kTilt) * right.z(), right.y(),
              std::cos(kTilt) * right.z() - std::sin(kTilt) * right.x()};
    case Mutant::kSlaveFrozen:  // the sensor: it says for ever what it said 0.3 s after touch
      if (touching_s_ > 0 && touching_s_ < 0.3) held_w_nn_ = right;
      return touching_s_ >= 0.3 ? held_w_nn_ : right;
    case Mutant::kSlaveLeaky:  // a charge amplifier: what stands still fades
      return touches ? Vec3(right * std::exp(-touching_s_ / 2)) : right;
    case Mutant::kSlaveSticky:  // pulls on for 0.2 s after it has let go
      if (touches) held_w_nn_ = right;
      return free_s_ < 0.2 ? held_w_nn_ : right;
    case Mutant::kSlaveCoarse:
      return {right.x(), right.y(), 5 * std::round(right.z() / 5)};
    case Mutant::kSlaveNoisy: {
      noise_ = noise_ * 6364136223846793005ull + 1442695040888963407ull;
      return (0.7 + 0.6 * 0x1p-53 * static_cast<double>(noise_ >> 11)) * right;
    }
    case Mutant::kSlaveSaturated:
      return right.norm() > 20 ? Vec3(right * (20 / right.norm())) : right;
    case Mutant::kSlaveUpsideDown:
      return {right.x(), right.y(), -right.z()};
    case Mutant::kSlaveStiff:
      return {right.x(), right.y(), right.z() > 0 ? 1.3 * right.z() : right.z()};
    case Mutant::kSlaveBlinking:
      return std::fmod(passed_s_, 0.5) < 0.03 ? Vec3(Vec3::Zero()) : right;
    default:
      return right;
  }
}

void WrongSlave::after(double dt_s, slave::SlaveOutput& output) noexcept {
  if (mutant_ == Mutant::kNone) return;
  passed_s_ += dt_s;
  output.force_w_nn = wrong_force_w_nn(dt_s, output);
  if (mutant_ == Mutant::kSlaveGivesUncounted) output.energy_out_aj *= 0.9;
  if (mutant_ == Mutant::kSlaveTakesUncounted) output.energy_in_aj *= 1.1;
  if (mutant_ == Mutant::kFallingSums && output.energy_in_aj > 0)
    output.energy_in_aj = std::max(0.0, output.energy_in_aj - output.energy_out_aj);
}

}  // namespace telenano::studies::stress
