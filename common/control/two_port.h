#pragma once

#include "telenano/common/control/station_method.h"

namespace telenano::control {

/// `tdpa`: two-port time-domain passivity [Ryu, Artigas, Preusche 2010; Artigas 2011], reactive. The link is
/// a two-port whose energy is split by direction; each side compares what it lets out with what the other is
/// known to have put in. At the station
///
///   W(k) = Σ received slave output − Σ own output + E_PC,   W < 0 → damper γ = −W T/|Δx|².
///
/// Input and output are the work of the force less the damper's part; what the damper dissipates repays a
/// deficit and is never new input. γ is capped as a sampled damper must be (γ ≤ b − KT/2 − |B|), the rest is
/// carried. No clamp: a reactive controller dissipates in the next interval, under a velocity that it does
/// not know, and so guarantees nothing to the joule; it is here as the field's baseline.
class TwoPort final : public StationMethod {
 public:
  explicit TwoPort(const MethodConfig& config) noexcept;

  void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept override;
  void begin_session(bool new_epoch) noexcept override;
  void account_for(const PortInterval& interval) noexcept override;
  void on_reply(const SlaveNews& news) noexcept override;
  Vec3 force_h_n(const RenderPoint&) noexcept override { return force_h_n_; }
  Vec3 damper_force_h_n() const noexcept override { return damper_force_h_n_; }
  double damper_n_s_m() const noexcept override { return damper_n_s_m_; }
  double account_j() const noexcept override { return surplus_j_; }
  void fill_command(SlaveOrder& order) const noexcept override {
    order = {};
    order.energy_sent_j = sent_j_;
  }

 private:
  double damper_cap_n_s_m_;
  Vec3 force_h_n_ = Vec3::Zero();
  double surplus_j_ = 0;  // W
  double sent_j_ = 0;     // own input, cumulative
  double damper_n_s_m_ = 0;
  Vec3 damper_force_h_n_ = Vec3::Zero();
};

}  // namespace telenano::control
