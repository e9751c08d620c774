#pragma once

#include <array>
#include <optional>

#include "tests/support/accounted_hand.h"

namespace telenano::support {

/// A device in a hand without any loss of its own:
///
///   m ẍ_d = F − b ẋ_d − k_g (x_d − x_a)        M ẍ_a = k_g (x_d − x_a) − k_a (x_a − u)
///
/// F and the place u on which the arm's spring stands are constant between samples; u may be moved. Apart
/// from u it is passive, and what grows in it has come out of the port.
struct MassSpringConfig {
  AccountedHandConfig port{};
  double arm_mass_kg = 1;
  double grip_stiffness_n_m = 1000;
  double arm_stiffness_n_m = 400;
  double goal_m = -0.010;        ///< where u goes …
  double goal_speed_m_s = 0.05;  ///< … at this speed
  /// Where there has been no force for 0.1 s, u goes on down to here: who leans on something that gives way,
  /// or that is somewhere else after an outage, follows it.
  double lowest_goal_m = -0.010;

  /// Grip stiffness at which device and arm swing against each other with this frequency: k = μω², 1/μ = 1/m
  /// + 1/M
  static double grip_for_hz(double hz, double device_mass_kg, double arm_mass_kg);
};

/// Exact between samples by the matrix exponential, in long double.
class MassSpringHand final : public AccountedHand {
 public:
  explicit MassSpringHand(const MassSpringConfig& config);

  /// From now on u goes there, up or down, and nowhere else.
  void go_to(double place_m) noexcept { place_m_ = place_m; }
  /// Kinetic and elastic energy.
  long double stored_j() const noexcept;

 protected:
  long double next_pos_m(double force_n) noexcept override;

 private:
  static constexpr int kStates = 6;  // x_d, v_d, x_a, v_a, F, u
  using Matrix = std::array<std::array<long double, kStates>, kStates>;

  MassSpringConfig config_;
  Matrix propagator_{};
  std::array<long double, kStates> state_{};
  double unfelt_s_ = 0;
  std::optional<double> place_m_;
};

}  // namespace telenano::support
