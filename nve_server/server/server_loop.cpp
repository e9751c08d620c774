#include "telenano/nve_server/server/server_loop.h"

#include <algorithm>
#include <array>
#include <vector>

#include "telenano/common/link/messages.h"
#include "telenano/common/rt/thread_time.h"
#include "telenano/nve_server/server/drain_order.h"

namespace telenano::server {
namespace {

/// One byte more than the largest datagram, so that an oversize one is seen as such.
struct Waiting {
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> bytes;
  net::Received received;
};

/// All that waits is taken in before the first is looked at, DrainOrder::kMost at most; and so many times at
/// most before the time-outs are looked at again.
constexpr int kTurns = 2;

/// Which turns are measured for the estimate of load, where there are several sessions: one alone is always let in,
/// and asking for a thread's time is a system call.
constexpr std::uint32_t kTurnsPerLook = 17;

void publish(const Server& server, std::int64_t now_ns, LoopStatus& status) noexcept {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  status.turns.fetch_add(1, kRelaxed);
  status.turned_ns.store(now_ns, kRelaxed);
  status.sessions.store(server.sessions().active(), kRelaxed);
  status.exchanges.store(server.counters().exchanges, kRelaxed);
  status.drops.store(server.drops().total(), kRelaxed);
  status.opened.store(server.counters().opened, kRelaxed);
  status.timed_out.store(server.counters().timed_out, kRelaxed);
  status.holdings.store(server.counters().holdings, kRelaxed);
}

}  // namespace

void run_loop(Server& server, net::Datagram& socket, const rt::Clock& clock,
              const std::function<void(std::int64_t timeout_ns)>& wait, const std::atomic<bool>& stop,
              const LoopOptions& options, LoopStatus& status) {
  std::vector<Waiting> in(DrainOrder::kMost);
  DrainOrder order;
  for (Waiting& waiting : in) waiting.received.standing.rights = options.local_rights;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  ServerSnapshot snapshot;
  std::int64_t next_snapshot_ns = clock.now_ns();
  std::int64_t next_poll_ns = clock.now_ns();
  const rt::ThreadTime thread_time;
  std::uint32_t turns = 0;
  while (!stop.load(std::memory_order_relaxed)) {
    // At most two drains before the time-outs are looked at again, so that a flood cannot keep them waiting.
    bool drained = false;
    for (int i = 0; i < kTurns && !drained; ++i) {
      const bool measures = ++turns % kTurnsPerLook == 0 && server.sessions().active() > 1;
      const std::int64_t begun_ns = measures ? thread_time.now_ns() : 0;
      std::size_t waiting = 0;
      while (waiting < in.size() && socket.receive(in[waiting].bytes, in[waiting].received)) ++waiting;
      drained = waiting < in.size();
      if (waiting == 0) break;
      // They have been received now: an answer's hold time includes the wait for those before it.
      const std::int64_t came_ns = clock.now_ns();
      const std::uint64_t answered = server.counters().exchanges;
      const auto from = [&in](std::size_t k) -> const net::Address& { return in[k].received.from; };
      for (const DrainOrder::Item& next : order.of(waiting, from)) {
        const Waiting& one = in[next.index];
        const net::Received& received = one.received;
        const std::size_t size = std::min(received.size, one.bytes.size());
        const std::size_t n = server.on_datagram({one.bytes.data(), size}, received.from, came_ns, out,
                                                 &clock, received.standing, next.superseded);
        // A full send queue loses the answer, as the network may: the next one says more.
        if (n > 0) socket.send({out.data(), n}, received.from);
      }
      if (!measures) continue;
      // Where all that came were commands: strangers are no part of a session's price.
      socket.flush();
      const std::uint64_t exchanges = server.counters().exchanges - answered;
      if (exchanges == waiting) server.note_load(thread_time.now_ns() - begun_ns, exchanges);
    }
    socket.flush();
    const std::int64_t now_ns = clock.now_ns();
    const bool more_steps = server.catch_up(now_ns);
    if (now_ns >= next_poll_ns) {
      server.poll(now_ns);
      publish(server, now_ns, status);
      if (now_ns >= next_snapshot_ns) {
        take_snapshot(server, now_ns, snapshot);
        status.snapshot.store(snapshot);
        next_snapshot_ns = now_ns + options.snapshot_period_ns;
      }
      const bool busy = server.sessions().occupied() > 0;
      next_poll_ns = now_ns + (server.retracts() ? options.poll_period_ns
                               : busy            ? options.timeouts_period_ns
                                                 : options.idle_period_ns);
    }
    if (!drained || more_steps || options.busy_poll) continue;
    const std::int64_t sleep_ns = next_poll_ns - now_ns;
    // Also where the next look at the time-outs is farther away, as just after the first Hello: what is short
    // can be waited for by receiving.
    const bool soon = server.sessions().occupied() > 0;
    wait(soon ? std::min(sleep_ns, options.poll_period_ns) : sleep_ns);
  }
  shut_down(server, socket, clock, wait, options.shutdown);
  publish(server, clock.now_ns(), status);
  take_snapshot(server, clock.now_ns(), snapshot);
  status.snapshot.store(snapshot);
}

}  // namespace telenano::server
