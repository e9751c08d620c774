#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "telenano/common/net/udp.h"
#include "telenano/common/net/udp_batch.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/server/server_loop.h"
#include "tests/studies/bench/pinned_thread.h"

namespace telenano::studies {

/// The product's server as `telenano-nve serve` runs it: loop, batches, sessions, the scene's slaves; in a
/// thread on one processor.
class Served {
 public:
  /// `priority`: as serve --rt-priority.
  Served(std::shared_ptr<const scene::Scene> scene, int cpu, bool busy_poll, std::size_t capacity,
         int priority = 0);

  net::Address address() const noexcept { return socket_.local(); }
  std::uint64_t exchanges() const noexcept { return status_.exchanges.load(std::memory_order_relaxed); }
  std::int64_t cpu_ns() const noexcept { return thread_->cpu_ns(); }
  void move_to(int cpu) noexcept { thread_->move_to(cpu); }

 private:
  net::Udp socket_;
  net::UdpBatch batch_;
  rt::SteadyClock clock_;
  server::Server server_;
  server::LoopStatus status_;
  std::unique_ptr<PinnedThread> thread_;  // last: ends first
};

}  // namespace telenano::studies
