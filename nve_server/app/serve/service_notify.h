#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "telenano/nve_server/server/server_loop.h"

namespace telenano::app {

/// Tells the service manager, before the server serves, that its start goes on: another half minute is
/// allowed from now, and `status` is shown. Nothing where no service manager asked.
void notify_start_goes_on(const std::string& status) noexcept;

/// Tells the service manager how the server is (sd_notify(3)): READY once it serves, a line of status, and
/// the watchdog's sign of life, which is given only while the loop turns: a loop that hangs is killed and
/// started again. Works from a thread of its own, and is nothing where no service manager asked (no
/// NOTIFY_SOCKET), or where the build left libsystemd out.
class ServiceNotify {
 public:
  /// Of all workers' loops: one that hangs is enough.
  explicit ServiceNotify(std::vector<const server::LoopStatus*> loops);
  explicit ServiceNotify(const server::LoopStatus& loop)
      : ServiceNotify(std::vector<const server::LoopStatus*>{&loop}) {}
  ~ServiceNotify();  ///< says STOPPING, and that the orderly end may take longer than a turn of the loop
  ServiceNotify(const ServiceNotify&) = delete;
  ServiceNotify& operator=(const ServiceNotify&) = delete;

 private:
  void run();

  std::vector<const server::LoopStatus*> loops_;
  std::int64_t period_us_ = 0;  ///< between two signs of life; 0 = nobody asked
  bool watched_ = false;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app
