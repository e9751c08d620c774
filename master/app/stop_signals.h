#pragma once

#include <atomic>

namespace telenano::app {

/// From now on SIGINT and SIGTERM set the flag that is returned (false at first) instead of ending the
/// program, and a file that may not grow is a failed write instead of an end.
const std::atomic<bool>& catch_stop_signals();
/// As if one had come.
void stop_as_by_signal() noexcept;

}  // namespace telenano::app
