#pragma once

#include <atomic>

namespace telenano::app {

/// What signals ask of a server. Set by handlers, read anywhere.
struct ServerSignals {
  std::atomic<bool> drain{false};    ///< SIGUSR1, or the first SIGTERM: no new sessions, end with the last
  std::atomic<bool> stop{false};     ///< SIGINT, SIGTERM: withdraw the tips, say goodbye, end
  std::atomic<bool> at_once{false};  ///< a second one: end without waiting
  std::atomic<bool> reload{false};   ///< SIGHUP; whoever reloads clears it
  std::atomic<bool> serves{false};   ///< set by the server: before there is nothing to drain, and it ends
};

/// Catches SIGINT, SIGTERM, SIGUSR1 and SIGHUP from now on. `drain_first`: the first SIGTERM drains, and the
/// next is as the first would be. A third SIGINT or SIGTERM that stops kills, whatever hangs.
ServerSignals& catch_server_signals(bool drain_first = false);

/// Whether one has asked since to stop; false where none are caught.
bool asked_to_stop() noexcept;

/// Thrown out of a loading that has found that it is asked to stop.
struct StoppedWhileLoading {};

}  // namespace telenano::app
