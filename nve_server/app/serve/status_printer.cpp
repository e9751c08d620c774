#include "telenano/nve_server/app/serve/status_printer.h"

#include <cstdint>
#include <string>
#include <utility>

namespace telenano::app {

StatusPrinter::StatusPrinter(const Workers& workers, std::shared_ptr<spdlog::logger> log)
    : workers_(workers), log_(std::move(log)), thread_([this] { run(); }) {}

StatusPrinter::~StatusPrinter() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void StatusPrinter::run() {
  std::uint64_t last_exchanges = 0;
  std::uint64_t last_holdings = 0;
  std::string last_channels;
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, kPeriod, [this] { return done_; })) {
    const WorkersStatus status = workers_.status();
    const std::uint64_t exchanges = status.exchanges;
    if (status.sessions > 0 || exchanges != last_exchanges) {
      log_->info("sessions {}  exchanges/s {:.0f}  drops {}  opened {}  timed out {}", status.sessions,
                 static_cast<double>(exchanges - last_exchanges) / static_cast<double>(kPeriod.count()),
                 status.drops, status.opened, status.timed_out);
    }
    if (status.holdings != last_holdings) log_->info("the tip went to a session {} times", status.holdings);
    last_holdings = status.holdings;
    last_exchanges = exchanges;
    if (workers_.channels().empty()) continue;
    // Strangers and forgers are told of, whether or not there are sessions.
    const std::string channels = workers_.channels_text();
    if (channels != last_channels) log_->info("channels: {}", channels);
    last_channels = channels;
  }
}

}  // namespace telenano::app
