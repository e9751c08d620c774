#include "telenano/master/app/run/keep_awake.h"

#include <cstdint>

#include "telenano/common/rt/signals_blocked.h"

namespace telenano::app {
namespace {

constexpr std::int64_t kLookNs = 1'000'000;

}  // namespace

KeepAwake::KeepAwake(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                     loop::ScenePipe& pipe, double rate_hz)
    : way_(way), tender_(session, way.datagram(), server, pipe, clock_, rate_hz) {
  const rt::SignalsBlocked blocked;  // signals are for the main thread
  thread_ = std::thread([this] { run(); });
}

KeepAwake::~KeepAwake() {
  stop_.store(true, std::memory_order_release);
  thread_.join();
}

void KeepAwake::run() noexcept {
  while (!stop_.load(std::memory_order_acquire)) {
    tender_.turn();
    way_.wait_readable(kLookNs);
  }
}

}  // namespace telenano::app
