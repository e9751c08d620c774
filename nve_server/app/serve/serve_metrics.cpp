#include "telenano/nve_server/app/serve/serve_metrics.h"

#include <algorithm>
#include <array>
#include <memory>
#include <string>

#include "telenano/common/base/version.h"

namespace telenano::app {
namespace {

double number(std::uint64_t count) {
  return static_cast<double>(count);
}

// "refused certificates" → "refused_certificates".
std::string label(const char* name) {
  std::string text = name;
  std::replace(text.begin(), text.end(), ' ', '_');
  return text;
}

/// `worker`: empty where there is only one.
void write_sessions(const server::ServerSnapshot& s, const std::string& worker, metrics::Page& page) {
  for (std::uint32_t i = 0; i < std::min<std::size_t>(s.rows, s.session.size()); ++i) {
    const server::SessionRow& row = s.session[i];
    metrics::Labels slot = {{"slot", std::to_string(row.slot)}};
    if (!worker.empty()) slot.emplace_back("worker", worker);
    page.gauge("telenano_session_rate_hz", "Commands a second that the station said it would send",
               row.rate_hz, slot);
    page.gauge("telenano_session_rtt_seconds",
               "Smoothed round trip to the station, including its wait for a tick; 0 = none yet", row.rtt_s,
               slot);
    page.gauge("telenano_session_jitter_seconds", "Interarrival jitter of the session's commands (RFC 3550)",
               row.jitter_s, slot);
    page.gauge("telenano_session_silent_seconds", "Time since the session's last command", row.silent_s,
               slot);
    page.counter("telenano_session_commands_total", "Commands accepted", number(row.commands), slot);
    page.counter("telenano_session_commands_lost_total", "Commands that never came", number(row.lost), slot);
    page.counter("telenano_session_commands_reordered_total", "Commands that a newer one had overtaken",
                 number(row.reordered), slot);
    page.counter("telenano_session_commands_duplicate_total", "Commands that came again",
                 number(row.duplicates), slot);
  }
}

}  // namespace

void write_metrics(const std::vector<const server::LoopStatus*>& workers,
                   const std::vector<security::DtlsServer*>& channels, metrics::Page& page) {
  // Some 20 kB each: not on the stack of a thread that the library made.
  std::vector<server::ServerSnapshot> each(workers.size());
  const auto sum = std::make_unique<server::ServerSnapshot>();
  server::ServerSnapshot& s = *sum;
  for (std::size_t i = 0; i < workers.size(); ++i) {
    workers[i]->snapshot.try_load(each[i], 1'000'000);
    s.counters.add(each[i].counters);
    for (std::size_t k = 0; k < s.drops.size(); ++k) s.drops[k] += each[i].drops[k];
    s.service.add(each[i].service);
    s.active += each[i].active;
    s.occupied += each[i].occupied;
  }

  page.gauge("telenano_build_info", "Always 1; the labels say what is running", 1,
             {{"version", kVersion}, {"commit", kGitCommit}});
  page.gauge("telenano_sessions", "Sessions in use", s.active, {{"state", "active"}});
  page.gauge("telenano_sessions", "", s.occupied - s.active, {{"state", "silent_or_ending"}});
  page.counter("telenano_sessions_opened_total", "Sessions opened", number(s.counters.opened));
  page.counter("telenano_sessions_resumed_total", "Sessions resumed", number(s.counters.resumed));
  page.counter("telenano_sessions_timed_out_total", "Sessions that fell silent",
               number(s.counters.timed_out));
  page.counter("telenano_sessions_ended_total", "Sessions ended by Bye", number(s.counters.ended));
  page.counter("telenano_datagrams_total", "Datagrams received", number(s.counters.datagrams));
  page.counter("telenano_exchanges_total", "Commands accepted", number(s.counters.exchanges));
  page.counter("telenano_replies_left_out_total",
               "Commands accepted whose reply was left out, its force within the station's deadband",
               number(s.counters.left_out));
  page.counter("telenano_scene_pieces_total", "Pieces of the scene that stations have fetched",
               number(s.counters.scene_chunks));
  page.counter("telenano_commands_recovered_total", "Lost commands that a later datagram repeated",
               number(s.counters.recovered));
  page.counter("telenano_work_total", "Iterations and balances of the slaves' solvers",
               number(s.counters.work));
  page.counter(
      "telenano_commands_deferred_total",
      "Commands answered whose motion was left to later ones: the session's share was used up, or the "
      "server behind",
      number(s.counters.deferred));
  page.counter("telenano_steps_cut_total",
               "Steps that were cut short because their session's share was used up", number(s.counters.cut));
  for (std::size_t i = 1; i < s.drops.size(); ++i) {
    page.counter("telenano_drops_total", "Datagrams not used, by cause (PROTOCOL.md, section 8)",
                 number(s.drops[i]), {{"cause", link::name(static_cast<link::DropCause>(i))}});
  }
  std::array<double, server::ServiceTimes::kUpperNs.size()> bounds_s{};
  for (std::size_t i = 0; i < bounds_s.size(); ++i)
    bounds_s[i] =
        static_cast<double>(server::ServiceTimes::kUpperNs[i]) / 1e9;  // the nearest to 5e-07, as written
  page.histogram("telenano_service_seconds", "From reading a command to its answer, encoding not included",
                 bounds_s, s.service.counts, 1e-9 * static_cast<double>(s.service.sum_ns));
  for (std::size_t i = 0; i < each.size(); ++i)
    write_sessions(each[i], each.size() > 1 ? std::to_string(i) : "", page);
  if (channels.empty()) return;
  security::SecurityCounters events;
  for (const security::DtlsServer* const channel : channels) events.add(channel->counters());
  for (std::size_t i = 0; i < security::kSecurityEvents; ++i) {
    const auto event = static_cast<security::SecurityEvent>(i);
    page.counter("telenano_security_events_total", "Events of the encrypted channels", number(events[event]),
                 {{"event", label(security::name(event))}});
  }
}

}  // namespace telenano::app
