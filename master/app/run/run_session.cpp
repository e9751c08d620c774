#include "telenano/master/app/run/run_session.h"

#include <unistd.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/config/print.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/run/run_settings.h"
#include "telenano/master/app/run/server_scene.h"
#include "telenano/master/app/run/session_at_scene.h"
#include "telenano/master/app/run/session_twin.h"
#include "telenano/master/app/run/sim_hand.h"
#include "telenano/master/app/stop_signals.h"
#include "telenano/master/app/view/session_view.h"
#include "telenano/master/connection/connect.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/scene/scene_keeper.h"
#include "telenano/master/twin/load_twin.h"

namespace telenano::app {
namespace {

scene_store::SceneKeeperOptions scene_options(const RunOptions& options) {
  scene_store::SceneKeeperOptions scene;
  const bool new_line = isatty(STDERR_FILENO) != 0 && !options.quiet;
  scene.warn = [new_line](const std::string& text) {
    config::print(stderr, "{}telenano-master: warning: {}\n", new_line ? "\n" : "", text);
  };
  if (!options.quiet) {
    scene.note = [new_line](const std::string& text) {
      config::print(stderr, "{}note: {}\n", new_line ? "\n" : "", text);
    };
  }
  return scene;
}

void tell_device(const SessionDevice& device) {
  config::print(stderr, "device: {}\n", device.description);
  for (const std::string& note : device.notes) config::print(stderr, "note: {}\n", note);
}

/// How datagrams are marked, and the link that is practised on.
void set_up_link(connection::ServerLink& way, const RunOptions& options, int dscp) {
  if (dscp != 0 && !way.set_dscp(dscp))
    config::print(stderr, "note: --dscp {}: this system does not let datagrams be marked\n", options.dscp);
  if (!options.practice) return;
  way.practise(*options.practice);
  const std::string text = link::practice_text(*options.practice);
  if (!options.quiet && !text.empty()) config::print(stderr, "practice link: {}\n", text);
}

/// Twins of the scene that was named, if there was one, and what is wished for from the server.
struct TwinWish {
  Twins twins;
  std::string no_twin;  ///< why there is none in spite of that
  bool wanted = false;  ///< somebody asked for the method
  bool looks_for = false;
};

TwinWish twin_wish(const RunOptions& options, const StationFile& file, const SessionView& view) {
  TwinWish wish;
  wish.wanted = file.station.method == control::Method::kTwin && !file.chooses_method;
  // The scene is run here too. Whether it is the server's own, the Welcome says.
  if (!options.scene.empty()) {
    wish.twins = twin::load_twins(options.scene, 2);
    wish.no_twin = too_slow(*wish.twins[0], file.station.rate_hz);
    if (!wish.no_twin.empty()) wish.twins.clear();
  }
  // Where nobody has said which, the sample itself is the first choice. Who only looks on feels nothing, but
  // sees by it the marks that others make.
  const bool looks_on = options.observe && (view.wanted() || !options.record.empty());
  wish.looks_for =
      options.scene.empty() && (wish.wanted || (file.chooses_method && (!options.observe || looks_on)));
  return wish;
}

link::ClientConfig make_client_config(const RunOptions& options, const StationFile& file,
                                      const TwinWish& wish) {
  link::ClientConfig config;
  config.rate_hz = static_cast<std::uint32_t>(file.station.rate_hz);
  config.nonce_seed = connection::random_nonce_seed();
  config.redundancy = static_cast<std::size_t>(file.redundancy);
  // Only a replay needs to know in which order the slave stepped.
  if (options.record.empty()) config.feature_bits &= ~std::uint64_t{link::kFeatureStepHistory};
  if (wish.looks_for || !wish.twins.empty())
    config.step_ring = static_cast<std::size_t>(kTwinRingS * file.station.rate_hz);
  if (!wish.twins.empty()) config.snapshot_bytes = snapshot_room(*wish.twins[0]);
  return config;
}

/// Asks which scenes the server has, and goes to the one that was asked for.
std::vector<SceneChoice> to_wanted_scene(const RunOptions& options, link::ClientSession& session,
                                         connection::ServerLink& way, const net::Address& server,
                                         loop::ScenePipe& pipe, const std::atomic<bool>& stop) {
  std::vector<SceneChoice> scenes = list_scenes(session, way, server, pipe, stop);
  if (!scenes.empty() && !options.quiet)
    config::print(stderr, "note: this server has {} scenes: {} (--server-scene NAME)\n", scenes.size(),
                  names_of(scenes));
  if (!options.server_scene.empty())
    choose_scene(session, way, server, pipe, options.server_scene, scenes, stop);
  return scenes;
}

}  // namespace

int run_session(const RunOptions& options, std::optional<NextRun>& next) {
  const std::atomic<bool>& stop = catch_stop_signals();
  StationFile file = station_file(options);
  const DeviceSpec spec = parse_device_spec(options.device.value_or(file.device.kind));
  const bool simulated = spec.kind == DeviceSpec::Kind::kSim;
  // What is wrong with a task, a script or a device is found before a server is asked.
  if (simulated) intended_motion(options, file.task, 0);
  // Forks, so before whatever has threads, keys or sockets.
  scene_store::SceneKeeper scene(scene_options(options));
  SessionView view(options.view, spec.kind == DeviceSpec::Kind::kMouse);
  if (view.has_window()) next.emplace();
  SessionDevice opened = open_session_device(spec, file.device, options.home, view.pointer());
  if (!simulated) add_pedals(opened, file.pedal);
  if (!options.quiet && !simulated) tell_device(opened);
  const int dscp = net::parse_dscp(options.dscp, "--dscp");
  const net::Address server = net::parse_address(options.server, "--server");
  connection::ServerLink way(options, server);
  set_up_link(way, options, dscp);
  TwinWish wish = twin_wish(options, file, view);
  link::ClientConfig client_config = make_client_config(options, file, wish);
  std::optional<link::ClientSession> opened_session(client_config);
  std::optional<connection::Farewell> farewell;
  // Until the loop begins, whatever ends this ends the session too.
  farewell.emplace(*opened_session, way.datagram(), server);
  connection::connect(*opened_session, way, server, file.station.rate_hz, options, stop);
  const std::vector<SceneChoice> scenes =
      to_wanted_scene(options, *opened_session, way, server, scene.pipe(), stop);
  SessionParts parts{.options = options,
                     .stop = stop,
                     .file = file,
                     .simulated = simulated,
                     .scene = scene,
                     .view = view,
                     .next = next,
                     .opened = opened,
                     .way = way,
                     .server = server,
                     .wants_twin = wish.wanted,
                     .step_ring = client_config.step_ring,
                     .client_config = client_config,
                     .session = opened_session,
                     .farewell = farewell,
                     .scenes = scenes,
                     .looks_for_twin = wish.looks_for,
                     .twins = std::move(wish.twins),
                     .no_twin = wish.no_twin,
                     .record = options.record};
  while (true) {
    if (const std::optional<int> exit_code = run_at_scene(parts)) return *exit_code;
    go_on(parts);
  }
}

}  // namespace telenano::app
