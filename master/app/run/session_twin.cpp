#include "telenano/master/app/run/session_twin.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "telenano/common/config/print.h"
#include "telenano/master/app/run/keep_awake.h"
#include "telenano/master/app/run/scene_wait.h"
#include "telenano/master/app/run/twin_cost.h"
#include "telenano/master/twin/load_twin.h"

namespace telenano::app {
namespace {

// Of a slave's state, as much as a server gives (server::ServerConfig::snapshot_bytes_most).
constexpr std::size_t kSnapshotBytesMost = std::size_t{16} << 20;

// For a twin nothing can begin without the scene: 4 MB at the server's 464 kB/s, and reading it.
constexpr double kTwinSceneWaitS = 20;

// So long for a twin that nobody asked for: what a scan of 256² takes to look at the first time on a slow
// machine, once (SceneCache keeps it). A lesser method for the whole session is worse than these seconds
// before it.
constexpr double kFirstSceneWaitS = 8;

}  // namespace

station::TwinRunConfig twin_config(double rate_hz) {
  station::TwinRunConfig twin;
  twin.rate_hz = rate_hz;
  twin.ring_s = kTwinRingS;
  twin.look_s = station::kLookAgain_s;
  return twin;
}

std::size_t snapshot_room(const control::LocalSlave& twin) {
  return std::min(twin.snapshot_bytes_max(), kSnapshotBytesMost);
}

std::string too_slow(control::LocalSlave& twin, double rate_hz) {
  const double cost_s = twin_step_cost_s(twin, rate_hz);
  if (cost_s <= kTwinShareOfTick / rate_hz) return "";
  return fmt::format(
      "a step of this scene takes {:.0f} us here, more than a third of the tick's {:.0f} us; a lower --rate "
      "leaves room for it",
      1e6 * cost_s, 1e6 / rate_hz);
}

Twins find_twins(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                 double rate_hz, bool wanted, bool quiet, scene_store::SceneKeeper& keeper,
                 const std::atomic<bool>& stop, std::string& why) {
  Twins twins;
  if (!session.logs_steps()) {
    why = "this server keeps no log of steps (a real AFM or an older program)";
    return twins;
  }
  if (session.welcome().scene.empty()) {
    why = "this server does not share its scene; name it by --scene";
    return twins;
  }
  keeper.start();
  wait_for_scene(session, way, server, keeper, SceneWait::kLookedAt, kSceneWaitS, rate_hz, stop);
  if (!keeper.settled() && !stop) {
    if (!quiet)
      config::print(stderr,
                    "note: making the server's scene ready here, which takes longer the first time\n");
    wait_for_scene(session, way, server, keeper, SceneWait::kLookedAt,
                   wanted ? kTwinSceneWaitS : kFirstSceneWaitS, rate_hz, stop);
  }
  const auto scene = keeper.scene();
  if (scene && scene->same_physics) {
    const KeepAwake awake(session, way, server, keeper.pipe(), rate_hz);
    twins = twin::decode_twins(scene->bundle, 2);
    why = too_slow(*twins[0], rate_hz);
    if (!why.empty()) twins.clear();
  } else if (scene) {
    why = "this program computes the server's scene differently; use the same version on both sides";
  } else if (!keeper.settled()) {
    why = "the server's scene is still being made ready; a later session has it";
  } else {
    why = "the server's scene cannot be fetched; name it by --scene";
  }
  return twins;
}

void use_twin(std::vector<std::unique_ptr<control::LocalSlave>> twins, const link::Welcome& welcome,
              const station::StationConfig& config, station::Station& station, bool quiet) {
  const bool same = twins[0]->scene_hash() == welcome.scene_hash;
  if (!same && !quiet)
    config::print(stderr, "note: --scene differs from the server's scene: no twin, method model instead\n");
  station.use_twin(std::make_unique<station::TwinRun>(twin_config(config.rate_hz), std::move(twins[0]),
                                                      std::move(twins[1])));
}

void tell_no_twin(const std::string& why, bool wanted) {
  config::print(stderr, "note: no twin, {}: {}\n", wanted ? "method model instead" : "another method instead",
                why);
}

}  // namespace telenano::app
