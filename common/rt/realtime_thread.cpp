#include "telenano/common/rt/realtime_thread.h"

#include <alloca.h>
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <latch>
#include <optional>

namespace telenano::rt {
namespace {

constexpr int kCapIpcLock = 14;  // linux/capability.h

bool has_capability(int capability) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("CapEff:", 0) == 0) {
      return ((std::strtoull(line.c_str() + 7, nullptr, 16) >> capability) & 1u) != 0;
    }
  }
  return false;
}

void advise(RealtimeReport& report, const std::string& line) {
  if (!report.advice.empty()) report.advice += '\n';
  report.advice += line;
}

void take_priority(int priority, RealtimeReport& report) {
  sched_param param{};
  param.sched_priority =
      std::clamp(priority, ::sched_get_priority_min(SCHED_FIFO), ::sched_get_priority_max(SCHED_FIFO));
  const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &param);
  report.fifo = error == 0;
  if (error != 0) {
    advise(report, "SCHED_FIFO " + std::to_string(param.sched_priority) + ": " + std::strerror(error) +
                       "; allow it with 'rtprio' in /etc/security/limits.conf, LimitRTPRIO= in systemd, or "
                       "CAP_SYS_NICE");
  }
}

void pin(int cpu, RealtimeReport& report) {
  cpu_set_t set;
  CPU_ZERO(&set);
  int error = EINVAL;
  if (cpu < CPU_SETSIZE) {
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    error = ::pthread_setaffinity_np(::pthread_self(), sizeof set, &set);
  }
  report.pinned = error == 0;
  if (error != 0) advise(report, "processor " + std::to_string(cpu) + ": " + std::strerror(error));
}

void lock_memory(RealtimeReport& report) {
  rlimit limit{};
  ::getrlimit(RLIMIT_MEMLOCK, &limit);
  const bool unlimited = limit.rlim_cur == RLIM_INFINITY || has_capability(kCapIpcLock);
  // Under a finite limit, MCL_FUTURE would make later allocations fail; lock what there is, if it fits.
  report.memory_locked = ::mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0;
  if (!report.memory_locked) {
    advise(report,
           std::string("mlockall: ") + std::strerror(errno) +
               "; allow it with 'memlock unlimited' in /etc/security/limits.conf, LimitMEMLOCK=infinity in "
               "systemd, or CAP_IPC_LOCK");
  }
  ::mallopt(M_TRIM_THRESHOLD, -1);  // memory once touched stays ours
}

__attribute__((noinline)) void prefault_stack(std::size_t bytes) {
  if (bytes == 0) return;
  auto* stack = static_cast<volatile char*>(alloca(bytes));
  for (std::size_t i = 0; i < bytes; i += 4096) stack[i] = 0;
  stack[bytes - 1] = 0;
}

std::string summary(const RealtimeConfig& config, const RealtimeReport& report) {
  std::string text = report.fifo ? "SCHED_FIFO " + std::to_string(config.priority) : "ordinary scheduling";
  if (report.pinned) text += ", processor " + std::to_string(config.cpu);
  if (config.lock_memory) text += report.memory_locked ? ", memory locked" : ", memory not locked";
  if (report.timer_slack) text += ", timer slack " + std::to_string(config.timer_slack_ns) + " ns";
  return text;
}

}  // namespace

CpuAwake::CpuAwake() noexcept : fd_(::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC)) {
  const std::int32_t latency_us = 0;
  if (fd_ < 0) {
    error_ = errno;
  } else if (::write(fd_, &latency_us, sizeof latency_us) != sizeof latency_us) {
    error_ = errno;
    ::close(fd_);
    fd_ = -1;
  }
}

CpuAwake::~CpuAwake() {
  if (fd_ >= 0) ::close(fd_);
}

RealtimeReport enter_realtime(const RealtimeConfig& config) {
  RealtimeReport report;
  if (config.timer_slack_ns > 0) {
    report.timer_slack =
        ::prctl(PR_SET_TIMERSLACK, static_cast<unsigned long>(config.timer_slack_ns), 0, 0, 0) == 0;
  }
  if (config.lock_memory) lock_memory(report);
  prefault_stack(config.prefault_stack_bytes);
  if (config.cpu >= 0) pin(config.cpu, report);
  if (config.priority > 0) take_priority(config.priority, report);
  report.text = summary(config, report);
  return report;
}

RealtimeThread::RealtimeThread(const RealtimeConfig& config, std::function<void(std::stop_token)> body) {
  std::latch ready(1);
  thread_ = std::jthread([this, &ready, config, body = std::move(body)](std::stop_token stop) {
    std::optional<CpuAwake> awake;
    report_ = enter_realtime(config);
    if (config.hold_cpu_awake) {
      awake.emplace();
      report_.cpu_awake = awake->held();
      if (awake->held()) {
        report_.text += ", processors kept awake";
      } else {
        advise(report_, std::string("/dev/cpu_dma_latency: ") + std::strerror(awake->error()) +
                            "; give the user write access by a udev rule");
      }
    }
    ready.count_down();
    body(std::move(stop));
  });
  ready.wait();
}

}  // namespace telenano::rt
