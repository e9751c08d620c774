#pragma once

#include <string>

#include "common/net/datagram.h"

namespace telenano::afm {

/// The guard: a small process of its own that has the emergency connection. While the server lives it passes
/// requests on, whole frames only, and replies back. When the server's end of `handle` closes, as it does
/// however the server ends, or is silent for `silence_ms` (it beats every 40 ms), the guard withdraws the
/// tip: again until the controller says that it is done, and once more for a request of the server's that
/// comes late. A server that ends in its checks, before the heart beat, has moved nothing, and the guard just
/// ends. Returns the process's exit code: 0 withdrawn, 1 the controller could not be reached for kGiveUpS, 3
/// it was never reached at all.
int run_guard(int handle, const net::Address& emergency, int silence_ms);

inline constexpr int kGuardGiveUpS = 600;

/// Starts this very program as `PROGRAM afm-guard --emergency HOST:PORT --silence-ms MS`, its end of a stream
/// as standard input; returns the other end. It ignores SIGINT and SIGTERM: it ends after the server. Throws
/// RunError.
int start_guard(const std::string& emergency, int silence_ms);

}  // namespace telenano::afm
