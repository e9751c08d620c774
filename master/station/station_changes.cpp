#include "telenano/master/station/station.h"

#include <utility>

#include "telenano/common/control/scaling_plan.h"

namespace telenano::station {

void Station::change_method(control::Method method) noexcept {
  config_.method = method;
  method = usable(method);
  if (method == methods_.method()) return;
  methods_.change_to(method, method_config(), hand_pos_h_m_);
  if (has_reply_) update_method({}, 0);
  bump_ahead_ = true;
}

bool Station::change_scaling(const control::Scaling& scaling) noexcept {
  const control::Scaling old = config_.scaling;
  const bool sane = scaling.velocity >= kVelocityScaleMin && scaling.velocity <= kVelocityScaleMax &&
                    scaling.force >= kForceScaleMin && scaling.force <= kForceScaleMax;
  if (!sane) return false;
  config_.scaling = scaling;
  control::ScalingPlant plant;
  plant.device_damping_n_s_m = device_damping_n_s_m_;
  plant.coupling_stiffness_n_m = slave_.coupling_stiffness_n_m;
  plant.coupling_damping_n_s_m = slave_.coupling_damping_n_s_m;
  plant.period_s = period_s_;
  // What was planned for no delay may be changed so too, as long as the twin is felt and there is a way back.
  const double latency_samples = shows_twin() && config_.impedance_without_twin > 0 && !fades_
                                     ? config_.device_latency_s / period_s_
                                     : -1;
  const double delay = control::binding_delay(methods_.method(), 1, latency_samples);
  if (!config_.allow_unsafe_scaling && scaling.impedance() > control::exact_impedance_bound(plant, delay)) {
    config_.scaling = old;
    return false;
  }
  mapping_.rescale(scaling, hand_pos_h_m_);
  methods_.change_to(methods_.method(), method_config(), hand_pos_h_m_);
  if (has_reply_) {
    tip_force_h_n_ = scaling.hand_force_n(reply_.force_w_nn);
    update_method({}, 0);
  }
  bump_ahead_ = true;
  return true;
}

bool Station::change_companding(const control::CompandingConfig& companding) noexcept {
  const bool sane = companding.gain >= 1 && companding.gain <= kCompandingGainMax &&
                    companding.energy_aj >= 1e-3 && companding.energy_aj <= 1e4;
  if (!sane) return false;
  const bool same =
      companding.gain == config_.companding.gain && companding.energy_aj == config_.companding.energy_aj;
  config_.companding = companding;
  if (same) return true;
  if (twin_) twin_->compand(companding);
  bump_ahead_ = true;
  return true;
}

void Station::go_to_scene(const StationConfig& config, const SlavePort& slave, std::unique_ptr<TwinRun> twin,
                          std::uint64_t scene_hash) {
  config.validate();
  wells_.give(given_aj());  // what the twin has found, which goes
  config_ = config;
  slave_ = slave;
  twin_ = std::move(twin);
  if (twin_) twin_->compand(config_.companding);
  expected_scene_ = scene_hash;
  mapping_.rescale(config_.scaling, hand_pos_h_m_);
  // Nothing acts, and where the hand has gone meanwhile is not known.
  has_hand_pos_ = has_reply_ = false;
  reply_ = {};  // of the sample that is left
  applied_force_h_n_.setZero();
  commanded_force_h_n_.setZero();
  rendered_force_h_n_.setZero();
  tip_force_h_n_.setZero();
  left_by_twin_h_n_.setZero();
  leaves_twin_ = fades_ = old_ = false;
  ramp_ = 0;
  if (latched_ == 0) mode_ = Mode::kIdle;
  methods_.change_to(usable(config_.method), method_config(), hand_pos_h_m_);
}

}  // namespace telenano::station
