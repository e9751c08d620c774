#pragma once

#include <spdlog/spdlog.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

#include "telenano/nve_server/app/serve/serve_workers.h"

namespace telenano::app {

/// Prints what goes on, from a thread of its own: the loop neither formats nor writes.
class StatusPrinter {
 public:
  StatusPrinter(const Workers& workers, std::shared_ptr<spdlog::logger> log);
  ~StatusPrinter();
  StatusPrinter(const StatusPrinter&) = delete;
  StatusPrinter& operator=(const StatusPrinter&) = delete;

 private:
  static constexpr std::chrono::seconds kPeriod{5};

  void run();

  const Workers& workers_;
  std::shared_ptr<spdlog::logger> log_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app
