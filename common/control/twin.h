#pragma once

#include "telenano/common/control/one_port.h"
#include "telenano/common/control/station_method.h"

namespace telenano::control {

/// `twin`: the server's slave, stepped at the station itself, without delay and at its own rate. What the
/// hand feels is that slave's own force: adhesion, friction, slopes, marks, whatever the scene has, at any
/// round trip. That it is the server's, to the bit, is proved by the caller, step by step
/// (station/twin_run.h).
///
/// *Energy.* The pre-commit clamp with the port's account, as every method that promises a bound
/// (passivity_controller.h), and the well: the most that the twin's own account has ever given beyond what was
/// put in, credited once, at most the well that the station has computed from the scene itself. What goes
/// into the sample is not debited. Debiting it too, E + s (Δout − Δin), looks stricter, but counts what the
/// twin felt and not what the hand did: wherever less is shown than computed (ramp, slew, force limit) and
/// the sample keeps it (friction, ploughing), the difference would be owed for good, and a deep furrow end
/// without force. The bound does not need it: out ≤ in + E₀ + well, whatever the server says, since its sums
/// are not asked.
class Twin final : public StationMethod {
 public:
  explicit Twin(const MethodConfig& config) noexcept
      : controller_(OnePort::with(Method::kTwin, config.passivity)) {}

  void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept override {
    controller_ = PassivityController(OnePort::with(Method::kTwin, config.passivity));
    controller_.take_over(account_j, hand_pos_h_m);
    force_h_n_.setZero();
    apart_h_n_.setZero();
  }
  void begin_session(bool) noexcept override {}
  void account_for(const PortInterval& interval) noexcept override { controller_.account_for(interval); }
  void on_reply(const SlaveNews& news) noexcept override { credit(news.given_j, news.well_j); }
  void feel(const LocalNews& news) noexcept override {
    // Where the slave was put into another state the force goes over slowly, up as well as down.
    if (news.other_state) apart_h_n_ = force_h_n_ - news.force_h_n;
    const double apart_n = apart_h_n_.norm();
    const double step_n = kGoOver_n_s * news.dt_s;
    if (apart_n > step_n) {
      apart_h_n_ *= 1 - step_n / apart_n;
    } else {
      apart_h_n_.setZero();
    }
    force_h_n_ = news.force_h_n + apart_h_n_;
    credit(news.given_j, news.well_j);
  }
  Vec3 force_h_n(const RenderPoint&) noexcept override { return force_h_n_; }
  Vec3 damper_force_h_n() const noexcept override { return controller_.damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return controller_.damper_n_s_m(); }
  double force_bound_n() const noexcept override { return controller_.force_bound_n(); }
  double account_j() const noexcept override { return controller_.account_j(); }

  static constexpr double kGoOver_n_s = 20;

 private:
  void credit(double given_j, double well_j) noexcept {
    const double more_j = std::min(given_j, well_j) - credited_j_;
    if (!(more_j > 0)) return;
    controller_.transfer(more_j);
    credited_j_ += more_j;
  }

  PassivityController controller_;
  Vec3 force_h_n_ = Vec3::Zero();
  Vec3 apart_h_n_ = Vec3::Zero();
};

}  // namespace telenano::control
