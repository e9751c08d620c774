#include "telenano/common/control/wave_port.h"

#include <algorithm>
#include <cmath>

namespace telenano::control {

WavePort::WavePort(const MethodConfig& config) noexcept
    : impedance_n_s_m_(impedance(config)), scaling_(config.scaling) {}

double WavePort::impedance(const MethodConfig& config) noexcept {
  return std::max(config.passivity.damping_certain_n_s_m, kImpedanceLeast_n_s_m);
}

void WavePort::take_over(double account_j, const MethodConfig& config, const Vec3&) noexcept {
  impedance_n_s_m_ = impedance(config);
  // What was sent was sent at its own scale.
  const double by = scaling_.tip_energy_aj(1) / config.scaling.tip_energy_aj(1);
  if (by != 1) {
    sum_h_ *= std::sqrt(by);
    sum_j_ *= by;
  }
  scaling_ = config.scaling;
  owed_j_ = std::min(0.0, account_j);
  velocity_h_m_s_.setZero();
  came_h_.setZero();
  came_j_ = shown_j_ = 0;
}

void WavePort::begin_session(bool) noexcept {
  came_h_.setZero();
  came_j_ = 0;
}

void WavePort::account_for(const PortInterval& interval) noexcept {
  velocity_h_m_s_ = interval.displacement_h_m / interval.dt_s;
  const double may_send_j = interval.put_in_j + shown_j_ + owed_j_;
  shown_j_ = 0;
  owed_j_ = std::min(0.0, may_send_j);
  const Vec3 wave_h =
      (impedance_n_s_m_ * velocity_h_m_s_ - interval.applied_force_h_n) / std::sqrt(2 * impedance_n_s_m_);
  const double wave_j = 0.5 * wave_h.squaredNorm() * interval.dt_s;
  if (!(may_send_j > 0) || !(wave_j > 0)) return;
  const double part = std::min(1.0, std::sqrt(may_send_j / wave_j));
  sum_h_ += part * interval.dt_s * wave_h;
  sum_j_ += part * part * wave_j;
}

void WavePort::on_reply(const SlaveNews& news) noexcept {
  came_h_ += news.wave_h;
  came_j_ += news.wave_j;
}

Vec3 WavePort::force_h_n(const RenderPoint& at) noexcept {
  Vec3 wave_h = came_h_ / at.dt_s;
  const double wave_j = 0.5 * wave_h.squaredNorm() * at.dt_s;
  if (wave_j > came_j_) wave_h *= std::sqrt(std::max(0.0, came_j_) / wave_j);
  shown_j_ = std::min(wave_j, came_j_);
  came_h_.setZero();
  came_j_ = 0;
  return -(impedance_n_s_m_ * velocity_h_m_s_ + std::sqrt(2 * impedance_n_s_m_) * wave_h);
}

void WavePort::fill_command(SlaveOrder& order) const noexcept {
  order = {};
  order.wave_sum_h = sum_h_;
  order.wave_j = sum_j_;
  order.wave_impedance_n_s_m = impedance_n_s_m_;
}

}  // namespace telenano::control
