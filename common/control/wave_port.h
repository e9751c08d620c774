#pragma once

#include "telenano/common/control/station_method.h"

namespace telenano::control {

/// `wave`: wave variables [Anderson & Spong 1989; Niemeyer & Slotine 1991]. With f = −F the force against +x,
///
///   u = (f + b_w v)/√(2 b_w) goes to the slave,  w = (f − b_w v)/√(2 b_w) comes back,  f v = ½u² − ½w²,
///
/// so the station shows f = b_w v + √(2 b_w) w, and no delay makes the link active. A wave
/// impedance is shown as a sampled damper, which is passive up to the device's own: b_w = b. Sampled, with
/// the energy kept exactly: at the end of an interval the wave that leaves has at most the energy
///
///   ½u²T ≤ f(k−1)·Δx(k) + ½w(k−1)²T + (what is owed from before, ≤ 0),
///
/// its direction and, as far as that allows, its size are the formula's. A wave that does not come is 0,
/// never the last one again. Sums of u T and of ½u²T travel: after a loss the sum brings the lost
/// displacement, and the sum of squares bounds the energy with which it may be played out. They travel in the
/// tip's units: with another scale they go on from the same number there.
class WavePort final : public StationMethod {
 public:
  explicit WavePort(const MethodConfig& config) noexcept;

  void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept override;
  void begin_session(bool new_epoch) noexcept override;
  void account_for(const PortInterval& interval) noexcept override;
  void on_reply(const SlaveNews& news) noexcept override;
  Vec3 force_h_n(const RenderPoint& at) noexcept override;
  double account_j() const noexcept override { return owed_j_; }
  void fill_command(SlaveOrder& order) const noexcept override;

 private:
  /// Of a device without certain damping: waves need some impedance, and every one is then active a little.
  static constexpr double kImpedanceLeast_n_s_m = 1e-3;
  static double impedance(const MethodConfig& config) noexcept;

  double impedance_n_s_m_;
  Scaling scaling_;
  Vec3 velocity_h_m_s_ = Vec3::Zero();
  Vec3 came_h_ = Vec3::Zero();  // Σ w T since the last tick
  double came_j_ = 0;           // energy that came and was not yet shown
  double shown_j_ = 0;          // energy of the wave that this interval's force was made from
  double owed_j_ = 0;           // ≤ 0
  Vec3 sum_h_ = Vec3::Zero();
  double sum_j_ = 0;
};

}  // namespace telenano::control
