#pragma once

#include <memory>
#include <vector>

#include "tests/studies/stress/true_account.h"
#include "tests/support/virtual_hand.h"

namespace telenano::studies::stress {

struct HandConfig {
  double period_s = 1e-3;
  double damping_n_s_m = 2;  ///< of the device between port and hand: certain, and reported as such
  double mass_kg = 0.25;     ///< reported
  double force_max_n = 12;   ///< on the norm
  double quantum_m = 0;
  double velocity_max_m_s = 0.5;  ///< up to which a method promises anything
};

/// How a hand moves: it is told the force that acts until the next sample, and says where it then is.
class HandMotion {
 public:
  virtual ~HandMotion() = default;
  virtual Vec3 next(const Vec3& pos_h_m, const Vec3& force_h_n) noexcept = 0;
};

/// A device in a hand, with the account of its own port on true positions. With the first interval faster than
/// v_max the account is closed, that interval left out: nothing is promised beyond.
class StressHand final : public support::VirtualHand {
 public:
  StressHand(const HandConfig& config, std::unique_ptr<HandMotion> motion)
      : config_(config),
        motion_(std::move(motion)),
        account_(config.damping_n_s_m, config.period_s, config.quantum_m) {
    info_.name = "stress hand";
    info_.force_max_n = config.force_max_n;
    info_.position_quantum_m = config.quantum_m;
    info_.damping_n_s_m = config.damping_n_s_m;
    info_.mass_kg = config.mass_kg;
    info_.workspace_radius_m = 1;
  }

  const device::DeviceInfo& info() const noexcept override { return info_; }
  void read(device::DeviceReading& reading) noexcept override {
    reading.status = device::DeviceStatus::kOk;
    reading.hand_pos_h_m = encoder_h_m();
    reading.buttons = device::kButtonDeadman | held_;
  }
  /// device::ButtonBits besides the dead-man's.
  void hold_buttons(std::uint32_t buttons) noexcept { held_ = buttons; }
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override {
    applied_h_n_ = is_finite(hand_force_h_n) ? hand_force_h_n : Vec3(Vec3::Zero());
    const double norm_n = applied_h_n_.norm();
    if (norm_n > config_.force_max_n) applied_h_n_ *= config_.force_max_n / norm_n;
    return applied_h_n_;
  }
  void advance(std::int64_t) noexcept override {
    if (!started_) return;
    const Vec3 next_h_m = motion_->next(pos_h_m_, applied_h_n_);
    const Vec3 moved_m = next_h_m - pos_h_m_;
    pos_h_m_ = next_h_m;
    if (moved_m.norm() > config_.velocity_max_m_s * config_.period_s) too_fast_ = true;
    if (!too_fast_) account_.add(applied_h_n_, moved_m);
    if (keeps_path_) path_m_.push_back(pos_h_m_.z());
  }
  void start_motion() noexcept override { started_ = true; }

  void keep_path(std::size_t ticks) {
    keeps_path_ = true;
    path_m_.reserve(ticks);
  }
  const std::vector<double>& path_m() const noexcept { return path_m_; }
  const TrueAccount& account() const noexcept { return account_; }
  const Vec3& pos_h_m() const noexcept { return pos_h_m_; }
  Vec3 encoder_h_m() const noexcept {
    const double q_m = config_.quantum_m;
    Vec3 shown_h_m = pos_h_m_;
    if (q_m > 0) {
      for (double& x : shown_h_m) x = std::floor(x / q_m + 0.5) * q_m;
    }
    return shown_h_m;
  }
  std::uint32_t held_buttons() const noexcept { return held_; }      ///< as hold_buttons() was told
  const Vec3& applied_h_n() const noexcept { return applied_h_n_; }  ///< until the next tick
  bool started() const noexcept { return started_; }
  bool too_fast() const noexcept { return too_fast_; }

 private:
  HandConfig config_;
  std::unique_ptr<HandMotion> motion_;
  device::DeviceInfo info_;
  TrueAccount account_;
  Vec3 pos_h_m_ = Vec3::Zero();
  Vec3 applied_h_n_ = Vec3::Zero();
  std::uint32_t held_ = 0;
  bool started_ = false;
  bool too_fast_ = false;
  bool keeps_path_ = false;
  std::vector<double> path_m_;
};

}  // namespace telenano::studies::stress
