#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"

namespace telenano::afm {

/// What the port is like around the tip, learned from readings while it touches: a plane and a stiffness.
///
///   F_z ≈ F₀ + K (z₀ − z) + B (x − x₀) + C (y − y₀)
///
/// about the newest reading, by weighted least squares over the last ones (weights fall with age and with the
/// distance across, since ground further away is other ground). With few readings, or ones at the same place,
/// K, B and C stay near what is known: a prior worth a handful of readings spread over kSpread_nm, which is
/// replaced only by readings that are spread four times as much. A hold at one place thus teaches nothing:
/// what moves there is drift. K is within the lever's stiffness, slopes within those that the operator
/// reckons with. Then in the terms of the station (link::LocalModel)
///
///   normal n ∝ (−B/K, −C/K, 1),   stiffness K/n_z²,   point = base + n F_z/(K_n n_z),
///
/// so that at the newest reading the model's force is the one that was read. Off the sample the model is
/// kept; a base that is free where the model has ground lowers it.
class TouchModel {
 public:
  /// `contact_nn`: less than that is no contact: the force's zero drifts as the lever bends with temperature.
  TouchModel(double lever_n_m, double noise_nn, double contact_nn, double slope_max) noexcept;

  void add(const Vec3& base_w_nm, double force_nn, std::int64_t time_ns) noexcept;
  void set_noise(double noise_nn) noexcept { noise_nn_ = noise_nn; }
  /// The next reading may be anywhere on another ground: stiffness and adhesion stay.
  void forget_place() noexcept;
  /// Also the stiffness, which a session may have taught wrongly: a touch's height is reckoned with it.
  void forget_stiffness() noexcept { stiffness_n_m_ = known_n_m_ = kFirstPart * lever_n_m_; }

  bool touching() const noexcept { return touching_; }
  /// Height above which a tip over (x, y) is free; of no meaning before the first touch.
  const link::LocalModel& model() const noexcept { return model_; }
  double stiffness_n_m() const noexcept { return stiffness_n_m_; }  ///< K
  double contact_threshold_nn() const noexcept {
    const double noise = 4 * noise_nn_ + 0.5;
    return noise > contact_nn_ ? noise : contact_nn_;
  }

  /// The model's force on the tip with its base there; adhesion only while it touches.
  Vec3 force_w_nn(const Vec3& base_w_nm) const noexcept;

  static constexpr double kSpread_nm = 0.2;
  static constexpr double kSlopeSpread_nm = 2;
  static constexpr double kReach_nm = 10;
  static constexpr double kMemory_s = 1.0;
  static constexpr double kFirstPart = 0.7;  ///< of the lever's stiffness, before anything is known

 private:
  struct Entry {
    Vec3 base_w_nm = Vec3::Zero();
    double force_nn = 0;
    std::int64_t time_ns = 0;
  };
  void fit() noexcept;
  void anchor(const Vec3& base_w_nm, double force_nn) noexcept;

  static constexpr std::size_t kKept = 48;
  double lever_n_m_;
  double noise_nn_;
  double contact_nn_;
  double slope_max_;
  std::array<Entry, kKept> entries_{};
  std::size_t count_ = 0;
  bool touching_ = false;
  double stiffness_n_m_;
  double known_n_m_;                                 // the prior
  Eigen::Vector2d slope_ = Eigen::Vector2d::Zero();  // dz/dx, dz/dy of the ground
  Eigen::Vector2d known_slope_ = Eigen::Vector2d::Zero();
  double adhesion_nn_ = 0;
  link::LocalModel model_;
};

}  // namespace telenano::afm
