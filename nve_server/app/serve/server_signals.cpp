#include "telenano/nve_server/app/serve/server_signals.h"

#include <csignal>

namespace telenano::app {
namespace {

// Signal handlers can reach nothing else.
ServerSignals g_signals;
static_assert(std::atomic<bool>::is_always_lock_free);

void on_stop(int) {
  if (g_signals.at_once) return;
  if (!g_signals.stop.exchange(true)) return;
  g_signals.at_once = true;
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

void on_reload(int) {
  g_signals.reload = true;
}

void handle(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;  // no SA_RESTART: a sleeping wait returns at once
  sigaction(signal, &action, nullptr);
}

}  // namespace

ServerSignals& catch_server_signals() {
  g_signals.stop = g_signals.at_once = g_signals.reload = false;
  handle(SIGINT, on_stop);
  handle(SIGTERM, on_stop);
  handle(SIGHUP, on_reload);
  return g_signals;
}

bool asked_to_stop() noexcept {
  return g_signals.stop;
}

}  // namespace telenano::app
