#pragma once

#include <array>

/// Independent integrator of one axis of device, friction, grip and arm, for tests only. It shares nothing
/// with the product: long double power series of the solution in each sub-step (recurrence from the
/// differential equation, no matrix exponential), friction events found on the series itself, energies as
/// exact integrals of the series' products.
namespace telenano::support {

struct PlantOracleConfig {
  long double device_mass_kg = 0.25L;
  long double device_damping_n_s_m = 2;
  long double coulomb_friction_n = 0;
  long double arm_mass_kg = 1.5L;
  long double arm_stiffness_n_m = 400;
  long double arm_damping_n_s_m = 34.3L;
  long double grip_stiffness_n_m = 3000;
  long double grip_damping_n_s_m = 5;
};

class PlantOracle {
 public:
  explicit PlantOracle(const PlantOracleConfig& config) : config_(config) {}

  void reset(long double pos_m);
  /// `period_s` with constant force and the intended position going to `intended_m` on a line.
  void advance(long double force_n, long double intended_m, long double period_s);

  long double pos_m() const { return device_pos_m_; }
  long double vel_m_s() const { return device_vel_m_s_; }
  long double arm_pos_m() const { return arm_pos_m_; }
  long double stored_j() const;

  // Integrals since reset:
  long double force_work_j = 0;     ///< ∫ F v dt, done by the commanded force on the device
  long double intent_work_j = 0;    ///< ∫ (arm spring and damper) u̇ dt, done by the operator's intention
  long double device_loss_j = 0;    ///< ∫ b v² dt
  long double friction_loss_j = 0;  ///< ∫ f_c |v| dt
  long double arm_loss_j = 0;       ///< grip and arm dampers
  int reversals = 0;

 private:
  static constexpr int kOrder = 24;
  using Series = std::array<long double, kOrder + 1>;
  struct Solution {
    Series device_pos{}, device_vel{}, arm_pos{}, arm_vel{};
  };
  /// sign: −1, 1 the direction of motion; 0 held in place
  Solution solve(int sign, long double force_n, long double intended_vel) const;
  int direction(long double force_n) const;
  long double net_held_n(const Solution& solution, long double t, long double force_n) const;
  void accept(const Solution& solution, int sign, long double t, long double force_n,
              long double intended_vel);

  PlantOracleConfig config_;
  long double device_pos_m_ = 0, device_vel_m_s_ = 0, arm_pos_m_ = 0, arm_vel_m_s_ = 0, intended_m_ = 0;
};

}  // namespace telenano::support
