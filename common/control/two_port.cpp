#include "telenano/common/control/two_port.h"

#include <algorithm>

namespace telenano::control {

TwoPort::TwoPort(const MethodConfig& config) noexcept
    : damper_cap_n_s_m_(PassivityController(config.passivity).damper_cap_n_s_m()) {}

void TwoPort::take_over(double account_j, const MethodConfig& config, const Vec3&) noexcept {
  damper_cap_n_s_m_ = PassivityController(config.passivity).damper_cap_n_s_m();
  surplus_j_ = std::min(0.0, account_j);
  force_h_n_.setZero();
  damper_force_h_n_.setZero();
  damper_n_s_m_ = 0;
}

void TwoPort::begin_session(bool new_epoch) noexcept {
  if (new_epoch) surplus_j_ = std::min(0.0, surplus_j_);
}

void TwoPort::account_for(const PortInterval& interval) noexcept {
  // The damper's part of the force: what of it was applied after the limits, which only scale the sum down.
  const double damped_j =
      std::clamp(-damper_force_h_n_.dot(interval.displacement_h_m), 0.0, std::max(0.0, interval.put_in_j));
  const double net_j = interval.put_in_j - damped_j;
  if (net_j > 0) {
    sent_j_ += net_j;
  } else {
    surplus_j_ += net_j;
  }
  if (surplus_j_ < 0) surplus_j_ = std::min(0.0, surplus_j_ + damped_j);
  damper_n_s_m_ = 0;
  damper_force_h_n_.setZero();
  const double moved_m2 = interval.displacement_h_m.squaredNorm();
  if (!(surplus_j_ < 0) || !(moved_m2 > 0)) return;
  const double wanted_n_s_m = -surplus_j_ * interval.dt_s / moved_m2;
  damper_n_s_m_ = std::min(wanted_n_s_m, damper_cap_n_s_m_);
  damper_force_h_n_ = -damper_n_s_m_ / interval.dt_s * interval.displacement_h_m;
}

void TwoPort::on_reply(const SlaveNews& news) noexcept {
  force_h_n_ = news.force_h_n;
  surplus_j_ += news.energy_out_j;
}

}  // namespace telenano::control
