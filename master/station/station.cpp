#include "telenano/master/station/station.h"

#include <cmath>
#include <utility>

#include "telenano/common/base/renew.h"

namespace telenano::station {

Station::Station(const StationConfig& config, const device::DeviceInfo& device, const SlavePort& slave,
                 std::unique_ptr<control::StationMethod> stand_in)
    : config_((config.validate(), config)),
      slave_(slave),
      device_damping_n_s_m_(config.device_damping_n_s_m < 0 ? device.damping_n_s_m
                                                            : config.device_damping_n_s_m),
      position_quantum_m_(device.position_quantum_m),
      period_s_(1 / config.rate_hz),
      device_force_max_n_(device.force_max_n),
      force_limit_n_(config.force_safety * device.force_max_n),
      observer_(device.position_quantum_m),
      methods_(config.method, method_config()),
      mapping_(config.scaling) {
  methods_.stand_in(std::move(stand_in));
}

control::MethodConfig Station::method_config() const noexcept {
  control::MethodConfig method;
  control::PassivityConfig& passivity = method.passivity;
  passivity.period_s = period_s_;
  passivity.allowance_j = config_.allowance_j;
  passivity.velocity_max_m_s = config_.guaranteed_velocity_m_s;
  passivity.damping_certain_n_s_m = device_damping_n_s_m_;
  passivity.shown_stiffness_n_m = config_.scaling.impedance() * slave_.coupling_stiffness_n_m;
  passivity.shown_damping_n_s_m = config_.scaling.impedance() * slave_.coupling_damping_n_s_m;
  passivity.position_quantum_m = position_quantum_m_;
  passivity.damper = config_.damper;
  passivity.leak_time_s = config_.leak_time_s;
  passivity.store_max_j = config_.store_max_j;
  method.scaling = config_.scaling;
  return method;
}

void Station::step(const StationInput& input, double dt_s, StationOutput& output) noexcept {
  renew(output);
  faults_ = 0;
  const bool good_tick = dt_s > 0 && std::isfinite(dt_s);
  if (good_tick) {
    watch(input, dt_s);
    accept_reply(input);
    leave_twins_scale();
    choose_mode(input, dt_s);
    follow_a_retracted_tip();
    mapping_.update(mode_ == Mode::kEngaged, hand_pos_h_m_);
    step_slave(input, dt_s, output);
    last_tick_ns_ = input.time_ns;
    leave_twins_scale();
    if (fades_) {
      fade_to_new_scale(dt_s, output.trace);
    } else {
      render(input, dt_s, output.trace);
    }
    update_ramp(input, dt_s);
  } else {
    faults_ |= kFaultBadTick;
    ramp_ = 0;
  }
  StationTrace& trace = output.trace;
  trace.scaled_force_h_n = tip_force_h_n_;
  commanded_force_h_n_ = good_tick ? limited_force(dt_s, trace) : Vec3::Zero();
  output.hand_force_h_n = commanded_force_h_n_;
  fill(input, dt_s, output);
}

}  // namespace telenano::station
