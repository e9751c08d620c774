#pragma once

#include <cmath>

#include "tests/support/port_account.h"
#include "tests/support/virtual_hand.h"

namespace telenano::support {

struct AccountedHandConfig {
  double period_s = 1e-3;
  double device_damping_n_s_m = 2;  ///< of the device between port and hand: certain, and reported as such
  double device_mass_kg = 0.25;     ///< reported
  double force_max_n = 12;          ///< on the norm of the vector
  double position_quantum_m = 0;    ///< of the encoder; 0 = none. The account is on the true position
  double velocity_max_m_s = 0.5;    ///< up to which a method promises anything
};

/// A hand along H z, without dry friction, that keeps the account of its own port. What was
/// promised, was promised to hands that stay below a velocity: with the first faster interval the account is
/// closed, that interval left out.
class AccountedHand : public VirtualHand {
 public:
  explicit AccountedHand(const AccountedHandConfig& config)
      : config_(config), account_(config.device_damping_n_s_m, config.period_s) {
    info_.name = "counted hand";
    info_.force_max_n = config.force_max_n;
    info_.position_quantum_m = config.position_quantum_m;
    info_.damping_n_s_m = config.device_damping_n_s_m;
    info_.mass_kg = config.device_mass_kg;
    info_.workspace_radius_m = 1;
  }

  const device::DeviceInfo& info() const noexcept override { return info_; }
  void read(device::DeviceReading& reading) noexcept override {
    reading.status = device::DeviceStatus::kOk;
    const double q_m = config_.position_quantum_m;
    const double z_m = q_m > 0 ? std::floor(pos_m() / q_m + 0.5) * q_m : pos_m();
    reading.hand_pos_h_m = Vec3(0, 0, z_m);
    reading.buttons = device::kButtonDeadman;
  }
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override {
    applied_h_n_ = is_finite(hand_force_h_n) ? hand_force_h_n : Vec3(Vec3::Zero());
    const double norm_n = applied_h_n_.norm();
    if (norm_n > config_.force_max_n) applied_h_n_ *= config_.force_max_n / norm_n;
    return applied_h_n_;
  }
  void advance(std::int64_t) noexcept override {
    const double from_m = static_cast<double>(pos_m_);
    pos_m_ = started_ ? next_pos_m(applied_h_n_.z()) : pos_m_;
    // What the station is told is a double; the account must see the very same positions.
    const double moved_m = static_cast<double>(pos_m_) - from_m;
    const double reach_m = config_.velocity_max_m_s * config_.period_s;
    if (moved_m > reach_m || moved_m < -reach_m) too_fast_ = true;
    if (!too_fast_) account_.add(applied_h_n_.z(), moved_m);
  }
  void start_motion() noexcept override { started_ = true; }

  const PortAccount& account() const noexcept { return account_; }
  bool too_fast() const noexcept { return too_fast_; }
  double pos_m() const noexcept { return static_cast<double>(pos_m_); }

 protected:
  /// Where the hand is a period later, with this force on it all the time.
  virtual long double next_pos_m(double force_n) noexcept = 0;
  const AccountedHandConfig& config() const noexcept { return config_; }

 private:
  AccountedHandConfig config_;
  device::DeviceInfo info_;
  PortAccount account_;
  long double pos_m_ = 0;
  Vec3 applied_h_n_ = Vec3::Zero();
  bool started_ = false;
  bool too_fast_ = false;
};

}  // namespace telenano::support
