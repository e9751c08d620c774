#include "telenano/master/app/run/run_metrics.h"

#include "telenano/common/base/version.h"

namespace telenano::app {
namespace {

double number(std::uint64_t count) {
  return static_cast<double>(count);
}

void write_link(const link::LinkQuality& q, metrics::Page& page) {
  page.gauge("telenano_link_rtt_seconds", "Smoothed round trip (RFC 6298), without the server's hold time",
             1e-6 * q.rtt_us);
  page.gauge("telenano_link_rtt_min_seconds", "Least round trip so far", 1e-6 * q.rtt_min_us);
  page.gauge("telenano_link_jitter_seconds", "Interarrival jitter of the replies (RFC 3550)",
             1e-6 * q.jitter_us);
  page.gauge("telenano_link_excess_seconds", "Newest exchange: one-way delay above the least",
             1e-6 * q.up_excess_us, {{"way", "up"}});
  page.gauge("telenano_link_excess_seconds", "", 1e-6 * q.down_excess_us, {{"way", "down"}});
  page.gauge("telenano_link_clock_offset_seconds",
             "Server's clock minus the station's, right within half of the least round trip",
             1e-6 * q.offset_us);
  page.gauge("telenano_link_clock_drift_ppm", "Server's clock against the station's", q.drift_ppm);
  page.gauge("telenano_link_clock_drift_error_ppm", "Standard error of the drift", q.drift_error_ppm);
  page.gauge("telenano_link_force_age_seconds", "Time since the slave measured the newest force",
             1e-3 * q.force_age_ms);
  page.counter("telenano_link_commands_total", "Commands sent", number(q.commands_sent));
  page.counter("telenano_link_commands_lost_total", "Commands that the server did not get, or not in time",
               number(q.commands_lost));
  page.counter("telenano_link_replies_total", "Replies that came", number(q.replies));
  page.counter("telenano_link_replies_lost_total", "Replies that did not come", number(q.replies_lost));
  page.counter("telenano_link_replies_left_out_total",
               "Replies that the server left out, their force within the deadband",
               number(q.replies_left_out));
  page.counter("telenano_link_replies_reordered_total", "Replies that a newer one had overtaken",
               number(q.reordered));
  page.counter("telenano_link_replies_duplicate_total", "Replies that came again", number(q.duplicates));
  page.counter("telenano_link_drops_total", "Datagrams not used, for any cause", number(q.dropped));
}

}  // namespace

void write_metrics(const Progress& p, metrics::Page& page) {
  page.gauge("telenano_build_info", "Always 1; the labels say what is running", 1,
             {{"version", kVersion}, {"commit", kGitCommit}});
  for (const auto mode : {station::Mode::kIdle, station::Mode::kReady, station::Mode::kEngaged,
                          station::Mode::kHeld, station::Mode::kStopped}) {
    page.gauge("telenano_station_mode", "1 for the mode that the station is in",
               p.mode == static_cast<std::uint32_t>(mode) ? 1 : 0, {{"mode", station::mode_name(mode)}});
  }
  page.counter("telenano_sessions_total", "Sessions begun or resumed", number(p.sessions));
  page.counter("telenano_ticks_total", "Ticks of the loop", static_cast<double>(p.ticks));
  page.counter("telenano_overruns_total", "Ticks whose work was not done at the next deadline",
               number(p.overruns));
  page.counter("telenano_missed_ticks_total", "Ticks that were left out", number(p.missed_ticks));
  page.gauge("telenano_station_faults", "Bits of the station's faults", p.station_faults);
  page.gauge("telenano_slave_faults", "Bits of the slave's faults", p.slave_faults);
  page.gauge("telenano_force_newtons", "Force on the tip, along the sample's normal", 1e-9 * p.force_nn);
  page.gauge("telenano_hand_force_newtons", "Force sent to the hand", p.hand_force_n);
  page.gauge("telenano_port_energy_joules", "Energy that the hand has put into the port and not got back",
             p.energy_j);
  page.gauge("telenano_silent_seconds", "Time since the newest reply", p.silent_s);
  page.gauge("telenano_playout_delay_seconds",
             "Delay from command to force; 0 = the newest reply is shown at once", 1e-3 * p.playout_delay_ms);
  page.counter("telenano_playout_late_total", "Replies too late to be played out", number(p.playout_late));
  page.counter("telenano_commands_held_total", "Commands not sent, within the deadband",
               number(p.commands_held));
  page.gauge("telenano_reply_deadband_ratio",
             "Change of force without a reply that the server was told last, as a share of the force",
             1e-3 * p.reply_deadband_permille);
  page.gauge("telenano_send_rate_hz", "Datagrams per second that are sent", p.send_hz);
  for (const auto reason :
       {link::RateReason::kFull, link::RateReason::kStart, link::RateReason::kQueue, link::RateReason::kLoss,
        link::RateReason::kSilence, link::RateReason::kRising, link::RateReason::kFixed}) {
    page.gauge("telenano_send_rate_reason", "1 for the reason of the present rate",
               p.send_reason == reason ? 1 : 0, {{"reason", link::name(reason)}});
  }
  page.counter("telenano_send_rate_lowered_total", "Times that a queue, losses or silence lowered the rate",
               number(p.send_lowered));
  write_link(p.link, page);
}

}  // namespace telenano::app
