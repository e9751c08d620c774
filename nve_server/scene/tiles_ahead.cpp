#include "telenano/nve_server/scene/tiles_ahead.h"

#include <pthread.h>
#include <signal.h>

#include <chrono>
#include <utility>

namespace telenano::scene {
namespace {

// A tip needs some ms for a tile.
constexpr std::chrono::milliseconds kBetweenLooks(2);

}  // namespace

TilesAhead::TilesAhead(std::shared_ptr<const physics::ScanFields> fields) : fields_(std::move(fields)) {
  sigset_t all, before;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

// Those who look never wait for it, and so do not wake it.
void TilesAhead::run(const std::stop_token& stop) const {
  while (!stop.stop_requested()) {
    if (!fields_->make_wished()) std::this_thread::sleep_for(kBetweenLooks);
  }
}

}  // namespace telenano::scene
