#pragma once

#include <pthread.h>
#include <sched.h>
#include <time.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>

namespace telenano::studies {

inline std::int64_t clock_ns(clockid_t clock) noexcept {
  timespec now{};
  ::clock_gettime(clock, &now);
  return now.tv_sec * std::int64_t{1'000'000'000} + now.tv_nsec;
}

inline bool pin_thread(pthread_t thread, int cpu) noexcept {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  return ::pthread_setaffinity_np(thread, sizeof set, &set) == 0;
}

/// Pins the calling thread while it lives, then gives it back the processors that it had.
class PinnedHere {
 public:
  explicit PinnedHere(int cpu) noexcept {
    ::pthread_getaffinity_np(::pthread_self(), sizeof before_, &before_);
    pin_thread(::pthread_self(), cpu);
  }
  ~PinnedHere() { ::pthread_setaffinity_np(::pthread_self(), sizeof before_, &before_); }
  PinnedHere(const PinnedHere&) = delete;
  PinnedHere& operator=(const PinnedHere&) = delete;

 private:
  cpu_set_t before_{};
};

/// The server's part of a measurement, on a processor of its own; told to stop by the destructor.
class PinnedThread {
 public:
  PinnedThread(int cpu, std::function<void(const std::atomic<bool>& stop)> body)
      : thread_([this, body = std::move(body)] { body(stop_); }) {
    pin_thread(thread_.native_handle(), cpu);
    ::pthread_getcpuclockid(thread_.native_handle(), &clock_);
  }
  ~PinnedThread() {
    stop_ = true;
    thread_.join();
  }
  PinnedThread(const PinnedThread&) = delete;
  PinnedThread& operator=(const PinnedThread&) = delete;

  /// Time that it has spent on its processor.
  std::int64_t cpu_ns() const noexcept { return clock_ns(clock_); }
  void move_to(int cpu) noexcept { pin_thread(thread_.native_handle(), cpu); }

 private:
  std::atomic<bool> stop_{false};
  clockid_t clock_{};
  std::thread thread_;
};

}  // namespace telenano::studies
