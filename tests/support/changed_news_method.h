#pragma once

#include "telenano/common/control/methods.h"

/// For tests that make an account wrong, to see that it is found.
namespace telenano::support {

/// A method of control that is told of the sample's energy what a test makes of it, and is right otherwise.
class ChangedNewsMethod : public control::StationMethod {
 public:
  explicit ChangedNewsMethod(control::Method method) : methods_(method, control::MethodConfig{}) {}
  void take_over(double account_j, const control::MethodConfig& config, const Vec3& pos) noexcept override {
    right().take_over(account_j, config, pos);
  }
  void begin_session(bool new_epoch) noexcept override { right().begin_session(new_epoch); }
  void account_for(const control::PortInterval& interval) noexcept override { right().account_for(interval); }
  void on_reply(const control::SlaveNews& news) noexcept override {
    control::SlaveNews wrong = news;
    change(wrong.given_j, wrong.well_j);
    right().on_reply(wrong);
  }
  void feel(const control::LocalNews& news) noexcept override {
    control::LocalNews wrong = news;
    change(wrong.given_j, wrong.well_j);
    right().feel(wrong);
  }
  Vec3 force_h_n(const control::RenderPoint& at) noexcept override { return right().force_h_n(at); }
  Vec3 damper_force_h_n() const noexcept override { return right().damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return right().damper_n_s_m(); }
  double force_bound_n() const noexcept override { return right().force_bound_n(); }
  double account_j() const noexcept override { return right().account_j(); }
  void fill_command(control::SlaveOrder& order) const noexcept override { right().fill_command(order); }

 protected:
  virtual void change(double& given_j, double& well_j) const noexcept = 0;

 private:
  control::StationMethod& right() noexcept { return methods_.now(); }
  const control::StationMethod& right() const noexcept { return methods_.now(); }
  control::Methods methods_;
};

}  // namespace telenano::support
