#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace telenano::app {

/// Calls `reload` in a thread of its own, within 100 ms after `asked` has become true, and clears it: a
/// signal handler can neither read files nor write logs.
class ReloadWatcher {
 public:
  ReloadWatcher(std::atomic<bool>& asked, std::function<void()> reload);
  ~ReloadWatcher();
  ReloadWatcher(const ReloadWatcher&) = delete;
  ReloadWatcher& operator=(const ReloadWatcher&) = delete;

 private:
  void run();

  std::atomic<bool>& asked_;
  std::function<void()> reload_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app
