#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>

#include "telenano/common/net/datagram.h"
#include "telenano/nve_server/afm/deadman_link.h"
#include "telenano/nve_server/nanonis/codec.h"

namespace telenano::afm {

/// The guard: a small process of its own that has the emergency connection. While the server lives it passes
/// requests on, whole frames only, and replies back. When the server's end of `handle` closes, as it does
/// however the server ends, or is silent for `silence_ms` (it beats every 40 ms), the guard withdraws the
/// tip, and ends, after the server, only when the tip is known to be up: two withdrawals in a row have left
/// it where it stood withdrawn at the start (within kUpPart of the range), as it has overheard it. Until then
/// it goes on, however long the controller cannot be reached, and says every ten seconds that the tip is not
/// up, and where it stands. A place that was not overheard is never "up". Before each withdrawal it raises
/// the floor of the controller's Z limits to where the tip stood withdrawn at the start, as it has overheard
/// it, so that a ZPosSet that comes late moves nothing on a controller that holds commands to its limits; one
/// that does not take them is withdrawn all the same. In its checks, before the heart beat, a server moves
/// nothing: one that ends there needs no withdrawal, and the guard just ends; one that is silent there may
/// wait for the controller. Returns the process's exit code: 0 the tip is up, or has not moved, 3 the
/// controller was never reached at all.
///
/// With a key, a deadman stands between it and the controller. The guard proves to it ten times a second that
/// the server is alive: not that the guard is. The heartbeats stop when the server has been silent for
/// `silence_ms` and the guard's own withdrawal has not ended within kOwnWithdrawalMs; when the guard dies;
/// when the network does.
int run_guard(int handle, const net::Address& emergency, int silence_ms,
              const std::optional<DeadmanKey>& key = std::nullopt);
inline constexpr int kOwnWithdrawalMs = 1000;

/// What a server tells its guard, and no controller, when the tip is up and the controller has its settings
/// back: the Z limits are then not the guard's any more.
nanonis::Bytes goodbye();

/// Waits while a guard whose server is gone still withdraws the tip by that port (as net::to_string() writes
/// it), or until `stop`; says so once. A new server must not take the controller from it: it may be the only
/// one who knows that the tip is out. Guards know each other by a name in this machine's network namespace.
void await_last_guard(const std::string& emergency, const std::atomic<bool>& stop,
                      const std::function<void(const std::string&)>& news);

/// What a guard must know, from the server that wants one.
struct GuardOrder {
  std::string emergency;  ///< HOST:PORT
  int silence_ms = 400;
  std::string key_file;  ///< of the deadman; empty: none
  bool operator==(const GuardOrder&) const = default;
};

/// A guard of a unit of its own (deploy/systemd/telenano-nve-afm-guard.socket): whoever listens on that
/// socket of the file system starts `afm-guard --from-server` for each connection, outside of the server's
/// control group, so that not even what kills that whole group ends the guard. Returns the server's end of
/// the stream, on which the order has been sent. Throws RunError where nobody listens: then nothing has
/// moved.
int call_guard(const std::string& socket, const GuardOrder& order);
/// The order, from the guard's end; empty where none came within 2 s, or something else.
std::optional<GuardOrder> read_guard_order(int handle);

/// Starts this very program as `PROGRAM afm-guard --emergency HOST:PORT --silence-ms MS`, and `--deadman-key
/// FILE` where one is named, its end of a stream as standard input; returns the other end. It ignores what
/// ends a server or a whole service (SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGABRT): it ends after the server.
/// Throws RunError.
int start_guard(const std::string& emergency, int silence_ms, const std::string& key_file = {});

}  // namespace telenano::afm
