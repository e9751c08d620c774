#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>
#include <thread>

namespace telenano::rt {

/// What a loop asks of the operating system. Everything is optional: what is not permitted is reported, with
/// advice, and the loop runs without it.
struct RealtimeConfig {
  int priority = 80;        ///< SCHED_FIFO, 1..99; 0 leaves the scheduler alone
  int cpu = -1;             ///< pin to this processor; -1 leaves the choice to the kernel
  bool lock_memory = true;  ///< mlockall: no page fault in the loop
  std::size_t prefault_stack_bytes = std::size_t{256} * 1024;
  std::int64_t timer_slack_ns = 1;  ///< under SCHED_OTHER the kernel adds 50 us to every sleep by default
  /// Hold /dev/cpu_dma_latency at 0 while the thread lives: processors do not sleep deeply, waking takes
  /// microseconds, at the price of heat. Off by default.
  bool hold_cpu_awake = false;
};

struct RealtimeReport {
  bool fifo = false;
  bool pinned = false;
  bool memory_locked = false;
  bool timer_slack = false;
  bool cpu_awake = false;
  std::string text;  ///< one line: what the loop got
  std::string
      advice;  ///< one line for each wish that was not granted and how to grant it; empty when all were
};

/// Holds /dev/cpu_dma_latency open at 0 as long as it lives.
class CpuAwake {
 public:
  CpuAwake() noexcept;
  ~CpuAwake();
  CpuAwake(const CpuAwake&) = delete;
  CpuAwake& operator=(const CpuAwake&) = delete;
  bool held() const noexcept { return fd_ >= 0; }
  int error() const noexcept { return error_; }

 private:
  int fd_ = -1;
  int error_ = 0;
};

/// Applies all of `config` but hold_cpu_awake (see CpuAwake) to the calling thread. Never throws for a wish
/// that is refused. Call it last before the loop: threads started afterwards would inherit the scheduling
/// class.
RealtimeReport enter_realtime(const RealtimeConfig& config);

/// A thread that applies a RealtimeConfig to itself and then runs `body` until it returns; joined by the
/// destructor, which asks it to stop first.
class RealtimeThread {
 public:
  RealtimeThread(const RealtimeConfig& config, std::function<void(std::stop_token)> body);
  ~RealtimeThread() = default;
  RealtimeThread(const RealtimeThread&) = delete;
  RealtimeThread& operator=(const RealtimeThread&) = delete;

  /// Known when the constructor returns; `body` starts right after.
  const RealtimeReport& report() const noexcept { return report_; }
  void request_stop() noexcept { thread_.request_stop(); }
  void join() { thread_.join(); }

 private:
  RealtimeReport report_;
  std::jthread thread_;
};

}  // namespace telenano::rt
