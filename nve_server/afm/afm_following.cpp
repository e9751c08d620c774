// AfmLogic: following commands within what the force allows, and what the readings say.
#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm/afm_units.h"

namespace telenano::afm {

namespace {

constexpr std::int64_t kBoundsNs = 60 * kMs;  // so long a false reading moves nothing down

}  // namespace

/// How high the ground may be, by what is known of it: that of the last touch, two steps, and not so high
/// that a signal that may rest for ever would never be let down to it.
double AfmLogic::top_of_ground_nm() const noexcept {
  return std::min(2 * config_.step_nm, 0.5 * config_.force_max_nn / config_.spring_constant_n_m);
}

/// No single reading lets the tip go down: while a signal that dips shows less force than there is, what was
/// read before it still holds.
double AfmLogic::lowest_allowed_nm(std::int64_t now_ns) const noexcept {
  const Stood newest = stood(now_ns);
  return std::max(newest.high_nm - newest.down_nm, bounds_.highest_nm());
}

/// What the newest reading will still say when others have come.
void AfmLogic::keep_bound(std::int64_t now_ns) noexcept {
  Stood reading = stood(now_ns);
  // In the air it says nothing of the way down to the ground that is known: else the tip would fall no faster
  // than by what the limit bends the lever, each kBoundsNs.
  if (state_.measured_force_w_nn.z() < model_.contact_threshold_nn())
    reading.high_nm = std::min(reading.high_nm, ground_nm_ + top_of_ground_nm());
  // While the base moves, the reading may be of any height that it had; as long as what is known lies among
  // them it is only confirmed. Else each step down to the limit would hold the tip up where it began.
  const std::int64_t half_ns = ns(0.5 * config_.period_s());
  const double mean_nm =
      history_.between(state_.measured_ns - half_ns, state_.measured_ns + half_ns).mean_w_nm.z();
  const double low_nm = std::min(reading.low_nm, reading.high_nm);
  const double high_nm = std::clamp(mean_nm, low_nm, reading.high_nm);
  const double bound_nm =
      std::clamp(bounds_.highest_nm(), low_nm - reading.down_nm, high_nm - reading.down_nm);
  // The reading that comes kBoundsNs later takes its place, be it a little early.
  bounds_.add(now_ns, bound_nm, kBoundsNs - half_ns);
}

AfmLogic::Stood AfmLogic::stood(std::int64_t now_ns) const noexcept {
  const MotionHistory::Stretch since = history_.between(reading_from_ns_, now_ns);
  const double k = config_.spring_constant_n_m;
  const double force_nn = state_.measured_force_w_nn.z();
  double most_nn = std::min(config_.force_max_nn, along_rule_.force_down_nn(state_.model.adhesion_nn));
  // Where the tip must not touch at all it goes up as far as no ground is, no further.
  if (!near_ground()) most_nn = std::max(0.0, most_nn);
  const double left_nn = most_nn - force_nn;
  double highest_nm = since.highest_nm, across_nm = since.path_across_nm;
  if (watch_.repeats() > 0) {
    highest_nm = std::max(highest_nm, watch_.highest_nm());
    across_nm += watch_.across_nm();
    if (force_nn < model_.contact_threshold_nn()) {
      highest_nm = std::min(highest_nm, std::max(top_of_ground_nm(), since.highest_nm));
      across_nm = since.path_across_nm;
    }
  }
  return {since.lowest_nm, highest_nm, left_nn / k - slope() * across_nm};
}

double AfmLogic::lowest_by_lateral_nm(std::int64_t now_ns) const noexcept {
  if (config_.relief_nm <= 0) return -config_.depth_nm;
  return std::min(across_rule_.lowest_nm(sent_w_nm_, since_lateral(now_ns)), clear_nm());
}

/// What the force down may rise by across, by what the base would have to.
double AfmLogic::slope() const noexcept {
  return near_ground() ? std::max(config_.slope_max, across_rule_.slope()) : config_.slope_max;
}

AcrossRule::Since AfmLogic::since_lateral(std::int64_t now_ns) const noexcept {
  const MotionHistory::Stretch since = history_.between(lateral_from_ns_, now_ns);
  return {since.low_w_nm, since.high_w_nm, state_.measured_force_w_nn.x()};
}

/// False when the signal shows that it is none; the tip is then on its way up.
bool AfmLogic::plausible(double volts, double lateral_volts, std::int64_t from_ns, std::int64_t now_ns) {
  SignalWatch::Reading r;
  r.time_ns = now_ns;
  r.volts = volts;
  r.lateral_volts = lateral_volts;
  r.force_nn = state_.measured_force_w_nn.z();
  r.contact_nn = model_.contact_threshold_nn();
  r.still_across = state_.phase != Phase::kFollowing && state_.phase != Phase::kLifting;
  if (state_.phase == Phase::kTouching || state_.phase == Phase::kFollowing) {
    const MotionHistory::Stretch since = history_.between(from_ns, now_ns);
    const MotionHistory::Stretch moved = history_.between(std::min(reading_from_ns_, from_ns), now_ns);
    r.highest_nm = since.highest_nm;
    r.lowest_nm = since.lowest_nm;
    r.base_nm = history_.between(from_ns, from_ns).mean_w_nm.z();
    r.way_nm = moved.path_nm;
    r.across_nm = moved.path_across_nm;
    if (state_.phase == Phase::kFollowing) r.stiffness_n_m = contact_stiffness_n_m_;
  }
  const SignalFault fault = watch_.add(r);
  if (fault == SignalFault::kNone) return true;
  withdraw(Cause::kSignal, now_ns);
  tell("withdrawing: the deflection's signal: " + std::string(name(fault)));
  return false;
}

namespace {

constexpr int kLateralRepeats = 40;   // readings in a row
constexpr int kHighReadings = 20;     // likewise
constexpr double kZeroPart = 0.1;     // of the force limit
constexpr double kShift_nm_s = 1;     // no hand feels that
constexpr double kCurvedPart = 0.05;  // of the way to the force of a touch: contacts are no springs
constexpr std::int64_t kAgainNs = 1'000'000'000;  // sooner a touch tells nothing new

}  // namespace

/// Where no ground can be, by what was touched and by the operator's word (`relief_nm`), and above where the tip
/// came off, there is no force: what is read there as a pull is the zero that has moved since the tare, and
/// any force is taken for smaller by as much. True where that is more than a tenth of the limit; the tip is
/// then on its way up, and the next approach tares anew. What is read as a push errs on the safe side.
bool AfmLogic::zero_moved(std::int64_t now_ns) {
  const double free_nm = std::max(ground_nm_ + 0.9 * lift_nm_, clear_nm());
  if (history_.between(reading_from_ns_, now_ns).low_w_nm.z() < free_nm) {
    high_readings_ = 0;
    return false;
  }
  if (high_readings_ == 0) high_sum_nn_ = 0;
  high_sum_nn_ += state_.measured_force_w_nn.z();
  if (++high_readings_ < kHighReadings) return false;
  const double mean_nn = high_sum_nn_ / std::exchange(high_readings_, 0);
  if (mean_nn > -std::max(kZeroPart * config_.force_max_nn, 0.5 * config_.touch_force_nn)) return false;
  withdraw(Cause::kSignal, now_ns);
  tell(text(
      "withdrawing: the deflection's zero has moved since the tare: high above the sample it shows %.4g nN",
      mean_nn));
  return true;
}

/// The base where the force of a touch is passed, slowly, on the way down: there the ground is measured. W's
/// zero then moves, slowly, to where it is now believed.
void AfmLogic::retouch(const Vec3& base_w_nm, double force_nn, double way_nm, std::int64_t now_ns) {
  const double from_nn = std::exchange(last_force_nn_, force_nn);
  const double touch_nn = config_.touch_force_nn;
  if (from_nn >= touch_nn || force_nn < touch_nn || force_nn > 3 * touch_nn || way_nm > config_.step_nm ||
      now_ns - touch_ns_ < kAgainNs)
    return;
  touch_ns_ = now_ns;
  const double beyond_nm = (force_nn - touch_nn) / std::max(contact_stiffness_n_m_, model_.stiffness_n_m());
  const double touch_height_nm =
      base_w_nm.z() + contact_height_nm(now_ns) + touch_nn / contact_stiffness_n_m_ + beyond_nm;
  const double before_nm = surface_.height_nm(now_ns);
  surface_.touch(base_w_nm.x(), base_w_nm.y(), touch_height_nm, kCurvedPart * beyond_nm, now_ns);
  shift_nm_ += surface_.height_nm(now_ns) - before_nm;
}

// Only off the sample: under load the base would do work that no hand has asked for, and the tank of a
// session over a delay pays for that.
void AfmLogic::slew_surface(std::int64_t now_ns) noexcept {
  const std::int64_t since_ns = now_ns - std::exchange(shifted_ns_, now_ns);
  if (state_.touching) return;
  const double may_nm = kShift_nm_s * 1e-9 * static_cast<double>(since_ns);
  const double shift_nm = std::clamp(shift_nm_, -may_nm, may_nm);
  shift_nm_ -= shift_nm;
}

/// Of the way along the lever, `along_nm`, keeps what may be made near the ground.
void AfmLogic::hold_along(bool told, double& along_nm) {
  const double may_nm = along_rule_.allowed_nm(sent_w_nm_.y(), along_nm, free_y_nm_);
  const double least_nm = 1e-3 * config_.step_nm;
  if (told && std::fabs(along_nm - may_nm) > least_nm) {
    state_.held_by_force = true;
    if (!std::exchange(along_told_, true)) {
      tell(
          text("held along the lever, where no signal shows the force: after %.2g nm the tip goes no further "
               "while it is nearer than %g nm to the ground (give along_slope if you know how steep the "
               "sample is)",
               along_rule_.way_nm(), config_.relief_nm));
    }
  }
  along_nm = may_nm;
}

bool AfmLogic::next_move(std::int64_t now_ns, AfmCommand& call) {
  if (!state_.force_known) return false;
  slew_surface(now_ns);
  const bool told = wish_.session != 0 && wish_.follow;
  const Vec3 low(-config_.half_width_nm, -config_.half_width_nm, -config_.depth_nm);
  const Vec3 high(config_.half_width_nm, config_.half_width_nm, config_.top_nm);
  const Vec3 target = told ? Vec3(wish_.target_w_nm.cwiseMax(low).cwiseMin(high)) : sent_w_nm_;
  const double by_force = lowest_allowed_nm(now_ns);
  const double lowest = std::max(by_force, lowest_by_lateral_nm(now_ns));
  state_.held_by_force =
      told && (target.z() < by_force || (near_ground() && across_rule_.held(since_lateral(now_ns))));
  const double reach = [&](std::int64_t last_ns) {
    return std::min(config_.step_nm, config_.speed_nm_s * 1e-9 * static_cast<double>(now_ns - last_ns));
  }(last_move_ns_);
  const double up = std::max(target.z(), lowest) - sent_w_nm_.z();
  Eigen::Vector2d across = (target - sent_w_nm_).head<2>();
  if (!near_ground()) {
    free_y_nm_ = sent_w_nm_.y();
  } else {
    hold_along(told, across.y());
  }
  const double back_nm = near_ground() ? across_rule_.back_nm(sent_w_nm_, since_lateral(now_ns)) : 0;
  if (back_nm != 0) across = Eigen::Vector2d(back_nm, 0);
  // What lies within a thousandth of a step is there.
  const double least = 1e-3 * config_.step_nm;
  const bool wants_across = across.norm() > least;
  // Holding still along Z must be told too, as the rig drifts.
  const double stale_z = std::fabs(sent_w_nm_.z() + contact_height_nm(now_ns) - height_nm_);
  const bool wants_z = std::fabs(up) > least || stale_z > 0.05 * config_.step_nm;
  if (wants_across && (across_next_ || !wants_z)) {
    const double may =
        std::min(config_.step_nm, config_.speed_nm_s * 1e-9 * static_cast<double>(now_ns - last_xy_ns_));
    Vec3 move(across.x(), across.y(), 0);
    if (move.norm() > may) move *= may / move.norm();
    if (near_ground()) move = across_rule_.allowed(sent_w_nm_, move, since_lateral(now_ns));
    // Ground may rise under a move across: not where that could pass the limit before it is read.
    const double room_nm = sent_w_nm_.z() - slope() * move.norm() - by_force;
    const bool room = room_nm >= 0;
    across_next_ = false;
    if (move.norm() > least && room) {
      sent_w_nm_ += move;
      last_xy_ns_ = now_ns;
      history_.add(now_ns, sent_w_nm_);
      state_.base_w_nm = sent_w_nm_;
      return send(Role::kMotion,
                  {AfmOp::kMoveXy, {start_x_nm_ + sent_w_nm_.x(), start_y_nm_ + sent_w_nm_.y()}}, now_ns,
                  call);
    }
    // Where a slope that is known holds the force down, a hand that presses on would never be led: it goes up to
    // make room.
    if (move.norm() > least && along_rule_.slope_known() && std::min(reach, -room_nm) > 0) {
      across_next_ = true;
      last_move_ns_ = now_ns;
      return send_z(sent_w_nm_.z() + std::min(reach, least - room_nm), now_ns, call);
    }
  }
  if (!wants_z || !(reach > least)) {
    across_next_ = true;
    return false;
  }
  across_next_ = true;
  last_move_ns_ = now_ns;
  return send_z(sent_w_nm_.z() + std::clamp(up, -reach, reach), now_ns, call);
}

void AfmLogic::on_reading(const AfmReading& reading, std::int64_t sent_ns, std::int64_t now_ns) {
  if (reading.kind != ReadingKind::kSignals) return withdraw(Cause::kController, now_ns);
  const double lateral_volts = reading.numbers[1];
  const double deflection_nm = reading.numbers[2], lateral_nn = reading.numbers[3];
  const std::int64_t period_ns = ns(config_.period_s());
  const bool free = state_.phase == Phase::kEngaging || state_.phase == Phase::kLifting;
  const double zero_nm = free ? free_deflection_nm_ : tare_nm_;
  state_.measured_force_w_nn = Vec3(free ? 0 : lateral_nn - tare_lateral_nn_, 0,
                                    config_.spring_constant_n_m * (deflection_nm - zero_nm));
  // The middle of the averaging, and the way back: half a round trip, as a question shows that is answered at
  // once, or what this one took beyond the whole period that it may have waited.
  const std::int64_t round_trip_ns = std::max(round_trip_ns_, now_ns - sent_ns - period_ns);
  state_.measured_ns = now_ns - period_ns / 2 - round_trip_ns / 2;
  state_.force_known = true;
  if (!withdrawing() &&
      !plausible(deflection_nm / config_.sensitivity_nm_v, lateral_volts, sent_ns - period_ns, now_ns))
    state_.force_known = false;
  reading_from_ns_ = sent_ns - period_ns;
  if (std::exchange(lateral_volts_, lateral_volts) != lateral_volts) {
    lateral_from_ns_ = reading_from_ns_;
    lateral_repeats_ = 0;
    lateral_told_ = false;
  } else if (++lateral_repeats_ >= kLateralRepeats && state_.phase == Phase::kFollowing &&
             config_.relief_nm > 0 && !std::exchange(lateral_told_, true)) {
    tell(
        text("the lateral signal stands still: the tip goes no nearer to the ground than %g nm (relief_nm = "
             "0 works without this signal)",
             config_.relief_nm));
  }
  reading_ns_ = now_ns;
  if (withdrawing()) return;
  if (state_.phase == Phase::kTaring) return tare(deflection_nm, lateral_nn, sent_ns, now_ns);

  const Vec3& force = state_.measured_force_w_nn;
  if (force.z() > force_trip_nn()) {
    withdraw(Cause::kForceLimit, now_ns);
    return tell(
        text("withdrawing: force %.4g nN, over the limit of %.4g nN", force.z(), config_.force_max_nn));
  }
  if (std::fabs(force.x()) > config_.lateral_max_nn) {
    withdraw(Cause::kLateralLimit, now_ns);
    return tell(text("withdrawing: lateral force %.4g nN, over the limit of %.4g nN", force.x(),
                     config_.lateral_max_nn));
  }
  keep_bound(now_ns);
  if (state_.phase == Phase::kTouching) return touch_reading(sent_ns, now_ns);
  if (state_.phase != Phase::kFollowing || zero_moved(now_ns)) return;

  const MotionHistory::Stretch averaged = history_.between(now_ns - period_ns, now_ns);
  state_.measured_base_w_nm = averaged.mean_w_nm;
  model_.add(averaged.mean_w_nm, force.z(), now_ns);
  state_.model = model_.model();
  state_.touching = model_.touching();
  // What pushes is ground; a pull in the air may be a zero that has moved.
  if (state_.touching && force.z() > 0)
    ground_nm_ = std::max(ground_nm_, averaged.mean_w_nm.z() + force.z() / config_.spring_constant_n_m);
  retouch(averaged.mean_w_nm, force.z(), history_.between(now_ns - 2 * period_ns, now_ns).path_nm, now_ns);
  WorkAccount::Reading entry;
  entry.base_w_nm = averaged.mean_w_nm;
  entry.force_w_nn = force;
  entry.way_nm = history_.between(last_account_ns_, now_ns).path_nm;
  entry.window_way_nm = history_.between(reading_from_ns_, now_ns).path_nm;
  const bool touches =
      state_.touching || was_touching_ || std::fabs(force.z()) > model_.contact_threshold_nn();
  account_.add(entry, 3 * state_.noise_nn, touches, model_.model().adhesion_nn);
  was_touching_ = state_.touching;
  last_account_ns_ = now_ns - period_ns;
  state_.surface_bound_nm = surface_.bound_nm(now_ns) + std::fabs(shift_nm_);
  state_.drift_nm_s = surface_.drift_nm_s();
  state_.drift_bound_nm_s = surface_.drift_bound_nm_s();
  state_.energy_in_aj = account_.energy_in_aj();
  state_.energy_out_aj = account_.energy_out_aj();
  state_.energy_bound_aj = account_.bound_aj();
}

}  // namespace telenano::afm
