#include "telenano/nve_server/app/serve/serve_workers.h"

#include <algorithm>
#include <utility>

namespace telenano::app {
namespace {

// A wait may look at the network card for so long before it sleeps.
constexpr std::int64_t kNicBusyPollNs = 50'000;
// All sessions at once, twice, in the tenth of a second in which it is read.
constexpr std::size_t kAuditQueue = 8192;
// A thousand stations that come back after a restart have their sessions within two seconds. What an opening
// costs bounds it further (ServerConfig::openings_share).
constexpr double kOpeningsPerS = 1024;
constexpr double kRateSlack = 1.25;
// 250 stations of 1 kHz on a core were seen to hold, with 0.8 of it for their exchanges.
constexpr double kLoadMost = 0.85;

}  // namespace

std::size_t default_sessions_per_peer(std::size_t max_sessions) noexcept {
  return std::min(max_sessions, std::max<std::size_t>(max_sessions / 4, 4));
}

Workers::Workers(const WorkersConfig& config, const rt::Clock& clock) : config_(config), clock_(clock) {
  net::UdpOptions options;
  options.arrival_times = false;  // a reply's hold time is the loop's own
  if (config.busy_poll) options.busy_poll_ns = kNicBusyPollNs;
  worker_ = std::make_unique<Worker>(net::Udp::listen(config.listen, options));
}

void Workers::prepare(const ServeSecurity& security, const server::ServerConfig& base,
                      const std::vector<server::ServedScene>& scenes) {
  Worker& worker = *worker_;
  if (security.is_secure()) worker.secure = security.make(config_.max_sessions, worker.batch, clock_);
  if (config_.local_users) {
    for (const LocalUserList::User& user : config_.local_users->users)
      grant_names_->note(user.identity, "user " + user.name);
    worker.local_users = std::make_unique<LocalUsers>(*config_.local_users, config_.max_sessions, local(),
                                                      worker.batch, clock_);
  }
  server::ServerConfig own = base;
  own.table.capacity = config_.max_sessions;
  own.table.per_party = std::min(config_.sessions_per_peer, config_.max_sessions);
  own.openings_per_s = kOpeningsPerS;
  own.openings_per_party_s = own.openings_per_s * static_cast<double>(own.table.per_party) /
                             static_cast<double>(config_.max_sessions);
  own.work.enforced = true;
  own.rate_slack = kRateSlack;
  own.load_most = kLoadMost;
  if (config_.audit) worker.audit = std::make_unique<server::AuditQueue>(kAuditQueue);
  own.audit = worker.audit.get();
  worker.server.emplace(own, scenes);
}

void Workers::run(const ServerSignals& signals, const std::function<void(const rt::RealtimeReport&)>& told) {
  rt::RealtimeConfig realtime;
  realtime.priority = config_.realtime_priority;
  if (realtime.priority > 0) told(rt::enter_realtime(realtime));
  Worker& worker = *worker_;
  server::LoopOptions options;
  options.busy_poll = config_.busy_poll;
  options.shutdown.at_once = &signals.at_once;
  options.local_rights = config_.local_rights;
  net::Datagram* wire = &worker.batch;
  if (worker.local_users) wire = worker.local_users.get();
  if (worker.secure) wire = worker.secure.get();
  server::run_loop(
      *worker.server, *wire, clock_, [&](std::int64_t timeout_ns) { worker.batch.wait(timeout_ns); },
      signals.stop, options, worker.status);
}

bool Workers::set_dscp(int dscp) noexcept {
  return worker_->socket.set_dscp(dscp);
}

std::vector<const server::LoopStatus*> Workers::loops() const {
  return {&worker_->status};
}

std::vector<server::AuditQueue*> Workers::audit_queues() const {
  return worker_->audit ? std::vector{worker_->audit.get()} : std::vector<server::AuditQueue*>();
}

std::vector<security::DtlsServer*> Workers::channels() const {
  return worker_->secure ? std::vector{worker_->secure.get()} : std::vector<security::DtlsServer*>();
}

std::uint64_t Workers::refused_local_users() const noexcept {
  return worker_->local_users ? worker_->local_users->refused() : 0;
}

WorkersStatus Workers::status() const noexcept {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  const server::LoopStatus& s = worker_->status;
  return {s.sessions.load(kRelaxed), s.exchanges.load(kRelaxed), s.drops.load(kRelaxed),
          s.opened.load(kRelaxed),   s.timed_out.load(kRelaxed), s.holdings.load(kRelaxed)};
}

std::string Workers::channels_text() const {
  return worker_->secure ? text_of(worker_->secure->counters()) : text_of({});
}

server::ServerCounters Workers::counters() const noexcept {
  return worker_->server->counters();
}

link::DropCounters Workers::drops() const noexcept {
  return worker_->server->drops();
}

}  // namespace telenano::app
