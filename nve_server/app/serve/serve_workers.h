#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/net/udp.h"
#include "telenano/common/net/udp_batch.h"
#include "telenano/common/rt/clock.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/security/dtls_server.h"
#include "telenano/common/security/grant_names.h"
#include "telenano/nve_server/app/serve/local_users.h"
#include "telenano/nve_server/app/serve/serve_security.h"
#include "telenano/nve_server/app/serve/server_signals.h"
#include "telenano/nve_server/server/server_loop.h"

namespace telenano::app {

struct WorkersConfig {
  net::Address listen;
  std::size_t max_sessions = 64;
  bool busy_poll = false;
  int realtime_priority = 0;                         ///< SCHED_FIFO, 1..99; 0 = ordinary scheduling
  std::size_t sessions_per_peer = 64;                ///< of one key, or in the clear of one IP address
  net::Rights local_rights = net::Rights::kOperate;  ///< of who shows no key
  std::optional<LocalUserList> local_users{};  ///< who may come in without a key; left out: all local users
  bool audit = false;                          ///< events are left in a queue
};

/// A quarter of all, so that no key keeps the others out; at least 4: a station that is restarted leaves one
/// behind for a while.
std::size_t default_sessions_per_peer(std::size_t max_sessions) noexcept;

/// Of the loop, each word by itself.
struct WorkersStatus {
  std::uint64_t sessions = 0;
  std::uint64_t exchanges = 0;
  std::uint64_t drops = 0;
  std::uint64_t opened = 0;
  std::uint64_t timed_out = 0;
  std::uint64_t holdings = 0;
};

/// The loop of `serve`, with its socket, its secure end and its server.
class Workers {
 public:
  /// Opens the socket: a taken port is the quickest answer. Throws UserError.
  Workers(const WorkersConfig& config, const rt::Clock& clock);

  /// Then the channel and the server. Throws UserError or RunError.
  void prepare(const ServeSecurity& security, const server::ServerConfig& base,
               const std::vector<server::ServedScene>& scenes);

  /// Serves until `signals.stop`, in the calling thread; then says goodbye. `told`: what the system grants of a
  /// realtime_priority, before it begins; threads that the caller starts afterwards would have it too.
  void run(const ServerSignals& signals, const std::function<void(const rt::RealtimeReport&)>& told);

  net::Address local() const noexcept { return worker_->socket.local(); }
  bool nic_busy_poll() const noexcept { return worker_->socket.busy_poll_ns() > 0; }
  bool set_dscp(int dscp) noexcept;  ///< see net::Udp
  std::size_t receive_buffer_bytes() const noexcept { return worker_->socket.receive_buffer_bytes(); }
  std::vector<security::DtlsServer*> channels() const;
  std::vector<const server::LoopStatus*> loops() const;
  const std::shared_ptr<security::GrantNames>& grant_names() const noexcept { return grant_names_; }
  std::vector<server::AuditQueue*> audit_queues() const;  ///< none unless WorkersConfig::audit
  std::uint64_t refused_local_users() const noexcept;     ///< datagrams of others than those named
  WorkersStatus status() const noexcept;                  ///< any thread, while they run
  std::string channels_text() const;                      ///< likewise

  // After run().
  server::ServerCounters counters() const noexcept;
  link::DropCounters drops() const noexcept;

 private:
  struct Worker {
    explicit Worker(net::Udp s) : socket(std::move(s)), batch(socket) {}
    net::Udp socket;
    net::UdpBatch batch;
    std::unique_ptr<security::DtlsServer> secure;
    std::unique_ptr<LocalUsers> local_users;
    std::unique_ptr<server::AuditQueue> audit;
    std::optional<server::Server> server;
    server::LoopStatus status;
  };

  WorkersConfig config_;
  const rt::Clock& clock_;
  std::unique_ptr<Worker> worker_;
  std::shared_ptr<security::GrantNames> grant_names_ = std::make_shared<security::GrantNames>();
};

}  // namespace telenano::app
