#include "telenano/master/app/stop_signals.h"

#include <csignal>

namespace telenano::app {
namespace {

// Signal handlers can reach nothing else.
std::atomic<bool> g_stop{false};
static_assert(std::atomic<bool>::is_always_lock_free);

}  // namespace

const std::atomic<bool>& catch_stop_signals() {
  g_stop = false;
  struct sigaction action {};
  action.sa_handler = [](int) { g_stop.store(true, std::memory_order_relaxed); };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);
  return g_stop;
}

void stop_as_by_signal() noexcept {
  g_stop.store(true, std::memory_order_relaxed);
}

}  // namespace telenano::app
