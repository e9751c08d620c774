#include "telenano/common/control/model_method.h"

#include <algorithm>

namespace telenano::control {

ModelRenderer ModelMethod::renderer_for(const MethodConfig& config) noexcept {
  const PassivityConfig& p = config.passivity;
  return ModelRenderer(kStiffnessPart * 2 * p.damping_certain_n_s_m / p.period_s /
                       config.scaling.impedance());
}

ModelMethod::ModelMethod(const MethodConfig& config) noexcept
    : config_(config),
      controller_(OnePort::with(Method::kModel, config.passivity)),
      renderer_(renderer_for(config)) {}

void ModelMethod::take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept {
  config_ = config;
  controller_ = PassivityController(OnePort::with(Method::kModel, config.passivity));
  controller_.take_over(account_j, hand_pos_h_m);
  renderer_ = renderer_for(config);
  slave_force_h_n_.setZero();
  far_field_h_n_.setZero();
  slave_touches_ = other_slave_ = false;
}

void ModelMethod::begin_session(bool new_epoch) noexcept {
  renderer_.renumber();
  other_slave_ = other_slave_ || new_epoch;
}

void ModelMethod::on_reply(const SlaveNews& news) noexcept {
  slave_force_h_n_ = news.force_h_n;
  slave_touches_ = news.touching;
  if (other_slave_) renderer_.forget();
  other_slave_ = false;
  const double more_j = std::min(news.given_j, news.well_j) - credited_j_;
  if (more_j > 0) {
    controller_.transfer(more_j);
    credited_j_ += more_j;
  }
  renderer_.on_reply(news.model, news.touching, news.answers);
}

Vec3 ModelMethod::force_h_n(const RenderPoint& at) noexcept {
  if (!renderer_.has_model()) return slave_force_h_n_;
  const double stored_j = config_.scaling.hand_energy_j(renderer_.potential_aj(at.target_w_nm));
  const double there_is_j = controller_.account_j() + config_.passivity.allowance_j - stored_j;
  const double force_step_n = config_.model_slew_n_s * at.dt_s;
  const Vec3 near_h_n = config_.scaling.hand_force_n(renderer_.force_w_nn(
      at.target_w_nm, at.command, config_.scaling.tip_energy_aj(std::max(0.0, there_is_j)),
      force_step_n / config_.scaling.hand_force_n(Vec3::UnitX()).x()));
  const bool apart = !slave_touches_ && !renderer_.attached();
  const Vec3 wanted_h_n = apart ? slave_force_h_n_ : Vec3(Vec3::Zero());
  far_field_h_n_ += std::min(1.0, at.dt_s / kFarField_s) * (wanted_h_n - far_field_h_n_);
  return near_h_n + far_field_h_n_;
}

}  // namespace telenano::control
