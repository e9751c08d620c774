#include "telenano/master/app/run/run_text.h"

#include <fmt/format.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <set>

#include "telenano/common/config/print.h"
#include "telenano/common/link/fault_names.h"
#include "telenano/master/station/station.h"

namespace telenano::app {

void print_progress(const Progress& p, double duration_s, bool terminal) {
  std::string line = fmt::format(
      "{:5.1f}{} s  {:<8} tip {:8.2f} nm  force {:8.2f} nN  hand {:6.2f} N  energy {:7.2f} mJ  "
      "RTT {:5.0f} us, least {:.0f}, jitter {:.0f}  lost {} up {} down  age {:.1f} ms  clock {:+.0f} ppm",
      p.time_s, duration_s > 0 ? fmt::format("/{:.1f}", duration_s) : "",
      station::mode_name(static_cast<station::Mode>(p.mode)), p.tip_height_nm, p.force_nn, p.hand_force_n,
      p.energy_j * 1e3, p.link.rtt_us, p.link.rtt_min_us, p.link.jitter_us, p.link.commands_lost,
      p.link.replies_lost, p.link.force_age_ms, p.link.drift_ppm);
  if (p.send_hz < p.send_full_hz)
    line += fmt::format("  sending {:.0f} of {:.0f} Hz: {}", p.send_hz, p.send_full_hz,
                        link::name(p.send_reason));
  if (p.reply_deadband_permille > 0 || p.link.replies_left_out > 0)
    line += fmt::format("  {} replies left out", p.link.replies_left_out);
  if (p.playout_delay_ms > 0)
    line += fmt::format("  play-out {:.1f} ms, late {}", p.playout_delay_ms, p.playout_late);
  if (p.twin == station::TwinState::kApart)
    line += "  twin: apart from the server, taking up its state";
  else if (p.twin == station::TwinState::kGivenUp)
    line += "  twin: given up";
  else if (p.twin == station::TwinState::kWaits)
    line += p.observes ? "" : "  twin: takes up the tip's state";
  else if (p.twin != station::TwinState::kNone)
    line += fmt::format("  twin: {} steps ahead", p.twin_behind);
  if (p.force_off != device::ForceOffCause::kNone)
    line += fmt::format("  no force: {}", device::force_off_text(p.force_off));
  if (p.observes) line += "  observing: another session holds the tip, or none";
  if (p.tip_up) {
    line += (p.slave_faults & link::kFaultApproaching) != 0
                ? "  the tip is on its way to the sample: no force"
                : "  the tip is withdrawn: no force";
  }
  if (p.shutting_down) line += "  server has shut down, trying again";
  if ((p.station_faults & station::kFaultOld) != 0) line += "  the round trip is too long: force is zero";
  if ((p.slave_faults & link::kFaultShare) != 0)
    line += "  beyond this session's share of the server: the tip lags";
  if (p.silent_s > 0.1) line += fmt::format("  server silent for {:.1f} s: force is zero", p.silent_s);
  if (terminal) {
    config::print(stderr, "\r{:<190}", line);
    std::fflush(stderr);
  } else {
    config::print(stderr, "{}\n", line);
  }
}

static const char* why_no_twin(station::TwinEnd end) noexcept {
  switch (end) {
    case station::TwinEnd::kUnconfirmed:
      return "the server answers, but neither confirms its slave's state nor sends it";
    case station::TwinEnd::kNotFinite:
      return "the twin computed a value that is not a number";
    case station::TwinEnd::kRefused:
      return "the state of the server's slave cannot be fetched";
    case station::TwinEnd::kParted:
    case station::TwinEnd::kNone:
      break;
  }
  return "the server's slave does not do what its scene does here";
}

void print_changes(const Progress& before, const Progress& now, bool terminal) {
  const char* const end_of_line = terminal ? "\n" : "";
  if (before.twin != now.twin && now.twin == station::TwinState::kGivenUp) {
    config::print(stderr, "{}note: {}: no twin from now on, method model\n", end_of_line,
                  why_no_twin(now.twin_end));
  }
  if (before.observes != now.observes) {
    config::print(stderr, "{}{}\n", end_of_line,
                  now.observes ? "another session holds the tip, or none: observing, the force is zero"
                               : "the tip is this session's");
  }
  if (before.tip_up != now.tip_up) {
    config::print(stderr, "{}{}\n", end_of_line,
                  now.tip_up ? "the slave has withdrawn the tip: the force is zero until it is back"
                             : "the tip is back: it follows from where it is");
  }
  constexpr std::uint32_t kOld = station::kFaultOld;
  if (((before.station_faults ^ now.station_faults) & kOld) != 0) {
    config::print(stderr, "{}{}\n", end_of_line,
                  (now.station_faults & kOld) != 0
                      ? "the round trip is too long for this method: the force fades, the tip holds"
                      : "the round trip is short enough again: the force comes back");
  }
  if (before.ticks > 0 && before.method != now.method && now.chooses_method) {
    config::print(stderr, "{}method {} from now on: the round trip is {:.1f} ms\n", end_of_line,
                  control::method_name(now.method), 1e-3 * now.link.rtt_us);
  }
  if (before.twin_left != now.twin_left) {
    config::print(
        stderr,
        "{}the stiffness was planned for the twin, which is not felt any more: the force fades, and comes "
        "back with force scale {:.4g}\n",
        end_of_line, now.force_scale_without_twin);
  }
  if (before.planned_delay_s > 0 && now.planned_delay_s > 0 &&
      before.planned_delay_s != now.planned_delay_s) {
    config::print(
        stderr,
        "{}force scale {:.4g} from now on, planned for {:.4g} ms from hand to force: the round trip "
        "is {:.1f} ms\n",
        end_of_line, now.force_scale, 1e3 * now.planned_delay_s, 1e-3 * now.link.rtt_us);
  }
  if (!before.shutting_down && now.shutting_down) {
    config::print(stderr, "{}the server is shutting down: the force is zero, trying to reach it again\n",
                  end_of_line);
  }
  if (before.epoch != 0 && now.epoch != 0 && before.epoch != now.epoch) {
    config::print(stderr, "{}the server has lost the session, as after a restart: this is a new one\n",
                  end_of_line);
  }
}

void print_sending(const Progress& last) {
  config::print(stderr, "  {:<36} {:.0f} Hz at the end ({}), {:.0f} at least, {} times lowered\n",
                "datagrams sent", last.send_hz, link::name(last.send_reason), last.send_least_hz,
                last.send_lowered);
  if (last.link.replies_left_out > 0)
    config::print(stderr, "  {:<36} {} of {}, their force within the deadband\n", "replies left out",
                  last.link.replies_left_out,
                  last.link.replies_left_out + last.link.replies + last.link.replies_lost);
}

std::string slave_fault_names() {
  std::string names;
  for (const char* name : link::kFaultNames) names += (names.empty() ? "" : "; ") + std::string(name);
  return names;
}

std::string station_fault_names() {
  std::string names;
  for (std::uint32_t bit = 0; std::strcmp(station::fault_name(1u << bit), "none") != 0; ++bit)
    names += (bit == 0 ? "" : "; ") + std::string(station::fault_name(1u << bit));
  return names;
}

std::vector<std::string> end_lines(const std::string& failure, recording::Summary summary) {
  summary.slave_fault_names = slave_fault_names();
  summary.station_fault_names = station_fault_names();
  // Of some thirty lines those that a person at a window asks about; the others are on standard error.
  const std::set<std::string> told = {"duration",     "pull-off force",   "largest attraction",
                                      "largest push", "greatest depth",   "in contact",
                                      "faults",       "hand force, peak", "round trip p50 / p99 / max"};
  std::vector<std::string> lines{failure.empty() ? "the task is done" : failure};
  for (const auto& [name, value] : recording::summary_lines(summary))
    if (told.contains(name)) lines.push_back(name + ": " + value);
  return lines;
}

void print_summary(recording::Summary summary, const rt::PeriodicTimerStats& timer,
                   const recording::Recorder* recorder, const std::string& path) {
  summary.overruns = static_cast<std::int64_t>(timer.overruns);
  summary.missed_ticks = static_cast<std::int64_t>(timer.missed);
  summary.slave_fault_names = slave_fault_names();
  summary.station_fault_names = station_fault_names();
  if (recorder != nullptr) summary.rows_dropped = recorder->rows_dropped();
  config::print(stderr, "summary of {:.1f} s\n{}", summary.duration_s, recording::summary_text(summary));
  if (recorder == nullptr) return;
  config::print(stderr, "  {:<36} {}: {} rows{}{}\n", "recording", path, recorder->rows_written(),
                recorder->failed() ? "; stopped early: " : "", recorder->failed() ? recorder->failure() : "");
}

}  // namespace telenano::app
