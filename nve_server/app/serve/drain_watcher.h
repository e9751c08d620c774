#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/server/server_loop.h"

namespace telenano::app {

/// When a drain is over. Pure; asked every kLookNs.
class DrainRule {
 public:
  static constexpr std::int64_t kLookNs = 50'000'000;

  /// Left out: the drain lasts as long as its last session.
  explicit DrainRule(std::optional<std::int64_t> most_ns) : most_ns_(most_ns.value_or(INT64_MAX)) {}

  enum class State : std::uint8_t { kGoesOn, kEmpty, kLate };
  /// `all_drain`: no loop takes new sessions any more. `occupied`: of them all, silent and ending ones too.
  State look(bool all_drain, std::uint64_t occupied, std::int64_t now_ns) noexcept;

 private:
  std::int64_t most_ns_;
  std::int64_t since_ns_ = 0;
  bool began_ = false;
  bool was_empty_ = false;
};

/// Ends a server that drains, by setting `stop`: when its last session is gone, or after `most_s`. Works in a
/// thread of its own.
class DrainWatcher {
 public:
  struct Config {
    const std::atomic<bool>* drain = nullptr;
    std::atomic<bool>* stop = nullptr;
    std::optional<int> most_s;
    std::vector<const server::LoopStatus*> loops;
    std::function<void(const std::string&)> tell;
  };
  DrainWatcher(Config config, const rt::Clock& clock);
  ~DrainWatcher();
  DrainWatcher(const DrainWatcher&) = delete;
  DrainWatcher& operator=(const DrainWatcher&) = delete;

 private:
  void run();

  Config config_;
  const rt::Clock& clock_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app
