#include "telenano/master/app/run/run_session.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/run/run_settings.h"
#include "telenano/master/app/run/server_scene.h"
#include "telenano/master/app/run/session_at_scene.h"
#include "telenano/master/app/run/session_file.h"
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
  if (!options.quiet) {
    scene.say = [new_line = isatty(STDERR_FILENO) != 0](const std::string& text) {
      fmt::print(stderr, "{}note: {}\n", new_line ? "\n" : "", text);
    };
  }
  return scene;
}

}  // namespace

int run_session(const RunOptions& options, std::optional<NextRun>& next) {
  const std::atomic<bool>& stop = catch_stop_signals();
  StationFile file = station_file(options);
  const station::StationConfig& config = file.station;
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
  if (!options.quiet && !simulated) {
    fmt::print(stderr, "device: {}\n", opened.description);
    for (const std::string& note : opened.notes) fmt::print(stderr, "note: {}\n", note);
  }
  const int dscp = net::parse_dscp(options.dscp, "--dscp");
  connection::ServerList servers(options);
  if (dscp != 0 && !servers.set_dscp(dscp))
    fmt::print(stderr, "note: --dscp {}: this system does not let datagrams be marked\n", options.dscp);
  if (options.practice) {
    servers.practise(*options.practice);
    const std::string text = link::practice_text(*options.practice);
    if (!options.quiet && !text.empty()) fmt::print(stderr, "practice link: {}\n", text);
  }
  link::ClientConfig client_config;
  client_config.rate_hz = static_cast<std::uint32_t>(config.rate_hz);
  client_config.nonce_seed = connection::random_nonce_seed();
  SessionFile session_file(options.session_file);
  client_config.resume_token = session_file.token();
  client_config.redundancy = static_cast<std::size_t>(file.redundancy);
  // Only a replay needs to know in which order the slave stepped.
  if (options.record.empty()) client_config.feature_bits &= ~std::uint64_t{link::kFeatureStepHistory};
  // The scene is run here too. Whether it is the server's own, the Welcome says.
  Twins twins;
  std::string no_twin;
  const bool last_run = client_config.resume_token != 0;
  const bool wants_twin = file.station.method == control::Method::kTwin && !file.chooses_method;
  if (!options.scene.empty()) {
    twins = twin::load_twins(options.scene, 2);
    no_twin = too_slow(*twins[0], config.rate_hz);
    if (!no_twin.empty()) twins.clear();
  }
  // Where nobody has said which, the sample itself is the first choice. Who only looks on feels nothing, but
  // sees by it the marks that others make.
  const bool looks_on = options.observe && (view.wanted() || !options.record.empty());
  bool looks_for_twin =
      options.scene.empty() && (wants_twin || (file.chooses_method && (!options.observe || looks_on)));
  if (looks_for_twin || !twins.empty())
    client_config.step_ring = static_cast<std::size_t>(kTwinRingS * config.rate_hz);
  if (!twins.empty()) client_config.snapshot_bytes = snapshot_room(*twins[0]);
  std::optional<link::ClientSession> opened_session;
  std::optional<connection::Farewell> farewell;
  connection::connect_to_any(opened_session, client_config, servers, config.rate_hz, stop,
                             [&](const std::string& why) {
                               if (!options.quiet) fmt::print(stderr, "note: {}\n", why);
                             });
  // Until the loop begins the session is this server's.
  connection::ServerLink& way = servers.link();
  const net::Address server = servers.address();
  farewell.emplace(*opened_session, way.datagram(), server);
  const bool resumed = opened_session->resumed_unknown_account();
  const std::vector<SceneChoice> scenes = list_scenes(*opened_session, way, server, scene.pipe(), stop);
  if (!scenes.empty() && !options.quiet)
    fmt::print(stderr, "note: this server has {} scenes: {} (--server-scene NAME)\n", scenes.size(),
               names_of(scenes));
  if (!options.server_scene.empty())
    choose_scene(*opened_session, way, server, scene.pipe(), options.server_scene, scenes, stop);
  SessionParts parts{.options = options,
                     .stop = stop,
                     .file = file,
                     .simulated = simulated,
                     .scene = scene,
                     .view = view,
                     .next = next,
                     .opened = opened,
                     .servers = servers,
                     .session_file = session_file,
                     .wants_twin = wants_twin,
                     .last_run = last_run,
                     .resumed = resumed,
                     .step_ring = client_config.step_ring,
                     .client_config = client_config,
                     .session = opened_session,
                     .farewell = farewell,
                     .scenes = scenes,
                     .looks_for_twin = looks_for_twin,
                     .twins = std::move(twins),
                     .no_twin = no_twin,
                     .record = options.record};
  while (true) {
    if (const std::optional<int> exit_code = run_at_scene(parts)) return *exit_code;
    go_on(parts);
  }
}

}  // namespace telenano::app
