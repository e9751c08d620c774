#pragma once

#include <atomic>

namespace telenano::app {

/// What signals ask of a server. Set by handlers, read anywhere.
struct ServerSignals {
  std::atomic<bool> stop{false};     ///< SIGINT, SIGTERM: withdraw the tips, say goodbye, end
  std::atomic<bool> at_once{false};  ///< a second one: end without waiting
  std::atomic<bool> reload{false};   ///< SIGHUP; whoever reloads clears it
};

/// Catches SIGINT, SIGTERM and SIGHUP from now on. A third SIGINT or SIGTERM kills, whatever hangs.
ServerSignals& catch_server_signals();

/// Whether one has asked since to stop; false where none are caught.
bool asked_to_stop() noexcept;

/// Thrown out of a loading that has found that it is asked to stop.
struct StoppedWhileLoading {};

}  // namespace telenano::app
