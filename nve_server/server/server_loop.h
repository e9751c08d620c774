#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/common/rt/latest_value.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/server/server_shutdown.h"
#include "telenano/nve_server/server/server_snapshot.h"

namespace telenano::server {

/// What the loop tells the rest of the program, read without locks: single words, and a snapshot a few times
/// a second.
struct LoopStatus {
  static constexpr std::int64_t kNever = INT64_MIN;

  std::atomic<std::uint64_t> turns{0};          ///< of the time-outs: grows as long as the loop is alive
  std::atomic<std::int64_t> turned_ns{kNever};  ///< when it did so last
  std::atomic<std::uint64_t> sessions{0};
  std::atomic<std::uint64_t> exchanges{0};
  std::atomic<std::uint64_t> drops{0};
  std::atomic<std::uint64_t> opened{0};
  std::atomic<std::uint64_t> timed_out{0};
  std::atomic<std::uint64_t> holdings{0};
  rt::LatestValue<ServerSnapshot> snapshot;  ///< everything at one instant, every snapshot_period_ns
};

struct LoopOptions {
  std::int64_t snapshot_period_ns = 100'000'000;
  bool busy_poll = false;                   ///< spin instead of sleeping: shortest answer, one core at 100 %
  std::int64_t poll_period_ns = 1'000'000;  ///< of slaves that retract, and the longest sleep with sessions
  /// Of time-outs, which are of seconds, while no slave retracts: looking at them each millisecond would be
  /// one exchange in a hundred that waits for it.
  std::int64_t timeouts_period_ns = 5'000'000;
  std::int64_t idle_period_ns =
      50'000'000;  ///< the same while there are no sessions; also the time to see `stop`
  /// Of datagrams whose channel shows no key: every local user's.
  net::Rights local_rights = net::Rights::kOperate;
  ShutdownOptions shutdown;
};

/// Drains the socket into the server and sends its answers until `stop` is set; then shut_down().
/// `wait(timeout_ns)` sleeps until a datagram may be there.
void run_loop(Server& server, net::Datagram& socket, const rt::Clock& clock,
              const std::function<void(std::int64_t timeout_ns)>& wait, const std::atomic<bool>& stop,
              const LoopOptions& options, LoopStatus& status);

}  // namespace telenano::server
