#include "master/station/station.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace telenano::station {
namespace {

// A measurement beyond these is no measurement: booked, it would buy or cost energy for the rest of the
// session.
constexpr double kBelievableStepM = 1.0;  // of the hand in a tick
constexpr double kBelievableForce = 2.0;  // times what the device can do

control::PassivityConfig passivity_config(const StationConfig& config, const device::DeviceInfo& device,
                                          const SlavePort& slave) noexcept {
  control::PassivityConfig passivity;
  passivity.method = config.method;
  passivity.period_s = 1 / config.rate_hz;
  passivity.allowance_j = config.allowance_j;
  passivity.velocity_max_m_s = config.guaranteed_velocity_m_s;
  passivity.damping_certain_n_s_m =
      config.device_damping_n_s_m < 0 ? device.damping_n_s_m : config.device_damping_n_s_m;
  passivity.shown_stiffness_n_m = config.scaling.impedance() * slave.coupling_stiffness_n_m;
  passivity.shown_damping_n_s_m = config.scaling.impedance() * slave.coupling_damping_n_s_m;
  passivity.position_quantum_m = device.position_quantum_m;
  return passivity;
}

bool finite_reply(const link::Reply& reply) noexcept {
  return is_finite(reply.force_w_nn) && is_finite(reply.tip_pos_w_nm) && std::isfinite(reply.deflection_nm) &&
         std::isfinite(reply.energy_in_aj) && std::isfinite(reply.energy_out_aj);
}

}  // namespace

const char* mode_name(Mode mode) noexcept {
  switch (mode) {
    case Mode::kIdle:
      return "idle";
    case Mode::kReady:
      return "ready";
    case Mode::kEngaged:
      return "engaged";
    case Mode::kHeld:
      return "held";
    case Mode::kStopped:
      return "stopped";
  }
  return "unknown";
}

const char* fault_name(std::uint32_t faults) noexcept {
  static constexpr const char* kNames[] = {"stop pressed",
                                           "hand faster than the velocity trip",
                                           "hand position not finite or not believable",
                                           "applied force not finite or not believable",
                                           "device failed",
                                           "reply not finite",
                                           "computed force not finite",
                                           "no new reply",
                                           "bad tick length",
                                           "slave stiffer than planned"};
  for (std::size_t bit = 0; bit < std::size(kNames); ++bit) {
    if (faults & (1u << bit)) return kNames[bit];
  }
  return "none";
}

Station::Station(const StationConfig& config, const device::DeviceInfo& device, const SlavePort& slave)
    : config_((config.validate(), config)),
      slave_(slave),
      period_s_(1 / config.rate_hz),
      device_force_max_n_(device.force_max_n),
      force_limit_n_(config.force_safety * device.force_max_n),
      controller_(passivity_config(config, device, slave)),
      mapping_(config.scaling) {}

void Station::begin_session(const link::Welcome& welcome) noexcept {
  mapping_.begin(welcome.start_pos_w_nm, welcome.workspace_min_w_nm, welcome.workspace_max_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
  has_reply_ = false;  // the last force may only fade until the new session answers
  newest_sequence_ = 0;
  if (mode_ == Mode::kEngaged) mode_ = Mode::kHeld;
  if (welcome.coupling_stiffness_n_m > slave_.coupling_stiffness_n_m ||
      welcome.coupling_damping_n_s_m > slave_.coupling_damping_n_s_m) {
    latched_ |= kFaultSlaveStiffer;
  }
}

void Station::clear_stop() noexcept {
  if (latched_ == 0) return;
  latched_ = 0;
  ramp_ = 0;
  mode_ = Mode::kReady;
}

/// Everything that is known about the interval that has just ended: its energy, and whether it was a sane
/// one.
void Station::watch(const StationInput& input, double dt_s) noexcept {
  hand_step_h_m_.setZero();
  if (input.buttons & device::kButtonStop) latched_ |= kFaultStopPressed;
  if (input.device_status == device::DeviceStatus::kFailed) latched_ |= kFaultDeviceFailed;
  const bool believable_pos =
      is_finite(input.hand_pos_h_m) &&
      (!has_hand_pos_ || (input.hand_pos_h_m - hand_pos_h_m_).cwiseAbs().maxCoeff() <= kBelievableStepM);
  const bool believable_force =
      is_finite(input.applied_force_h_n) &&
      input.applied_force_h_n.cwiseAbs().maxCoeff() <= kBelievableForce * device_force_max_n_;
  if (!believable_pos) latched_ |= kFaultHandPosNonFinite;
  if (!believable_force) latched_ |= kFaultAppliedNonFinite;
  // What cannot be measured cannot be booked; the stop holds the force at zero until a person has looked.
  if (!believable_pos || !believable_force) return;
  controller_.observe(input.applied_force_h_n, input.hand_pos_h_m, dt_s);
  applied_force_h_n_ = input.applied_force_h_n;
  if (has_hand_pos_) hand_step_h_m_ = input.hand_pos_h_m - hand_pos_h_m_;
  hand_pos_h_m_ = input.hand_pos_h_m;
  has_hand_pos_ = true;
  if (hand_step_h_m_.norm() > config_.trip_velocity_m_s * dt_s) latched_ |= kFaultVelocityTrip;
}

void Station::accept_reply(const StationInput& input) noexcept {
  const bool is_new = input.reply != nullptr && input.session_up && input.reply->sequence > newest_sequence_;
  stale_s_ = static_cast<double>(input.time_ns - last_reply_ns_) * 1e-9;
  if (is_new) {
    newest_sequence_ = input.reply->sequence;
    if (finite_reply(*input.reply)) {
      const bool resumes = !has_reply_ || stale_s_ > config_.stale_hold_s;
      reply_ = *input.reply;
      tip_force_h_n_ = config_.scaling.hand_force_n(reply_.force_w_nn);
      has_reply_ = true;
      last_reply_ns_ = input.time_ns;
      stale_s_ = 0;
      if (resumes) {
        // The hand has moved on since the last force: start the ramp where the new force, so scaled, is no
        // larger than what acts now.
        const double norm_n2 = tip_force_h_n_.squaredNorm();
        const double along = norm_n2 > 0 ? commanded_force_h_n_.dot(tip_force_h_n_) / norm_n2 : 0;
        ramp_ = along > 0 ? std::min(ramp_, along) : 0;
      }
    } else {
      faults_ |= kFaultReplyNonFinite;
      has_reply_ = false;
      tip_force_h_n_.setZero();
      ramp_ = 0;
    }
  }
  if (has_reply_ && stale_s_ > config_.stale_hold_s) faults_ |= kFaultStale;
}

/// A stop makes the slave withdraw within the session: its tip is no longer where the target was left, and
/// must not be driven back there by the next engagement.
void Station::follow_a_retracted_tip() noexcept {
  if (mode_ == Mode::kEngaged || !has_reply_ || !(reply_.fault_bits & link::kFaultRetracted)) return;
  mapping_.stand_at(reply_.tip_pos_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
}

void Station::choose_mode(const StationInput& input, double dt_s) noexcept {
  if (latched_ != 0) {
    mode_ = Mode::kStopped;
    return;
  }
  const bool was_engaged = mode_ == Mode::kEngaged || mode_ == Mode::kHeld;
  if (!input.session_up) {
    mode_ = was_engaged ? Mode::kHeld : Mode::kIdle;
    return;
  }
  const bool wanted = (!config_.require_deadman || (input.buttons & device::kButtonDeadman)) &&
                      !(input.buttons & device::kButtonClutch) &&
                      input.device_status == device::DeviceStatus::kOk;
  if (!wanted) {
    mode_ = Mode::kReady;
  } else if (mode_ == Mode::kEngaged) {
    // A station that was itself kept from running so long has been as blind as in an outage, even if the
    // reply that waited for it is taken for news.
    if (std::max(stale_s_, dt_s) >= config_.stale_zero_s) mode_ = Mode::kHeld;
  } else if (has_reply_ && stale_s_ <= config_.stale_hold_s) {
    mode_ = Mode::kEngaged;
  } else {
    mode_ = was_engaged ? Mode::kHeld : Mode::kReady;
  }
}

void Station::update_ramp(const StationInput& input, double dt_s) noexcept {
  const double fade_s = config_.stale_zero_s - config_.stale_hold_s;
  if (mode_ == Mode::kStopped || input.device_status != device::DeviceStatus::kOk) {
    ramp_ = 0;
    return;
  }
  const bool stale = stale_s_ > config_.stale_hold_s;
  if (mode_ == Mode::kEngaged && has_reply_ && !stale) {
    ramp_ = std::min(1.0, ramp_ + std::min(dt_s, period_s_) / config_.engage_ramp_s);
    return;
  }
  if (mode_ != Mode::kEngaged) ramp_ = std::max(0.0, ramp_ - dt_s / fade_s);
  if (stale) ramp_ = std::min(ramp_, std::max(0.0, (config_.stale_zero_s - stale_s_) / fade_s));
}

Vec3 Station::limited_force(double dt_s, StationTrace& trace) noexcept {
  if (ramp_ <= 0) return Vec3::Zero();
  Vec3 force_h_n = ramp_ * (trace.scaled_force_h_n + trace.damper_force_h_n);
  if (!is_finite(force_h_n)) {
    latched_ |= kFaultForceNonFinite;
    mode_ = Mode::kStopped;
    ramp_ = 0;
    return Vec3::Zero();
  }
  // A late tick has shown nothing in the meantime: it may take as much force away as its length asks for, but
  // add no more than an ordinary one.
  const double growth_n = config_.slew_n_s * std::min(dt_s, period_s_);
  force_h_n = limit_slew(force_h_n, applied_force_h_n_, growth_n, trace.slewed);
  force_h_n = limit_norm(force_h_n, force_limit_n_, trace.limited);
  return limit_norm(force_h_n, trace.force_bound_n, trace.clamped);
}

void Station::step(const StationInput& input, double dt_s, StationOutput& output) noexcept {
  output = {};
  faults_ = 0;
  const bool good_tick = dt_s > 0 && std::isfinite(dt_s);
  if (good_tick) {
    watch(input, dt_s);
    accept_reply(input);
    choose_mode(input, dt_s);
    follow_a_retracted_tip();
    mapping_.update(mode_ == Mode::kEngaged, hand_pos_h_m_);
    update_ramp(input, dt_s);
  } else {
    faults_ |= kFaultBadTick;
    ramp_ = 0;
  }
  StationTrace& trace = output.trace;
  trace.scaled_force_h_n = tip_force_h_n_;
  trace.damper_force_h_n = controller_.damper_force_h_n();
  trace.damper_n_s_m = controller_.damper_n_s_m();
  trace.force_bound_n = controller_.force_bound_n();
  commanded_force_h_n_ = good_tick ? limited_force(dt_s, trace) : Vec3::Zero();
  output.hand_force_h_n = commanded_force_h_n_;
  fill(input, dt_s, output);
}

void Station::fill(const StationInput& input, double dt_s, StationOutput& output) noexcept {
  const control::EnergyObserver& observer = controller_.observer();
  const Vec3& target_w_nm = mapping_.target_w_nm();
  const bool good_tick = !(faults_ & kFaultBadTick);

  link::Command& command = output.command;
  command.newest_reply = newest_sequence_;
  if (mode_ == Mode::kEngaged) command.flags |= link::kFlagClutch;
  if (!config_.require_deadman || (input.buttons & device::kButtonDeadman))
    command.flags |= link::kFlagDeadman;
  if (mode_ == Mode::kStopped) command.flags |= link::kFlagStop;
  if (good_tick) command.tip_vel_w_nm_s = (target_w_nm - last_target_w_nm_) / dt_s;
  command.tip_pos_w_nm = target_w_nm;
  command.energy_in_j = observer.energy_in_j();
  command.energy_out_j = observer.energy_out_j();
  last_target_w_nm_ = target_w_nm;

  StationTrace& trace = output.trace;
  trace.time_ns = input.time_ns;
  trace.mode = mode_;
  trace.faults = faults_ | latched_;
  trace.hand_pos_h_m = hand_pos_h_m_;
  if (good_tick) trace.hand_vel_h_m_s = hand_step_h_m_ / dt_s;
  trace.tip_target_pos_w_nm = target_w_nm;
  trace.tip_pos_w_nm = reply_.tip_pos_w_nm;
  trace.tip_force_w_nn = reply_.force_w_nn;
  trace.deflection_nm = reply_.deflection_nm;
  trace.contact_state = static_cast<std::uint32_t>(reply_.contact_state);
  trace.slave_faults = reply_.fault_bits;
  trace.applied_force_h_n = applied_force_h_n_;
  trace.commanded_force_h_n = commanded_force_h_n_;
  trace.ramp = ramp_;
  trace.energy_j = observer.energy_j();
  trace.energy_in_j = observer.energy_in_j();
  trace.energy_out_j = observer.energy_out_j();
  trace.quantisation_bound_j = observer.quantisation_bound_j();
  trace.ledger_j = controller_.ledger_j();
  trace.slave_energy_in_j = config_.scaling.hand_energy_j(reply_.energy_in_aj);
  trace.slave_energy_out_j = config_.scaling.hand_energy_j(reply_.energy_out_aj);
  trace.stale_s = stale_s_;
  trace.reply_sequence = reply_.sequence;
}

}  // namespace telenano::station
