#include "telenano/master/station/station.h"

#include <algorithm>

namespace telenano::station {

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

}  // namespace telenano::station
