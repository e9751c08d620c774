#include "telenano/master/station/station.h"

#include <cmath>

namespace telenano::station {

std::uint32_t Station::command_flags(const StationInput& input) const noexcept {
  std::uint32_t flags = 0;
  // The slave of a shared tip that is up brings it back for an operator who wants to engage. It follows
  // nothing until then. (A private one needs no word, and would go back to where it was a round trip ago.)
  if (mode_ == Mode::kEngaged || (waits_for_tip_ && shares_tip())) flags |= link::kFlagClutch;
  if (!config_.require_deadman || (input.buttons & device::kButtonDeadman)) flags |= link::kFlagDeadman;
  if (mode_ == Mode::kStopped) flags |= link::kFlagStop;
  return flags;
}

/// What the slave has to know of the method; of those of the station's port alone no more than the scale, so
/// that it knows at which one something was pressed when another method follows.
void Station::fill_port_control(link::Command& command) const noexcept {
  const control::Method method = methods_.method();
  const bool asks_slave = control::needs_port_control(method) || method == control::Method::kModel ||
                          method == control::Method::kTwin;
  if (!(features_ & link::kFeaturePortControl)) return;
  const double scale_aj_j = config_.scaling.tip_energy_aj(1);
  command.control.energy_scale_aj_j = scale_aj_j;
  if (!asks_slave) return;
  control::SlaveOrder order;
  methods_.now().fill_command(order);
  command.control.method = static_cast<std::uint32_t>(method);
  command.control.energy_sent_j = order.energy_sent_j;
  command.control.wave_sum = order.wave_sum_h * std::sqrt(scale_aj_j);
  command.control.wave_energy_aj = order.wave_j * scale_aj_j;
  command.control.wave_impedance_n_s_m = order.wave_impedance_n_s_m / config_.scaling.impedance();
}

void Station::fill(const StationInput& input, double dt_s, StationOutput& output) noexcept {
  const Vec3& target_w_nm = mapping_.target_w_nm();
  const bool good_tick = !(faults_ & kFaultBadTick);

  link::Command& command = output.command;
  command.newest_reply = newest_sequence_;
  // Where steps are logged, the command says what its step does: a stop found since goes with the next.
  command.flags = output.has_step ? output.step.flags : command_flags(input);
  command.flags |= input.tip_wish;
  command.tip_hold = tip_hold_;
  if (good_tick) command.tip_vel_w_nm_s = (target_w_nm - last_target_w_nm_) / dt_s;
  command.tip_pos_w_nm = output.has_step ? link::target_w_nm(output.step) : target_w_nm;
  command.energy_in_j = observer_.energy_in_j();
  command.energy_out_j = observer_.energy_out_j();
  fill_port_control(command);
  scales_.sent(input.command_sequence, config_.scaling.hand_energy_j(1));
  last_target_w_nm_ = target_w_nm;

  StationTrace& trace = output.trace;
  trace.time_ns = input.time_ns;
  trace.mode = mode_;
  trace.faults = faults_ | latched_;
  trace.hand_pos_h_m = hand_pos_h_m_;
  if (good_tick) trace.hand_vel_h_m_s = hand_step_h_m_ / dt_s;
  trace.tip_target_pos_w_nm = target_w_nm;
  trace.applied_force_h_n = applied_force_h_n_;
  trace.commanded_force_h_n = commanded_force_h_n_;
  trace.ramp = ramp_;
  trace.energy_j = observer_.energy_j();
  trace.energy_in_j = observer_.energy_in_j();
  trace.energy_out_j = observer_.energy_out_j();
  trace.quantisation_bound_j = observer_.quantisation_bound_j();
  trace.account_j = methods_.now().account_j();
  trace.method = methods_.method();
  if (twin_) {
    trace.twin = twin_->state();
    trace.twin_end = twin_->given_up() ? twin_->end() : TwinEnd::kNone;
    trace.twin_behind = twin_->on() ? twin_->behind() : 0;
  }
  // Of another session's tip the twin here says nothing.
  const bool twin_on = twin_ && twin_->on() && !twin_->waits() && holds_tip();
  trace.contact_radius_nm = twin_on ? twin_->answer().contact_radius_nm : 0;
  trace.adhesion_nn = twin_on ? twin_->answer().adhesion_nn : reply_.model.adhesion_nn;
  trace.slave_energy_in_j = config_.scaling.hand_energy_j(reply_.energy_in_aj);
  trace.slave_energy_out_j = config_.scaling.hand_energy_j(reply_.energy_out_aj);
  trace.stale_s = stale_s_;
  trace.reply_sequence = reply_.sequence;
  trace.observes = has_reply_ && !holds_tip();
}

}  // namespace telenano::station
