#pragma once

#include <array>
#include <cstdint>

#include "telenano/common/base/vec3.h"

namespace telenano::device {

/// Simulated haptic device and the passive arm of its operator, per axis:
///
///   m_d ẍ_d = F − b_d ẋ_d − f_c sgn ẋ_d + k_g (x_a − x_d) + c_g (ẋ_a − ẋ_d)
///   m_a ẍ_a = − k_g (x_a − x_d) − c_g (ẋ_a − ẋ_d) + k_a (u − x_a) + c_a (u̇ − ẋ_a)
///
/// The first is the device, F held between samples; the second the arm behind its grip. u is the motion that
/// the operator intends, linear between samples. Everything but u is passive.
struct PlantConfig {
  double period_s = 1e-3;

  // Device. Force Dimension publishes force, workspace and resolution of the omega.3, not mass, damping or
  // friction: those are assumptions of the size that is reported for delta-type devices.
  double device_mass_kg = 0.25;
  double device_damping_n_s_m = 2.0;
  double coulomb_friction_n = 0.02;
  double force_max_n = 12.0;                   ///< on the norm of the vector
  double force_quantum_n = 0;                  ///< of the command; 0 = none
  double position_quantum_m = 1e-5;            ///< of the encoder; 0 = none
  Vec3 workspace_half_m{0.080, 0.080, 0.055};  ///< inelastic stops; a box around the Ø160 × 110 mm cylinder

  // Arm of an operator who holds the handle firmly. Measured arms are second-order systems of about 0.5–2 kg,
  // 100–500 N/m and near-critical damping [Hogan 1985; Dolan, Friedman & Nagurka 1993; Tsuji et al. 1995; van
  // Beek et al. 2015], behind a grip that is an order of magnitude stiffer [structure: Fu & Cavusoglu 2012].
  // The values are a choice within these ranges, not a measurement.
  double arm_mass_kg = 1.5;
  double arm_stiffness_n_m = 400.0;
  double arm_damping_n_s_m = 34.3;  ///< ζ = 0.7
  double grip_stiffness_n_m = 3000.0;
  double grip_damping_n_s_m = 5.0;

  /// Throws UserError naming the key, its value and the range.
  void validate() const;
};

/// One axis, exact between samples: with the friction force constant the system is linear, and its solution
/// over a sample is a matrix exponential (computed at construction). Reversals, sticking, release and end
/// stops are located within a sample to T/2³² by halving, with exponentials for T/2ⁿ from the same
/// construction.
///
/// Assumption: within one T/2ⁿ sub-step the velocity has at most one extremum, and a stuck or stopped handle
/// is released at most once; true when the system's fastest mode is slow against T, as hands and devices are.
class AxisPlant {
 public:
  /// x_d, v_d, x_a, v_a, u, u̇, f (sum of the forces on the device that are constant in an interval, F −
  /// friction)
  static constexpr int kStates = 7;
  using State = std::array<double, kStates>;

  AxisPlant(const PlantConfig& config, double stop_half_m);

  /// Everything at rest at `pos_m`.
  void reset(double pos_m) noexcept;
  /// One period with the device's force held and the intended motion going on a line to `intended_pos_m`.
  void advance(double force_n, double intended_pos_m) noexcept;

  double pos_m() const noexcept { return state_[0]; }
  double vel_m_s() const noexcept { return state_[1]; }
  double arm_pos_m() const noexcept { return state_[2]; }
  double arm_vel_m_s() const noexcept { return state_[3]; }
  double intended_pos_m() const noexcept { return state_[4]; }
  /// Kinetic and elastic energy of device, grip and arm.
  double stored_j() const noexcept;
  std::uint64_t events() const noexcept { return events_; }
  std::uint64_t evaluations() const noexcept {
    return evaluations_;
  }  ///< of a sub-step, what time is spent on

 private:
  static constexpr int kLevels = 33;  // T/2⁰ … T/2³²
  using Matrix = std::array<double, std::size_t{kStates} * kStates>;
  enum class Phase : std::uint8_t { kFree, kForward, kBackward, kStuck };
  enum class Verdict : std::uint8_t { kGood, kCrossed, kMayDip };  // of a sub-step that assumes one phase

  static State apply(const Matrix& matrix, const State& state) noexcept;
  double acceleration(const State& state) const noexcept;
  double held_force_n(const State& state, double force_n) const noexcept;
  Phase phase_for(const State& state, double force_n) const noexcept;
  Verdict judge(Phase phase, const State& from, const State& to, double force_n,
                double step_s) const noexcept;
  double friction_n(Phase phase) const noexcept;

  PlantConfig config_;
  double stop_m_;
  std::array<Matrix, kLevels> moving_;
  std::array<Matrix, kLevels> stuck_;
  State state_{};
  std::uint64_t events_ = 0;
  std::uint64_t evaluations_ = 0;
};

/// Three axes and the device's electronics.
class Plant {
 public:
  explicit Plant(const PlantConfig& config);

  void reset(const Vec3& pos_m) noexcept;
  /// What the device does with a command: quantisation, then saturation of the norm.
  Vec3 applied_force_n(const Vec3& commanded_n) const noexcept;
  void advance(const Vec3& applied_n, const Vec3& intended_pos_m) noexcept;

  Vec3 pos_m() const noexcept;
  Vec3 vel_m_s() const noexcept;
  Vec3 encoder_pos_m() const noexcept;  ///< pos_m to the nearest quantum
  double stored_j() const noexcept;
  const PlantConfig& config() const noexcept { return config_; }

 private:
  PlantConfig config_;
  std::array<AxisPlant, 3> axes_;
};

}  // namespace telenano::device
