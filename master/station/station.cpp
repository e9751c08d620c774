#include "telenano/master/station/station.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "telenano/common/base/renew.h"
#include "telenano/common/control/scaling_plan.h"

namespace telenano::station {
namespace {

// A measurement beyond these is no measurement: counted, it would buy or cost energy for the rest of the
// session.
constexpr double kBelievableStepM = 1.0;  // of the hand in a tick
// Of the longest round trip: shorter than that, and forces come back.
constexpr double kYoungAgain = 0.8;
constexpr double kBelievableForce = 2.0;  // times what the device can do

bool finite_reply(const link::Reply& reply) noexcept {
  return is_finite(reply.force_w_nn) && is_finite(reply.tip_pos_w_nm) && std::isfinite(reply.deflection_nm) &&
         std::isfinite(reply.energy_in_aj) && std::isfinite(reply.energy_out_aj) &&
         std::isfinite(reply.port.energy_sent_aj) && is_finite(reply.port.wave_sum) &&
         std::isfinite(reply.port.wave_energy_aj) && link::is_finite(reply.model);
}

control::ContactPlane contact_plane(const link::LocalModel& m) noexcept {
  control::ContactPlane model;
  if (m.version == 0) return model;
  model.version = m.version;
  model.point_w_nm = m.point_w_nm;
  model.normal_w = m.normal_w;
  model.stiffness_n_m = m.stiffness_n_m;
  model.adhesion_nn = m.adhesion_nn;
  model.shear_stiffness_n_m = m.shear_stiffness_n_m;
  model.friction_nn = m.friction_nn;
  return model;
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
    case Mode::kHoming:
      return "homing";
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
                                           "slave stiffer than planned",
                                           "another scene than before",
                                           "round trip too long for the method",
                                           "stiffness was the twin's alone"};
  for (std::size_t bit = 0; bit < std::size(kNames); ++bit) {
    if (faults & (1u << bit)) return kNames[bit];
  }
  return "none";
}

control::Method usable_method(control::Method wanted, std::uint64_t features) noexcept {
  using control::Method;
  constexpr std::uint64_t kModelling = link::kFeatureLocalModel | link::kFeaturePortControl;
  if (wanted == Method::kTwin && (features & link::kFeatureStepLog) == 0) wanted = Method::kModel;
  if (wanted == Method::kModel && (features & kModelling) != kModelling) wanted = Method::kTank;
  if (control::needs_port_control(wanted) && !(features & link::kFeaturePortControl))
    wanted = Method::kKsClamp;
  return wanted;
}

/// A twin must be there too, of the scene that is served, and must not have been given up.
control::Method Station::usable(control::Method wanted) const noexcept {
  if (wanted == control::Method::kTwin && (!twin_ || !twin_->on())) wanted = control::Method::kModel;
  return usable_method(wanted, features_);
}

/// How long a force is shown after the last new reply. A twin needs none to be right: it may go on for as
/// long as the server's slave would go on following.
double Station::hold_s() const noexcept {
  return shows_twin() ? std::max(config_.stale_hold_s, twin_->silence_s()) : config_.stale_hold_s;
}

double Station::zero_s() const noexcept {
  return shows_twin() ? hold_s() + config_.stale_zero_s - config_.stale_hold_s : config_.stale_zero_s;
}

/// The sample's own energy, as slave and twin know of it: credited is the larger, once.
double Station::given_aj() const noexcept {
  return std::max(wells_.most_given_aj(), twin_ ? twin_->most_given_aj() : 0.0);
}

/// The deepest well that is believed: with a twin no more than the station has found in the scene itself.
/// That is known all the same when the twin was given up: a server must not gain by making it part.
double Station::well_j() const noexcept {
  const bool knows_scene = twin_ && has_scene_ && twin_->scene_hash() == scene_hash_;
  double believed_aj = knows_scene ? std::min(well_aj_, twin_->well_aj()) : well_aj_;
  // A companded sample is one whose well is so much deeper. That is the station's own doing, no server's word.
  if (knows_scene && methods_.method() == control::Method::kTwin)
    believed_aj += twin_->companding().most_ever_aj();
  if (!wells_.knows()) return 0;
  const double most_j = std::max(0.0, config_.well_max_j - wells_.of_others_j());
  return std::min(config_.scaling.hand_energy_j(believed_aj), most_j);
}

/// Of all samples so far: those that were left have given what they were believed, and give no more.
Station::SampleCredit Station::sample_credit() noexcept {
  const double well_now_j = well_j();
  const double given_now_j = std::min(config_.scaling.hand_energy_j(given_aj()), well_now_j);
  wells_.believe(given_now_j);
  const double others_j = wells_.of_others_j();
  return {others_j + well_now_j, others_j + given_now_j};
}

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

void Station::change_method(control::Method method) noexcept {
  config_.method = method;
  method = usable(method);
  if (method == methods_.method()) return;
  methods_.change_to(method, method_config(), hand_pos_h_m_);
  if (has_reply_) tell_method({}, 0);
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
    tell_method({}, 0);
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

/// Where the hand's motion goes on. A server that has not executed all of a log which goes on stands where its
/// newest executed step led; the others come to it again, and then it stands where they lead. An anchor at the
/// former place would be a step back of the tip, and one of the force.
Vec3 Station::session_start_w_nm(const link::Welcome& welcome) const noexcept {
  const link::StepReport& steps = welcome.steps;
  const bool goes_on = (welcome.feature_bits & link::kFeatureStepLog) != 0 &&
                       (welcome.feature_bits & link::kFeatureSharing) == 0 && welcome.epoch == epoch_ &&
                       steps.executed < newest_step_ && steps.breaks <= step_breaks_;
  return goes_on ? last_step_w_nm_ : welcome.start_pos_w_nm;
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

void Station::begin_session(const link::Welcome& welcome, bool known_account) noexcept {
  mapping_.begin(session_start_w_nm(welcome), welcome.workspace_min_w_nm, welcome.workspace_max_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
  has_reply_ = false;  // the last force may only fade until the new session answers
  newest_sequence_ = 0;
  if (mode_ == Mode::kEngaged) mode_ = Mode::kHeld;
  const bool new_epoch = welcome.epoch != epoch_;
  epoch_ = welcome.epoch;
  features_ = welcome.feature_bits;
  if (new_epoch || welcome.steps.executed > newest_step_) newest_step_ = welcome.steps.executed;
  step_breaks_ = welcome.steps.breaks;
  if (new_epoch) slave_sums_.reset();
  if (new_epoch && !known_account) slave_sums_.begin_with_next();
  scales_.begin_session(new_epoch);
  if (new_epoch) {
    sample_.reset();
    given_aj_ = 0;
  }
  well_aj_ = (features_ & link::kFeatureWell) != 0 ? welcome.well_aj : 0;
  tip_hold_ = 0;
  tip_up_ = waits_for_tip_ = false;
  const bool expected = expected_scene_ != 0 && welcome.scene_hash == expected_scene_;
  expected_scene_ = 0;
  if (has_scene_ && welcome.scene_hash != scene_hash_ && !expected) latched_ |= kFaultOtherScene;
  scene_hash_ = welcome.scene_hash;
  wells_.go_to(scene_hash_);
  has_scene_ = true;
  if (twin_) {
    if (logs_steps() && twin_->scene_hash() == welcome.scene_hash) {
      twin_->begin(welcome.steps, new_epoch || !has_scene_, 1e-3 * welcome.timeout_ms, last_tick_ns_,
                   shares_tip());
    } else {
      twin_->leave();
    }
  }
  const control::Method method = usable(config_.method);
  if (method != methods_.method()) methods_.change_to(method, method_config(), hand_pos_h_m_);
  methods_.now().begin_session(new_epoch);
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
  if (input.device_status == device::DeviceStatus::kHoming) {
    // Where the hand is means nothing until the device is calibrated, and leaps when it is. No force acts
    // meanwhile, so there is nothing to count, and the account goes on where the first good position finds it.
    has_hand_pos_ = false;
    applied_force_h_n_.setZero();
    return;
  }
  const bool believable_pos =
      is_finite(input.hand_pos_h_m) &&
      (!has_hand_pos_ || (input.hand_pos_h_m - hand_pos_h_m_).cwiseAbs().maxCoeff() <= kBelievableStepM);
  const bool believable_force =
      is_finite(input.applied_force_h_n) &&
      input.applied_force_h_n.cwiseAbs().maxCoeff() <= kBelievableForce * device_force_max_n_;
  if (!believable_pos) latched_ |= kFaultHandPosNonFinite;
  if (!believable_force) latched_ |= kFaultAppliedNonFinite;
  // What cannot be measured cannot be counted; the stop holds the force at zero until a person has looked.
  if (!believable_pos || !believable_force) return;
  if (!has_hand_pos_ && observer_.started()) observer_.resume_at(input.hand_pos_h_m);
  const bool first = !observer_.started() || !has_hand_pos_;
  control::PortInterval interval;
  interval.applied_force_h_n = input.applied_force_h_n;
  interval.hand_pos_h_m = input.hand_pos_h_m;
  interval.dt_s = dt_s;
  interval.put_in_j = observer_.update(input.applied_force_h_n, input.hand_pos_h_m);
  interval.displacement_h_m = observer_.displacement_h_m();
  if (first) {
    methods_.change_to(methods_.method(), method_config(), input.hand_pos_h_m);
  } else {
    methods_.now().account_for(interval);
  }
  applied_force_h_n_ = input.applied_force_h_n;
  if (has_hand_pos_) hand_step_h_m_ = input.hand_pos_h_m - hand_pos_h_m_;
  hand_pos_h_m_ = input.hand_pos_h_m;
  has_hand_pos_ = true;
  if (hand_step_h_m_.norm() > config_.trip_velocity_m_s * dt_s) latched_ |= kFaultVelocityTrip;
}

/// Of a shared tip only the holder is moved by forces and moves it. Who gets it begins where it stands; who
/// loses it keeps the last force that was his, and lets it fade.
void Station::hear_who_holds(const link::TipShare& tip) noexcept {
  const bool begins = tip.hold != tip_hold_ && tip.hold != 0;
  const bool stays = tip.hold == tip_hold_ && tip.hold != 0;
  tip_hold_ = tip.hold;
  if (stays) return;
  stand_at_tip(tip.pos_w_nm);
  if (begins) begin_anew();
}

/// Lets go; the target is where the tip is now.
void Station::stand_at_tip(const Vec3& tip_pos_w_nm) noexcept {
  if (mode_ == Mode::kEngaged || mode_ == Mode::kHeld) mode_ = Mode::kReady;
  mapping_.update(false, hand_pos_h_m_);
  mapping_.stand_at(tip_pos_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
}

/// The tip is this station's to move, from where it stands: what the method shows comes in by the ramp.
void Station::begin_anew() noexcept {
  methods_.change_to(methods_.method(), method_config(), hand_pos_h_m_);
  bump_ahead_ = true;
}

/// A tip that is up shows no force and follows nobody; where it comes back, the target was not. Whatever the
/// hand did meanwhile moves nothing: it is anchored anew when the slave says that the tip is there.
void Station::hear_whether_tip_is_up() noexcept {
  const bool was_up = std::exchange(tip_up_, (reply_.fault_bits & link::kFaultRetracted) != 0);
  if (!holds_tip() || was_up == tip_up_) return;
  stand_at_tip(shares_tip() ? reply_.tip.pos_w_nm : reply_.tip_pos_w_nm);
  if (was_up) begin_anew();
}

void Station::accept_reply(const StationInput& input) noexcept {
  const bool is_new = input.reply != nullptr && input.session_up && input.reply->sequence > newest_sequence_;
  stale_s_ = static_cast<double>(input.time_ns - last_reply_ns_) * 1e-9;
  if (is_new) {
    newest_sequence_ = input.reply->sequence;
    if (finite_reply(*input.reply)) {
      const bool resumes = !has_reply_ || stale_s_ > hold_s();
      reply_ = *input.reply;
      if (shares_tip()) hear_who_holds(reply_.tip);
      hear_whether_tip_is_up();
      has_reply_ = true;
      if (logs_steps()) step_breaks_ = std::max(step_breaks_, reply_.steps.breaks);
      last_reply_ns_ = input.time_ns;
      stale_s_ = 0;
      bump_ahead_ = bump_ahead_ || resumes;
      if (twin_ && logs_steps()) {
        twin_->hold(tip_hold_);
        twin_->on_reply(reply_.steps, input.time_ns);
      }
      const link::ReceivedSums::News added = account_for_slave();
      if (holds_tip()) {
        tip_force_h_n_ = config_.scaling.hand_force_n(reply_.force_w_nn);
        tell_method(added, price_j_aj_);
      }
    } else {
      faults_ |= kFaultReplyNonFinite;
      has_reply_ = false;
      tip_force_h_n_.setZero();
      ramp_ = 0;
    }
  }
  blind_s_ = stale_s_;
  if (shows_twin()) {
    const double beyond_s = twin_->lag_s(input.time_ns) - twin_->lag_most_s(input.rtt_s);
    if (beyond_s > 0) blind_s_ = std::max(blind_s_, hold_s() + beyond_s);
  }
  if (has_reply_ && blind_s_ > hold_s()) faults_ |= kFaultStale;
  watch_age(input);
}

/// Replies that come every millisecond are no news if each is of a second ago. Beyond the method's longest
/// round trip the force fades and the tip holds as in an outage that begins then, until it is well below.
void Station::watch_age(const StationInput& input) noexcept {
  const double most_s = config_.age_most_s(methods_.method());
  const bool was_old = old_;
  old_ = input.session_up && !shows_twin() && input.rtt_s > (was_old ? kYoungAgain * most_s : most_s);
  if (!old_) return;
  if (!was_old) old_since_ns_ = input.time_ns;
  faults_ |= kFaultOld;
  blind_s_ = std::max(blind_s_, hold_s() + 1e-9 * static_cast<double>(input.time_ns - old_since_ns_));
}

/// What the newest reply has added to the slave's sums; of what came out, what may be credited.
link::ReceivedSums::News Station::account_for_slave() noexcept {
  link::ReceivedSums::News added = slave_sums_.update(reply_);
  given_aj_ += added.energy_out_aj - added.energy_in_aj;
  wells_.give(given_aj_);
  price_j_aj_ = scales_.answered(reply_.command_sequence, config_.scaling.hand_energy_j(1));
  sample_.put_in(added.energy_in_aj, price_j_aj_);
  added.energy_out_aj = sample_.take_out(added.energy_out_aj, price_j_aj_);
  return added;
}

/// What the newest reply says. Energies and waves come as sums; the method is told what has been added to
/// them, at the price that held then: nothing, when it hears the same reply again after a change.
void Station::tell_method(const link::ReceivedSums::News& added, double price_j_aj) noexcept {
  const auto crossed_j = [price_j_aj](double energy_aj) {
    const double energy_j = price_j_aj * energy_aj;
    return std::isfinite(energy_j) ? energy_j : 0.0;  // two finite numbers may make one that is not
  };
  control::SlaveNews news;
  news.force_h_n = tip_force_h_n_;
  news.touching = reply_.contact_state == link::ContactState::kContact;
  news.energy_out_j = crossed_j(added.energy_out_aj);
  news.energy_sent_j = crossed_j(added.energy_sent_aj);
  news.wave_h = added.wave * std::sqrt(price_j_aj);
  if (!is_finite(news.wave_h)) news.wave_h.setZero();
  news.wave_j = crossed_j(added.wave_aj);
  const SampleCredit credit = sample_credit();
  news.well_j = credit.well_j;
  news.given_j = credit.given_j;
  news.model = contact_plane(reply_.model);
  news.answers = reply_.command_sequence;
  methods_.now().on_reply(news);
}

/// What the method shows now. Where that may be another force than the last at once (news after an outage,
/// another method or scale), the ramp starts where the new one, so scaled, is no larger than what acts.
void Station::render(const StationInput& input, double dt_s, StationTrace& trace) noexcept {
  control::StationMethod& method = methods_.now();
  const Vec3 last_h_n = rendered_force_h_n_;
  rendered_force_h_n_ = method.force_h_n({mapping_.target_w_nm(), input.command_sequence, dt_s});
  // A method that knows less of the contact than the twin did must not drop the hand.
  if (std::exchange(leaves_twin_, false)) left_by_twin_h_n_ = last_h_n - rendered_force_h_n_;
  const double left_n = left_by_twin_h_n_.norm();
  const double goes_n = control::Twin::kGoOver_n_s * std::min(dt_s, period_s_);
  left_by_twin_h_n_ *= left_n > goes_n ? 1 - goes_n / left_n : 0;
  rendered_force_h_n_ += left_by_twin_h_n_;
  if (bump_ahead_) {
    const double norm_n2 = rendered_force_h_n_.squaredNorm();
    const double along = norm_n2 > 0 ? commanded_force_h_n_.dot(rendered_force_h_n_) / norm_n2 : 0;
    ramp_ = along > 0 ? std::min(ramp_, along) : 0;
  }
  bump_ahead_ = false;
  trace.rendered_force_h_n = rendered_force_h_n_;
  trace.damper_force_h_n = method.damper_force_h_n();
  trace.damper_n_s_m = method.damper_n_s_m();
  trace.force_bound_n = method.force_bound_n();
}

/// A slave that withdraws within the session, by a stop or a fault: its tip is no longer where the target was
/// left, and must not be driven back there by the next engagement.
void Station::follow_a_retracted_tip() noexcept {
  if (mode_ == Mode::kEngaged || !has_reply_ || !(reply_.fault_bits & link::kFaultRetracted)) return;
  if (shares_tip()) {
    mapping_.stand_at(reply_.tip.pos_w_nm);  // better than the tip's own place: what the slave goes on from
    last_target_w_nm_ = mapping_.target_w_nm();
    return;
  }
  mapping_.stand_at(reply_.tip_pos_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
}

/// A stiffness that was planned for a loop without delay is no other method's, for however short a time. What
/// acts on the hand becomes a force that no longer depends on where the hand is, and fades; the tip stays.
void Station::leave_twins_scale() noexcept {
  const bool too_stiff = config_.impedance_without_twin > 0 && !config_.allow_unsafe_scaling &&
                         config_.scaling.impedance() > config_.impedance_without_twin * (1 + 1e-9);
  if (too_stiff && !fades_ && has_reply_ && !shows_twin()) {
    fades_ = true;
    fading_h_n_ = commanded_force_h_n_;
    ramp_ = 1;
    leaves_twin_ = false;
    left_by_twin_h_n_.setZero();
  }
  if (fades_) faults_ |= kFaultTwinLeft;
}

/// When nothing is left of the force: the scale that was planned for any method. Then the hand engages anew, by
/// the ramp.
void Station::fade_to_new_scale(double dt_s, StationTrace& trace) noexcept {
  const double left_n = fading_h_n_.norm();
  const double goes_n = control::Twin::kGoOver_n_s * std::min(dt_s, period_s_);
  fading_h_n_ *= left_n > goes_n ? 1 - goes_n / left_n : 0;
  rendered_force_h_n_ = fading_h_n_;
  trace.rendered_force_h_n = rendered_force_h_n_;
  trace.force_bound_n = methods_.now().force_bound_n();
  if (fading_h_n_.squaredNorm() > 0) return;
  fades_ = false;
  const control::Scaling& scaling = config_.scaling;
  if (scaling.impedance() > config_.impedance_without_twin)  // a person may have chosen less meanwhile
    change_scaling({scaling.velocity, config_.impedance_without_twin / scaling.velocity});
  begin_anew();
  ramp_ = 0;
}

void Station::choose_mode(const StationInput& input, double dt_s) noexcept {
  waits_for_tip_ = false;
  if (latched_ != 0) {
    mode_ = Mode::kStopped;
    return;
  }
  if (input.device_status == device::DeviceStatus::kHoming) {
    mode_ = input.session_up ? Mode::kHoming : Mode::kIdle;
    return;
  }
  const bool was_engaged = mode_ == Mode::kEngaged || mode_ == Mode::kHeld;
  if (!input.session_up) {
    mode_ = was_engaged ? Mode::kHeld : Mode::kIdle;
    return;
  }
  const bool wanted = (!config_.require_deadman || (input.buttons & device::kButtonDeadman)) &&
                      !(input.buttons & device::kButtonClutch) &&
                      input.device_status == device::DeviceStatus::kOk && holds_tip() && !twin_waits() &&
                      !fades_;
  waits_for_tip_ = wanted && has_reply_ && tip_up_;
  if (!wanted || waits_for_tip_) {
    mode_ = Mode::kReady;
  } else if (mode_ == Mode::kEngaged) {
    // A station that was itself kept from running so long has been as blind as in an outage, even if the
    // reply that waited for it is taken for news.
    if (std::max(blind_s_, dt_s) >= zero_s()) mode_ = Mode::kHeld;
  } else if (has_reply_ && blind_s_ <= hold_s()) {
    mode_ = Mode::kEngaged;
  } else {
    mode_ = was_engaged ? Mode::kHeld : Mode::kReady;
  }
}

void Station::update_ramp(const StationInput& input, double dt_s) noexcept {
  const double fade_s = zero_s() - hold_s();
  if (mode_ == Mode::kStopped || input.device_status != device::DeviceStatus::kOk) {
    ramp_ = 0;
    return;
  }
  const bool stale = blind_s_ > hold_s();
  if (fades_) {  // by itself, unless the hand lets go or the link is lost before
    const bool held = (!config_.require_deadman || (input.buttons & device::kButtonDeadman) != 0) &&
                      (input.buttons & device::kButtonClutch) == 0 && input.session_up;
    if (!held) ramp_ = std::max(0.0, ramp_ - dt_s / fade_s);
    if (stale) ramp_ = std::min(ramp_, std::max(0.0, (zero_s() - blind_s_) / fade_s));
    return;
  }
  if (mode_ == Mode::kEngaged && has_reply_ && !stale) {
    ramp_ = std::min(1.0, ramp_ + std::min(dt_s, period_s_) / config_.engage_ramp_s);
    return;
  }
  if (mode_ != Mode::kEngaged) ramp_ = std::max(0.0, ramp_ - dt_s / fade_s);
  if (stale) ramp_ = std::min(ramp_, std::max(0.0, (zero_s() - blind_s_) / fade_s));
}

Vec3 Station::limited_force(double dt_s, StationTrace& trace) noexcept {
  if (ramp_ <= 0) return Vec3::Zero();
  Vec3 force_h_n = ramp_ * (trace.rendered_force_h_n + trace.damper_force_h_n);
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

std::uint32_t Station::command_flags(const StationInput& input) const noexcept {
  std::uint32_t flags = 0;
  // The slave of a shared tip that is up brings it back for an operator who wants to engage. It follows
  // nothing until then. (A private one needs no word, and would go back to where it was a round trip ago.)
  if (mode_ == Mode::kEngaged || (waits_for_tip_ && shares_tip())) flags |= link::kFlagClutch;
  if (!config_.require_deadman || (input.buttons & device::kButtonDeadman)) flags |= link::kFlagDeadman;
  if (mode_ == Mode::kStopped) flags |= link::kFlagStop;
  return flags;
}

/// How long the slave's step of this tick is. Of a hand that moves by the clock on the wall a late tick
/// counts from its last position, and the next one as a whole period: the ticks add up to more than the time
/// that passed, by each rise of the lateness. A server executes a log no faster than the wall goes
/// (link::StepReceiver), so it would fall behind for ever. Steps may be ahead by so much, and are shortened
/// then.
double Station::step_s(std::int64_t now_ns, double dt_s) noexcept {
  constexpr double kAheadMost_s = 0.1;
  const double passed_s = 1e-9 * static_cast<double>(now_ns - last_tick_ns_);
  steps_ahead_s_ = std::max(0.0, steps_ahead_s_ + dt_s - passed_s);
  const double shorter_s = std::clamp(steps_ahead_s_ - kAheadMost_s, 0.0, dt_s);
  steps_ahead_s_ -= shorter_s;
  return dt_s - shorter_s;
}

/// The slave's step of this tick, where steps are logged: here at once, if there is a twin, and at the server
/// when it has come.
void Station::step_slave(const StationInput& input, double dt_s, StationOutput& output) noexcept {
  const double step_dt_s = step_s(input.time_ns, dt_s);
  if (!logs_steps() || !input.session_up) return;
  output.has_step = true;
  output.step = link::logged_step(mapping_.target_w_nm(), command_flags(input), step_dt_s);
  output.step.hold = tip_hold_;
  newest_step_ = input.next_step;
  last_step_w_nm_ = link::target_w_nm(output.step);
  if (!twin_) return;
  if (input.snapshot != nullptr) {
    const link::SnapshotFetch& state = *input.snapshot;
    twin_->take_up(state.data(), state.step(), state.state_hash(), state.breaks(), input.time_ns);
  }
  if (input.snapshot_refused && twin_->wants_snapshot()) twin_->give_up(TwinEnd::kRefused);
  const bool replies_flow = has_reply_ && stale_s_ <= config_.stale_hold_s;
  twin_->watch(dt_s, replies_flow, input.rtt_s, input.snapshot_pieces, input.snapshot_per_s, input.time_ns);
  twin_->step(input.next_step, output.step, input.time_ns);
  output.wants_snapshot = twin_->wants_snapshot();
  output.snapshot_of = twin_->snapshot_of();
  if (methods_.method() == control::Method::kTwin && !twin_->on()) {
    change_method(config_.method);
    leaves_twin_ = true;
  }
  if (!shows_twin()) return;
  control::LocalNews news;
  news.other_state = twin_->take_swapped();
  news.dt_s = std::min(dt_s, period_s_);
  news.force_h_n = config_.scaling.hand_force_n(twin_->felt_force_w_nn());
  const SampleCredit credit = sample_credit();
  news.well_j = credit.well_j;
  news.given_j = credit.given_j;
  methods_.now().feel(news);
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

/// What the slave has to know of the method; of those of the station's port alone no more than the scale, so
/// that it knows at which one something was pressed when another method follows.
void Station::tell_slave(link::Command& command) const noexcept {
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
  tell_slave(command);
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
