#include "telenano/nve_server/app/serve/reload_watcher.h"

#include <chrono>
#include <utility>

namespace telenano::app {

ReloadWatcher::ReloadWatcher(std::atomic<bool>& asked, std::function<void()> reload)
    : asked_(asked), reload_(std::move(reload)), thread_([this] { run(); }) {}

ReloadWatcher::~ReloadWatcher() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void ReloadWatcher::run() {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, std::chrono::milliseconds(100), [this] { return done_; })) {
    if (asked_.exchange(false)) reload_();
  }
}

}  // namespace telenano::app
