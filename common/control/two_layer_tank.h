#pragma once

#include <algorithm>

#include "telenano/common/control/one_port.h"
#include "telenano/common/control/station_method.h"

namespace telenano::control {

/// `tank`: two layers [Franken, Stramigioli, Misra, Secchi, Macchelli 2011]. The upper layer shows the newest
/// force of the slave; the lower one owns a tank of energy on each side and lets neither side give out what
/// it has not got. The energy that the hand puts in travels with the command that it was put in by, so that
/// it is at the slave when the slave is to press; the slave sends back what the sample gives back and, over
/// kSurplusReturn_s, what it has not needed.
///
///   E(k) = E(k−1) − F(k−1)·Δx(k) + received − sent,   |F(k)| ≤ (E(k) + E₀)/(v_max T),
///
/// and E < 0 is repaid by the device's certain damping only (passivity_controller.h). Sent is the hand's
/// input of the interval as far as the tank has it.
///
/// The slave needs some energy to begin with: to press before the hand has felt anything to press against.
/// It is sent kSlavePart of an allowance, once in the station's life and never again to a slave that was
/// restarted; the rest is what its steps may cost that it could not foresee. So hand and slave together give
/// out at most what both put in, plus one allowance a side.
///
/// *What is believed.* An honest slave sends back no more than it was sent, and what its sample gives of its
/// own: at most the well that it said it has (SlaveNews::well_j). More is not believed, whatever comes; so a
/// server that lies in every sum gets two allowances and that well out of the hand's port, once; and of what
/// was put in before, the store (PassivityConfig::store_max_j) at this side and at the other.
class TwoLayerTank final : public StationMethod {
 public:
  explicit TwoLayerTank(const MethodConfig& config) noexcept
      : controller_(OnePort::with(Method::kTank, config.passivity)) {}

  void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept override {
    controller_ = PassivityController(OnePort::with(Method::kTank, config.passivity));
    controller_.take_over(account_j, hand_pos_h_m);
    force_h_n_.setZero();
    granted_ = granted_ || account_j < 0;  // who comes with a debt has had an allowance
  }
  void begin_session(bool) noexcept override {}
  void account_for(const PortInterval& interval) noexcept override {
    controller_.account_for(interval);
    const double send_j = std::min(std::max(0.0, interval.put_in_j), std::max(0.0, controller_.account_j()));
    controller_.transfer(-send_j);
    sent_j_ += send_j;
    // What is in the slave's tank beyond the store is not believed when it comes back.
    credited_j_ = std::max(credited_j_ - send_j, -controller_.config().store_max_j);
  }
  void on_reply(const SlaveNews& news) noexcept override {
    force_h_n_ = news.force_h_n;
    const double believed_j =
        std::clamp(news.energy_sent_j, 0.0, std::max(0.0, news.well_j + grant_j_ - credited_j_));
    controller_.transfer(believed_j);
    credited_j_ += believed_j;
    // Not in a session's first command: what stands there is where the session's sum begins.
    if (!granted_) sent_j_ += grant_j_ = kSlavePart * controller_.config().allowance_j;
    granted_ = true;
  }
  Vec3 force_h_n(const RenderPoint&) noexcept override { return force_h_n_; }
  Vec3 damper_force_h_n() const noexcept override { return controller_.damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return controller_.damper_n_s_m(); }
  double force_bound_n() const noexcept override { return controller_.force_bound_n(); }
  double account_j() const noexcept override { return controller_.account_j(); }
  void fill_command(SlaveOrder& order) const noexcept override {
    order = {};
    order.energy_sent_j = sent_j_;
  }

 private:
  static constexpr double kSlavePart = 0.7;

  PassivityController controller_;
  bool granted_ = false;
  double grant_j_ = 0;  // what the slave was given to begin with
  Vec3 force_h_n_ = Vec3::Zero();
  double sent_j_ = 0;
};

}  // namespace telenano::control
