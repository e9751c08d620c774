#include "telenano/master/app/run/scene_wait.h"

#include <cmath>

#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/loop/session_tender.h"

namespace telenano::app {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

}  // namespace

void wait_for_scene(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                    scene_store::SceneKeeper& keeper, SceneWait wanted, double wait_s, double rate_hz,
                    const std::atomic<bool>& stop, const std::function<void()>& each_second) {
  const rt::SteadyClock clock;
  loop::SessionTender tender(session, way.datagram(), server, keeper.pipe(), clock, rate_hz);
  const std::int64_t end_ns = clock.now_ns() + std::llround(1e9 * wait_s);
  std::int64_t next_second_ns = clock.now_ns() + kSecondNs;
  while (!stop && session.has_session() && clock.now_ns() < end_ns) {
    tender.turn();
    const bool here = wanted == SceneWait::kBytes    ? keeper.bundle() != nullptr
                      : wanted == SceneWait::kGround ? keeper.ground() != nullptr
                                                     : false;
    if (keeper.settled() || here) return;
    if (each_second && clock.now_ns() >= next_second_ns) {
      next_second_ns += kSecondNs;
      each_second();
    }
    way.wait_readable(1'000'000);
  }
}

}  // namespace telenano::app
