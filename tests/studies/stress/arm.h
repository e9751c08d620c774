#pragma once

#include <array>

namespace telenano::studies::stress {

/// One axis of a device held by an arm, for studies: its own integrator, no code of the simulated device's.
///
///   m ẍ_d = F − b ẋ_d + k_g (x_a − x_d) + c_g (ẋ_a − ẋ_d)
///   M ẍ_a =            − k_g (x_a − x_d) − c_g (ẋ_a − ẋ_d) + k_a (u − x_a) + c_a (u̇ − ẋ_a)
///
/// F constant and u on a line between samples: exact by the matrix exponential, long double. No dry friction,
/// so that no loss but b is certain. Apart from u it is passive.
struct ArmConfig {
  double period_s = 1e-3;
  double device_mass_kg = 0.25;
  double device_damping_n_s_m = 2;
  double arm_mass_kg = 1.5;
  double arm_stiffness_n_m = 400;
  double arm_damping_n_s_m = 34.3;
  double grip_stiffness_n_m = 3000;
  double grip_damping_n_s_m = 5;
};

class ArmAxis {
 public:
  explicit ArmAxis(const ArmConfig& config);

  /// A period with this force, u going to `aim_m`.
  void advance(double force_n, double aim_m) noexcept;
  double pos_m() const noexcept { return static_cast<double>(state_[0]); }
  long double stored_j() const noexcept;  ///< kinetic and elastic

 private:
  static constexpr int kStates = 7;  // x_d, v_d, x_a, v_a; given anew in each period u, u̇, F
  using Matrix = std::array<std::array<long double, kStates>, kStates>;

  ArmConfig config_;
  Matrix propagator_{};
  std::array<long double, kStates> state_{};
};

}  // namespace telenano::studies::stress
