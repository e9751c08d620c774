#include "master/app/run_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "common/link/messages.h"

namespace telenano::app {

void RunSummary::add(const recording::Sample& s) noexcept {
  ++ticks_;
  const bool contact = s.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
  if (contact) {
    ++contact_ticks_;
    if (!touched_) {
      touched_ = true;
      surface_touch_nm_ = s.tip_pos_w_nm[2];
    }
    lowest_tip_nm_ = std::min(lowest_tip_nm_, s.tip_pos_w_nm[2]);
  }
  if ((s.limit_flags & (recording::kLimitDamper | recording::kLimitClamp)) != 0) ++controlled_ticks_;
  pull_off_nn_ = std::min(pull_off_nn_, s.force_w_nn[2]);
  push_nn_ = std::max(push_nn_, s.force_w_nn[2]);
  const auto& f = s.hand_force_applied_h_n;
  hand_force_n_ = std::max(hand_force_n_, std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
  if (s.reply_sequence != last_reply_) rtt_.add(static_cast<std::int64_t>(s.rtt_us * 1e3));
  last_reply_ = s.reply_sequence;
  step_.add(static_cast<std::int64_t>(s.step_us * 1e3));
  last_ = s;
}

void RunSummary::print(const rt::PeriodicTimerStats& timer, const link::ClientSession& session,
                       const recording::Recorder* recorder, const std::string& recording_path) const {
  const auto us = [](std::int64_t ns) { return static_cast<double>(ns) * 1e-3; };
  const auto row = [](const char* what, const std::string& value) { fmt::print(stderr, "  {:<20}{}\n", what, value); };
  const double ticks = static_cast<double>(std::max<std::int64_t>(ticks_, 1));
  fmt::print(stderr, "summary of {:.1f} s, {} ticks\n", static_cast<double>(ticks_) / rate_hz_, ticks_);
  if (touched_) {
    row("pull-off force", fmt::format("{:.2f} nN", -pull_off_nn_));
    row("largest push", fmt::format("{:.2f} nN", push_nn_));
    row("depth", fmt::format("{:.2f} nm below where the tip first met the sample", surface_touch_nm_ - lowest_tip_nm_));
    row("in contact", fmt::format("{:.1f} % of the time", 100.0 * static_cast<double>(contact_ticks_) / ticks));
  } else {
    row("contact", "none");
    row("largest attraction", fmt::format("{:.3f} nN", -pull_off_nn_));
  }
  row("hand force, peak", fmt::format("{:.2f} N", hand_force_n_));
  row("energy", fmt::format("{:.3f} mJ put in, {:.3f} mJ given back, book {:+.3f} mJ", last_.energy_in_j * 1e3,
                            last_.energy_out_j * 1e3, last_.energy_j * 1e3));
  row("controller", fmt::format("acted in {:.2f} % of the ticks", 100.0 * static_cast<double>(controlled_ticks_) / ticks));
  row("round trip", fmt::format("p50 {:.0f}, p99 {:.0f}, max {:.0f} us", us(rtt_.percentile_ns(0.5)),
                                us(rtt_.percentile_ns(0.99)), us(rtt_.max_ns())));
  row("replies", fmt::format("{} received, {} lost, {} reordered, {} duplicates, {} dropped", session.replies().received(),
                             session.replies().lost(), session.replies().reordered(), session.replies().duplicate(),
                             session.drops().total()));
  row("loop lateness", fmt::format("p50 {:.0f}, p99 {:.0f}, max {:.0f} us; {} overruns, {} ticks missed",
                                   us(timer.lateness.percentile_ns(0.5)), us(timer.lateness.percentile_ns(0.99)),
                                   us(timer.lateness.max_ns()), timer.overruns, timer.missed));
  row("work in a tick", fmt::format("p50 {:.1f}, p99 {:.1f} us", us(step_.percentile_ns(0.5)), us(step_.percentile_ns(0.99))));
  if (recorder != nullptr) {
    row("recording", fmt::format("{}: {} rows, {} dropped{}{}", recording_path, recorder->rows_written(),
                                 recorder->rows_dropped(), recorder->failed() ? "; stopped early: " : "",
                                 recorder->failed() ? recorder->failure() : ""));
  }
}

}  // namespace telenano::app
