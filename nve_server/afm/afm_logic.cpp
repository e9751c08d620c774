#include "telenano/nve_server/afm/afm_logic.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/nve_server/afm/afm_units.h"

namespace telenano::afm {

namespace {

constexpr std::int64_t kEmergencyPeriodNs = 40 * kMs;  // the heart beat; the guard knows it too
constexpr std::int64_t kDataPeriodNs = 40 * kMs;
constexpr std::int64_t kIdleReadNs = 50 * kMs;
constexpr int kHeldEvery = 4;  // of so many questions on the data connection one is for what is held
constexpr std::int64_t kMayRiseNs = 1000 * kMs;  // before it is said that a withdrawn tip is not up
constexpr double kFloorSlack_nm = 10;            // for what drifts until the floor is set anew
constexpr double kContactPart = 0.125;           // of the force of a touch: less is no contact

}  // namespace

std::string_view name(Role role) noexcept {
  constexpr std::string_view kNames[] = {"motion", "reads", "data", "emergency"};
  return kNames[static_cast<std::size_t>(role)];
}

std::string_view name(Phase phase) noexcept {
  constexpr std::string_view kNames[] = {"checking", "refused",   "engaging",    "lifting",  "taring",
                                         "touching", "following", "withdrawing", "withdrawn"};
  return kNames[static_cast<std::size_t>(phase)];
}

std::string_view name(Cause cause) noexcept {
  constexpr std::string_view kNames[] = {"none",
                                         "no session for a long time",
                                         "link loss",
                                         "stop",
                                         "force limit",
                                         "lateral force limit",
                                         "controller error",
                                         "connection lost",
                                         "controller silent",
                                         "stale force",
                                         "SafeTip",
                                         "no surface found",
                                         "exit",
                                         "not approved",
                                         "signal not plausible"};
  return kNames[static_cast<std::size_t>(cause)];
}

AfmLogic::AfmLogic(const AfmConfig& config, std::unique_ptr<AfmPort> port)
    : config_(config),
      port_(std::move(port)),
      lift_nm_(config.lift_nm),
      watch_({config.spring_constant_n_m, config.step_nm,
              std::fabs(config.spring_constant_n_m * config.sensitivity_nm_v), config.range_v,
              ns(config.period_s()), config.sensitivity_nm_v > 0 ? 1 : -1, config.force_max_nn}),
      across_rule_({config.spring_constant_n_m, config.across_n_m, config.lateral_max_nn}),
      along_rule_({config.across_n_m, config.lateral_max_nn, config.along_slope, config.along_part}),
      model_(config.spring_constant_n_m, 0, kContactPart * config.touch_force_nn, config.slope_max),
      account_(config.spring_constant_n_m) {}

double AfmLogic::force_trip_nn() const noexcept {
  return config_.force_max_nn + config_.spring_constant_n_m * 2 * config_.step_nm + 6 * state_.noise_nn;
}

bool AfmLogic::all_connected() const noexcept {
  return std::all_of(connections_.begin(), connections_.end(),
                     [](const Connection& c) { return c.connected; });
}

void AfmLogic::tell(const std::string& line) {
  news_ = line;
  ++news_count_;
}

void AfmLogic::refuse(const std::string& line) {
  if (state_.phase == Phase::kRefused) return;
  refusal_ = line;
  // The checks move nothing; what is found out only by touching ends withdrawn.
  if (state_.phase == Phase::kChecking) {
    state_.phase = Phase::kRefused;
  } else if (!withdrawing()) {
    withdraw(Cause::kController, phase_ns_);
  }
}

void AfmLogic::enter(Phase phase, std::int64_t now_ns) {
  state_.phase = phase;
  phase_ns_ = now_ns;
}

// ---- connections

void AfmLogic::connected(Role role, std::int64_t now_ns) {
  Connection& c = at(role);
  c = {};
  port_->reset(role);
  c.connected = true;
  c.next_ns = now_ns;
  if (role == Role::kEmergency) emergency_ready_ = false;
  if (withdrawing()) {
    if (role == Role::kEmergency) stop_sent_ = withdraw_sent_ = false;
    if (role == Role::kMotion) motion_withdraw_sent_ = false;
  }
}

void AfmLogic::lost(Role role, Loss loss, std::int64_t now_ns) {
  Connection& c = at(role);
  c = {};
  port_->reset(role);
  if (role == Role::kEmergency) emergency_ready_ = false;
  if (state_.phase == Phase::kRefused) return;
  if (state_.phase == Phase::kChecking) {
    const std::string who = "port of " + std::string(name(role)) + ": ";
    refuse(loss == Loss::kGarbage
               ? who + "the program that answers there does not speak the controller's protocol"
           : loss == Loss::kSilent ? who + "the controller does not answer; is another client using it?"
                                   : who + "closed by the controller; is it in use by another client?");
    return;
  }
  if (withdrawing()) return;
  withdraw(loss == Loss::kSilent ? Cause::kSilent : Cause::kConnection, now_ns);
  tell("withdrawing: port of " + std::string(name(role)) +
       (loss == Loss::kSilent    ? " does not answer"
        : loss == Loss::kGarbage ? " does not answer the question"
                                 : " was closed"));
}

bool AfmLogic::take_close(Role role) noexcept {
  Connection& c = at(role);
  const bool close = c.close;
  c.close = false;
  return close;
}

const AfmCommand* AfmLogic::waits_for(Role role) const noexcept {
  return at(role).busy ? &at(role).call : nullptr;
}

std::int64_t AfmLogic::timeout_ns(const Connection& c) const noexcept {
  double s = 1e-3 * config_.reply_timeout_ms;
  if (port_->averages(c.call)) s += 2 * config_.period_s();
  // No reading comes by the emergency port, so no force waits for it: as long as the guard waits for this
  // thread.
  if (&c == &at(Role::kEmergency)) s = std::max(s, 1e-3 * config_.guard_silence_ms());
  // The tip goes up as soon as the controller hears: let that stand.
  if (c.call.op == AfmOp::kWithdraw || c.call.op == AfmOp::kStop) s = std::max(s, 1.0);
  return ns(s);
}

bool AfmLogic::send(Role role, const AfmCommand& command, std::int64_t now_ns, AfmCommand& call) {
  call = command;
  Connection& c = at(role);
  c.busy = true;
  c.call = call;
  c.sent_ns = c.waits_from_ns = now_ns;
  return true;
}

void AfmLogic::sent(Role role, std::int64_t now_ns) noexcept {
  at(role).waits_from_ns = now_ns;
}

bool AfmLogic::next(Role role, std::int64_t now_ns, AfmCommand& call) {
  Connection& c = at(role);
  if (!c.connected || c.busy || now_ns < c.next_ns) return false;
  if (gives_back() && port_->give_back_role(given_back_) == role)
    return send(role, {AfmOp::kGiveBack, {static_cast<double>(given_back_)}}, now_ns, call);
  if (state_.phase == Phase::kRefused) return false;
  if (state_.phase == Phase::kChecking) {
    if (!all_connected() || next_check_ >= port_->setup_steps() || port_->setup_role(next_check_) != role)
      return false;
    return send(role, {AfmOp::kSetup, {static_cast<double>(next_check_)}}, now_ns, call);
  }
  switch (role) {
    case Role::kReads:
      // Up there nothing follows from a reading but that the connection works.
      if (state_.phase == Phase::kWithdrawn) c.next_ns = now_ns + kIdleReadNs;
      return send(role, {AfmOp::kRead}, now_ns, call);
    case Role::kMotion:
      return next_motion(now_ns, call);
    case Role::kData:
      return next_data(now_ns, call);
    case Role::kEmergency:
      return next_emergency(now_ns, call);
  }
  return false;
}

void AfmLogic::answered(Role role, const AfmReading& said, std::int64_t now_ns) {
  Connection& c = at(role);
  if (!c.busy) return;
  AfmReading reading = said;
  // No comparison would hold for it: neither a limit nor an end of a range.
  if (!std::all_of(reading.numbers.begin(), reading.numbers.end(),
                   [](double n) { return std::isfinite(n); })) {
    reading = {};
    reading.refused = "an answer";
    reading.why = "it contains a value that is not a number";
  }
  c.busy = false;
  const AfmOp op = c.call.op;
  const std::int64_t sent_ns = c.sent_ns;
  if (state_.phase == Phase::kChecking) {
    ++next_check_;
    checked(role, reading);
    if (state_.phase != Phase::kChecking || next_check_ != port_->setup_steps()) return;
    if (!unapproved_) return engage(now_ns);
    enter(Phase::kWithdrawn, now_ns);
    state_.cause = Cause::kNotApproved;
    ++state_.latches;
    cleared_ = wish_.clears;
    tell(
        "the last server did not end with the tip withdrawn: it stays up until an operator engages, or runs "
        "telenano-nve afm approve");
    return;
  }
  if (op == AfmOp::kGiveBack) {
    if (gives_back() && c.call.step() == given_back_) ++given_back_;  // also what it does not take
    return;
  }
  if (!reading.refused.empty()) {
    if (!withdrawing()) {
      tell(reading.refused + ": " + reading.why);
      withdraw(Cause::kController, now_ns);
    } else {
      if (op == AfmOp::kWithdraw || op == AfmOp::kStop) stop_sent_ = withdraw_sent_ = false;
      c.next_ns = now_ns + kLookPeriodNs;
    }
    if (op == AfmOp::kAskStatus && role == Role::kEmergency) {
      c.next_ns = now_ns + kEmergencyPeriodNs;
      emergency_ready_ = false;
      if (!std::exchange(emergency_objects_, true)) tell("no approach: " + reading.why);
    }
    return;
  }
  switch (op) {
    case AfmOp::kRead:
      return on_reading(reading, sent_ns, now_ns);
    case AfmOp::kFloor:
      floor_nm_ = asked_floor_nm_;
      return;
    case AfmOp::kAskWatched:
      if (state_.phase == Phase::kFollowing) return watch_safe_tip(reading.numbers[0], sent_ns, now_ns);
      return on_watched(reading.numbers[0]);
    case AfmOp::kAskHeld:
      return on_held(reading, now_ns);
    case AfmOp::kAskStatus:
      if (role == Role::kData) round_trip_ns_ = now_ns - sent_ns;
      if (role == Role::kEmergency) {
        emergency_ready_ = true;
        emergency_objects_ = false;
      }
      c.next_ns = now_ns + (state_.phase == Phase::kWithdrawing ? kLookPeriodNs : kEmergencyPeriodNs);
      return on_status(reading, sent_ns, now_ns);
    case AfmOp::kAskSetpoint:
      return on_setpoint(reading, now_ns);
    case AfmOp::kAskHeight:
      if (role == Role::kMotion) return on_motion(reading, now_ns);
      c.next_ns =
          now_ns + (role == Role::kData || state_.phase == Phase::kWithdrawn ? kDataPeriodNs : kLookPeriodNs);
      return on_height(reading.numbers[0], now_ns);
    default:
      if (role == Role::kMotion) on_motion(reading, now_ns);
  }
}

// ---- watching

bool AfmLogic::next_data(std::int64_t now_ns, AfmCommand& call) {
  if (state_.phase != Phase::kWithdrawing && next_floor(now_ns, call)) return true;
  if (state_.phase == Phase::kWithdrawing || state_.phase == Phase::kWithdrawn)
    return send(Role::kData, {AfmOp::kAskHeight}, now_ns, call);
  if ((state_.phase == Phase::kTaring && !safe_tip_air_known_) ||
      (state_.phase == Phase::kTouching && touch_ == Touch::kCompare && !safe_tip_touch_known_))
    return send(Role::kData, {AfmOp::kAskWatched}, now_ns, call);
  if (state_.phase == Phase::kEngaging && !setpoint_ok_) {
    // The controller may have been started anew since the last approach.
    if (held_asked_ < port_->held_settings())
      return send(Role::kData, {AfmOp::kAskHeld, {static_cast<double>(held_asked_)}}, now_ns, call);
    return send(Role::kData, {AfmOp::kAskSetpoint}, now_ns, call);
  }
  at(Role::kData).next_ns = now_ns + kDataPeriodNs;
  AfmCommand held;
  if (next_held(held)) return send(Role::kData, held, now_ns, call);
  return send(Role::kData, {AfmOp::kAskStatus}, now_ns, call);
}

/// Now and then, instead of the status: what the start has found and set, one after another, and, where the
/// controller watches the force, what it sees.
bool AfmLogic::next_held(AfmCommand& command) {
  const bool watches = port_->capabilities().watches_force;
  const std::size_t all = port_->held_settings() + (watches ? 1 : 0);
  if (all == 0 || ++since_held_ < kHeldEvery) return false;
  since_held_ = 0;
  next_held_ = (next_held_ + 1) % all;
  if (next_held_ < port_->held_settings()) {
    command = {AfmOp::kAskHeld, {static_cast<double>(next_held_)}};
    return true;
  }
  if (state_.phase != Phase::kFollowing || !safe_tip_air_known_) return false;
  command = {AfmOp::kAskWatched};
  return true;
}

void AfmLogic::on_held(const AfmReading& reading, std::int64_t now_ns) {
  if (withdrawing()) return;
  ++held_asked_;
  if (reading.unfit.empty()) return;
  withdraw(Cause::kController, now_ns);
  tell("withdrawing: " + reading.unfit + ": find out who did it, then start the server again");
  refusal_ = news_;
}

/// As deep as the controller shall let any command go: the workspace's depth, once the surface is known;
/// above all else while the tip is withdrawn.
double AfmLogic::wanted_floor_nm(std::int64_t now_ns) const noexcept {
  switch (state_.phase) {
    case Phase::kTaring:
    case Phase::kTouching:
      return contact_height_nm(now_ns) - 2 * config_.lift_nm - 2 * config_.step_nm - kFloorSlack_nm;
    case Phase::kFollowing:
      return contact_height_nm(now_ns) - config_.depth_nm - kFloorSlack_nm;
    case Phase::kWithdrawn:
      return std::min(top_height_nm_, 0.45 * range_z_nm_) - 1;
    default:
      return -0.5 * range_z_nm_;
  }
}

bool AfmLogic::next_floor(std::int64_t now_ns, AfmCommand& call) {
  if (!port_->capabilities().z_limits || ending_ || !refusal_.empty()) return false;  // they are given back
  const double wanted = wanted_floor_nm(now_ns);
  if (std::fabs(wanted - floor_nm_) <= 0.25 * kFloorSlack_nm) return false;
  asked_floor_nm_ = wanted;
  return send(Role::kData, {AfmOp::kFloor, {wanted}}, now_ns, call);
}

void AfmLogic::on_status(const AfmReading& reading, std::int64_t sent_ns, std::int64_t now_ns) {
  if (reading.status == AfmStatus::kProtected) {
    if (!withdrawing()) {
      tell("the controller's SafeTip has withdrawn the tip");
      withdraw(Cause::kSafeTip, now_ns);
    }
    return;
  }
  // The connections overtake each other: what was asked before the controller was off may still say "on".
  const bool off = reading.status == AfmStatus::kOff || sent_ns < off_ns_;
  if ((state_.phase == Phase::kTouching || state_.phase == Phase::kFollowing ||
       state_.phase == Phase::kTaring) &&
      !off) {
    tell(text("the Z controller was switched by someone else (status %g)", reading.numbers[0]));
    withdraw(Cause::kController, now_ns);
  }
}

void AfmLogic::on_setpoint(const AfmReading& reading, std::int64_t now_ns) {
  if (state_.phase != Phase::kEngaging) return;
  const std::string excess = setpoint_excess(reading);
  setpoint_ok_ = excess.empty();
  if (setpoint_ok_) return;
  withdraw(Cause::kForceLimit, now_ns);
  tell("withdrawing: " + excess);
}

void AfmLogic::on_height(double height, std::int64_t now_ns) {
  if (!withdrawing()) return;
  height_nm_ = height;
  const bool is_up = height >= top_height_nm_ - kUpPart * range_z_nm_ - kUpSlack_nm;
  if (state_.phase == Phase::kWithdrawing && is_up) {
    enter(Phase::kWithdrawn, now_ns);
    tell("withdrawn: " + std::string(name(state_.cause)));
  } else if (!is_up && now_ns > withdraw_ns_ + 100 * kMs) {
    // On its way, or brought down again by a command that was late: once more.
    state_.phase = Phase::kWithdrawing;
    withdraw_ns_ = now_ns;
    stop_sent_ = withdraw_sent_ = motion_withdraw_sent_ = false;
    if (now_ns < say_ns_) return;
    say_ns_ = now_ns + kSayNotUpNs;
    tell(
        text("the tip is NOT up: Z = %.1f nm, up is %.1f nm; withdrawing it again; press Withdraw at the "
             "controller",
             config_.z_sign * height, config_.z_sign * top_height_nm_));
  }
}

void AfmLogic::approve(std::int64_t now_ns) {
  if (!awaits_approval()) return;
  approved_ = true;
  tell("an operator has approved an approach");
  state_.time_ns = now_ns;
}

void AfmLogic::forbid(const std::string& why, std::int64_t now_ns) {
  refusal_ = why;
  withdraw(Cause::kController, now_ns);
}

// ---- withdrawing

void AfmLogic::withdraw(Cause cause, std::int64_t now_ns) {
  if (cause == Cause::kExit) {
    ending_ = true;
    if (state_.phase == Phase::kChecking) refuse("ended before the approach");
  }
  if (state_.phase == Phase::kChecking || state_.phase == Phase::kRefused) return;
  if (withdrawing()) {
    if (state_.cause == Cause::kParked && cause != Cause::kParked) {
      state_.cause = cause;
      ++state_.latches;
      cleared_ = wish_.clears;
    }
    return;
  }
  enter(Phase::kWithdrawing, now_ns);
  state_.cause = cause;
  state_.held_by_force = false;
  state_.touching = false;
  if (cause != Cause::kParked) ++state_.latches;
  cleared_ = wish_.clears;
  withdraw_ns_ = now_ns;
  say_ns_ = now_ns + kMayRiseNs;
  stop_sent_ = withdraw_sent_ = motion_withdraw_sent_ = false;
  at(Role::kEmergency).next_ns = now_ns;
  at(Role::kMotion).next_ns = now_ns;
  emergency_ready_ = false;  // to be asked anew
  account_.interrupt();
  tell("withdrawing: " + std::string(name(cause)));
}

bool AfmLogic::next_emergency(std::int64_t now_ns, AfmCommand& call) {
  if (state_.phase == Phase::kWithdrawing) {
    // Stop first would cost its reply's time: up comes before across.
    if (!withdraw_sent_) {
      withdraw_sent_ = true;
      return send(Role::kEmergency, {AfmOp::kWithdraw}, now_ns, call);
    }
    if (!stop_sent_) {
      stop_sent_ = true;
      return send(Role::kEmergency, {AfmOp::kStop}, now_ns, call);
    }
    return send(Role::kEmergency, {AfmOp::kAskHeight}, now_ns, call);
  }
  // Up: is it still, and does a deadman that has the port let it come back?
  if (state_.phase == Phase::kWithdrawn && std::exchange(asks_status_, !asks_status_))
    return send(Role::kEmergency, {AfmOp::kAskHeight}, now_ns, call);
  return send(Role::kEmergency, {AfmOp::kAskStatus}, now_ns, call);
}

void AfmLogic::tick(std::int64_t now_ns, const PortTarget& wish) {
  wish_ = wish;
  state_.time_ns = now_ns;
  for (std::size_t i = 0; i < kRoles; ++i) {
    Connection& c = connections_[i];
    if (!c.busy || now_ns - c.waits_from_ns <= timeout_ns(c)) continue;
    lost(static_cast<Role>(i), Loss::kSilent, now_ns);
    connections_[i].close = true;
  }
  if (state_.phase == Phase::kChecking || state_.phase == Phase::kRefused) return;
  surface_.piezo(height_nm_, now_ns);

  if (withdrawing()) {
    if (state_.phase != Phase::kWithdrawn || !all_connected() || !refusal_.empty() || ending_) return;
    if (!emergency_ready_) return;
    if (approved_ && awaits_approval()) return engage(now_ns);
    const bool wanted = wish_.session != 0 && (wish_.wanted || wish_.follow) && !wish_.retract &&
                        now_ns - wish_.time_ns < ns(1e-3 * config_.link_loss_ms);
    const bool free = state_.cause == Cause::kParked || wish_.clears != cleared_;
    if (wanted && free && state_.cause != Cause::kExit) engage(now_ns);
    return;
  }
  const bool approaching = state_.phase != Phase::kFollowing;
  if (approaching && now_ns > engage_ns_ + ns(config_.timeout_s + config_.touch_pause_s)) {
    withdraw(Cause::kNoSurface, now_ns);
    return;
  }
  if (now_ns - reading_ns_ > ns(config_.stale_force_s())) {
    withdraw(Cause::kStaleForce, now_ns);
    return;
  }
  if (wish_.retract && now_ns - wish_.time_ns < ns(1e-3 * config_.link_loss_ms)) {
    withdraw(Cause::kStop, now_ns);
    return;
  }
  if (wish_.session == 0) {
    if (!approaching && now_ns > session_ns_ + ns(config_.park_after_s)) withdraw(Cause::kParked, now_ns);
  } else if (now_ns - wish_.time_ns > ns(1e-3 * config_.link_loss_ms)) {
    withdraw(Cause::kLinkLoss, now_ns);
  }
}

}  // namespace telenano::afm
