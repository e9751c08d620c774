#include "telenano/nve_server/app/serve/serve_workers.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "telenano/common/security/connection_id.h"

namespace telenano::app {
namespace {

// A wait may look at the network card for so long before it sleeps.
constexpr std::int64_t kNicBusyPollNs = 50'000;
// A worker without sessions answers the others' questions within this time.
constexpr std::int64_t kIdleWithOthersNs = 5'000'000;
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

Workers::Workers(const WorkersConfig& config, const rt::Clock& clock)
    : config_(config), clock_(clock), cap_(config.max_sessions), mail_(config.workers) {
  net::UdpOptions options;
  options.share_port = config.workers > 1;
  options.arrival_times = false;  // a reply's hold time is the loop's own
  if (config.busy_poll) options.busy_poll_ns = kNicBusyPollNs;
  net::Address address = config.listen;
  // Sockets that share a port would also share it with another server that does, and each would get half of
  // the stations: one that does not share finds out.
  if (options.share_port) address = net::Udp::listen(address).local();
  for (std::size_t i = 0; i < config.workers; ++i) {
    workers_.push_back(std::make_unique<Worker>(net::Udp::listen(address, options)));
    address = workers_.front()->socket.local();
  }
  if (options.share_port) steered_ = workers_.front()->socket.steer(security::kConnectionMark);
}

void Workers::prepare(const ServeSecurity& security, const server::ServerConfig& base,
                      const std::vector<server::ServedScene>& scenes) {
  if (config_.local_users) {
    for (const LocalUserList::User& user : config_.local_users->users)
      grant_names_->note(user.identity, "user " + user.name);
  }
  ServeSecurity::Place place;
  place.connection_ids = steered_;
  if (security.is_secure()) {
    place.resumption =
        std::make_shared<security::ResumptionCache>(4 * ServeSecurity::capacity(config_.max_sessions));
  }
  for (std::size_t i = 0; i < workers_.size(); ++i) {
    Worker& worker = *workers_[i];
    place.worker = i;
    if (security.is_secure())
      worker.secure = security.make(config_.max_sessions, place, worker.batch, clock_);
    if (config_.local_users) {
      worker.local_users = std::make_unique<LocalUsers>(*config_.local_users, config_.max_sessions, local(),
                                                        worker.batch, clock_);
    }
    server::ServerConfig own = base;
    own.table.capacity = config_.max_sessions;
    own.table.per_party = std::min(config_.sessions_per_peer, config_.max_sessions);
    own.table.parties = &parties_;
    own.openings_per_s = kOpeningsPerS;
    own.openings_per_party_s = own.openings_per_s * static_cast<double>(own.table.per_party) /
                               static_cast<double>(config_.max_sessions);
    own.work.enforced = true;
    own.rate_slack = kRateSlack;
    own.load_most = kLoadMost;
    if (config_.audit) worker.audit = std::make_unique<server::AuditQueue>(kAuditQueue);
    own.audit = worker.audit.get();
    if (workers_.size() > 1) {
      own.mail = &mail_;
      own.worker = i;
      own.cap = &cap_;
    }
    worker.server.emplace(own, scenes);
  }
}

void Workers::serve(Worker& worker, const ServerSignals& signals) {
  server::LoopOptions options;
  options.busy_poll = config_.busy_poll;
  options.shutdown.at_once = &signals.at_once;
  options.local_rights = config_.local_rights;
  if (workers_.size() > 1) options.idle_period_ns = kIdleWithOthersNs;
  net::Datagram* wire = &worker.batch;
  if (worker.local_users) wire = worker.local_users.get();
  if (worker.secure) wire = worker.secure.get();
  server::run_loop(
      *worker.server, *wire, clock_, [&](std::int64_t timeout_ns) { worker.batch.wait(timeout_ns); },
      signals.stop, options, worker.status);
}

void Workers::run(const ServerSignals& signals, const std::function<void(const rt::RealtimeReport&)>& told) {
  rt::RealtimeConfig realtime;
  realtime.priority = config_.realtime_priority;
  std::vector<std::jthread> others;
  for (std::size_t i = 1; i < workers_.size(); ++i) {
    others.emplace_back([this, i, &signals, realtime] {
      if (realtime.priority > 0) rt::enter_realtime(realtime);
      serve(*workers_[i], signals);
    });
  }
  if (realtime.priority > 0) told(rt::enter_realtime(realtime));
  serve(*workers_.front(), signals);
}

bool Workers::set_dscp(int dscp) noexcept {
  bool all = true;
  for (const auto& worker : workers_) all = worker->socket.set_dscp(dscp) && all;
  return all;
}

std::vector<const server::LoopStatus*> Workers::loops() const {
  std::vector<const server::LoopStatus*> all;
  for (const auto& worker : workers_) all.push_back(&worker->status);
  return all;
}

std::vector<server::AuditQueue*> Workers::audit_queues() const {
  std::vector<server::AuditQueue*> all;
  for (const auto& worker : workers_) {
    if (worker->audit) all.push_back(worker->audit.get());
  }
  return all;
}

std::vector<security::DtlsServer*> Workers::channels() const {
  std::vector<security::DtlsServer*> all;
  for (const auto& worker : workers_) {
    if (worker->secure) all.push_back(worker->secure.get());
  }
  return all;
}

std::uint64_t Workers::refused_local_users() const noexcept {
  std::uint64_t sum = 0;
  for (const auto& worker : workers_) sum += worker->local_users ? worker->local_users->refused() : 0;
  return sum;
}

WorkersStatus Workers::status() const noexcept {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  WorkersStatus sum;
  for (const auto& worker : workers_) {
    const server::LoopStatus& s = worker->status;
    sum.sessions += s.sessions.load(kRelaxed);
    sum.exchanges += s.exchanges.load(kRelaxed);
    sum.drops += s.drops.load(kRelaxed);
    sum.opened += s.opened.load(kRelaxed);
    sum.timed_out += s.timed_out.load(kRelaxed);
    sum.moved += s.moved_in.load(kRelaxed);
    sum.holdings += s.holdings.load(kRelaxed);
  }
  return sum;
}

std::string Workers::channels_text() const {
  security::SecurityCounters sum;
  for (const security::DtlsServer* const channel : channels()) sum.add(channel->counters());
  return text_of(sum);
}

server::ServerCounters Workers::counters() const noexcept {
  server::ServerCounters sum;
  for (const auto& worker : workers_) sum.add(worker->server->counters());
  return sum;
}

link::DropCounters Workers::drops() const noexcept {
  link::DropCounters sum;
  for (const auto& worker : workers_) sum.add(worker->server->drops());
  return sum;
}

}  // namespace telenano::app
