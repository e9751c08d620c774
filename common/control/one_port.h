#pragma once

#include "telenano/common/control/station_method.h"

namespace telenano::control {

/// `none`, `ks`, `ks-clamp`: shows the newest force of the slave; what is kept passive is the station's port
/// alone, so that nothing has to be known of link and slave (passivity_controller.h).
class OnePort final : public StationMethod {
 public:
  OnePort(Method method, const MethodConfig& config) noexcept : controller_(with(method, config.passivity)) {}

  void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept override {
    controller_ = PassivityController(with(controller_.config().method, config.passivity));
    controller_.take_over(account_j, hand_pos_h_m);
    force_h_n_.setZero();
  }
  void begin_session(bool) noexcept override {}
  void account_for(const PortInterval& interval) noexcept override { controller_.account_for(interval); }
  void on_reply(const SlaveNews& news) noexcept override { force_h_n_ = news.force_h_n; }
  Vec3 force_h_n(const RenderPoint&) noexcept override { return force_h_n_; }
  Vec3 damper_force_h_n() const noexcept override { return controller_.damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return controller_.damper_n_s_m(); }
  double force_bound_n() const noexcept override { return controller_.force_bound_n(); }
  double account_j() const noexcept override { return controller_.account_j(); }

  static PassivityConfig with(Method method, PassivityConfig config) noexcept {
    config.method = method;
    return config;
  }

 private:
  PassivityController controller_;
  Vec3 force_h_n_ = Vec3::Zero();
};

}  // namespace telenano::control
