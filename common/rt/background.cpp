#include "telenano/common/rt/background.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <charconv>
#include <filesystem>
#include <string>
#include <system_error>

namespace telenano::rt {
namespace {

constexpr int kNice = 10;

}  // namespace

void enter_background() noexcept {
  // Linux keeps niceness by thread, whatever POSIX says of processes.
  setpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)), kNice);
}

void enter_background(const std::vector<int>& threads) noexcept {
  for (const int thread : threads) setpriority(PRIO_PROCESS, static_cast<id_t>(thread), kNice);
}

std::vector<int> threads_now() {
  std::vector<int> threads;
  std::error_code error;
  for (std::filesystem::directory_iterator each("/proc/self/task", error), end; !error && each != end;
       each.increment(error)) {
    const std::string name = each->path().filename().string();
    int thread = 0;
    if (std::from_chars(name.data(), name.data() + name.size(), thread).ec == std::errc())
      threads.push_back(thread);
  }
  return threads;
}

}  // namespace telenano::rt
