#include "telenano/master/app/run/scene_preparation.h"

#include <algorithm>
#include <memory>

#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/run/scene_wait.h"
#include "telenano/master/app/run/shown_ground.h"
#include "telenano/master/app/stop_signals.h"

namespace telenano::app {
namespace {

// The link is measured for so long before the session begins: enough for a median, too short to be noticed.
constexpr double kProbeS = 0.02;

constexpr int kProbeMin = 5;
constexpr int kProbeMax = 40;

/// With the session kept awake: a twin, then what is wanted of the scene.
void get_ready(SessionParts& parts, const RunOptions& options) {
  connection::ServerLink& way = parts.way;
  const net::Address server = parts.server;
  const double rate_hz = parts.file.station.rate_hz;
  SessionView& view = parts.view;
  if (parts.looks_for_twin) {
    parts.twins = find_twins(*parts.session, way, server, rate_hz, parts.wants_twin, options.quiet,
                             parts.scene, parts.stop, parts.no_twin);
    if (parts.stop && view.has_window()) return;
    if (!parts.twins.empty()) {
      parts.session->make_room_for_snapshot(snapshot_room(*parts.twins[0]));
    } else if (parts.session->logs_steps()) {
      // Whether steps are logged is agreed on with the session: on with the same slave, without the log.
      connect_again(parts, 0);
    }
  }
  parts.scene.start();
  if (!view.wanted() && options.record.empty()) return;
  const SceneWait wanted = view.has_window() ? SceneWait::kGround
                           : view.wanted()   ? SceneWait::kLookedAt
                                             : SceneWait::kBytes;
  wait_for_scene(*parts.session, way, server, parts.scene, wanted, kSceneWaitS, rate_hz, parts.stop);
}

}  // namespace

void connect_again(SessionParts& parts, std::size_t step_ring) {
  connection::ServerLink& way = parts.way;
  parts.client_config.step_ring = step_ring;
  parts.client_config.resume_token = parts.session->resume_token();
  parts.client_config.nonce_seed = connection::random_nonce_seed();
  if (parts.farewell) parts.farewell->leave_to_loop();
  parts.session.emplace(parts.client_config);
  connection::connect(*parts.session, way, parts.server, parts.file.station.rate_hz, parts.options,
                      parts.stop);
  parts.farewell.emplace(*parts.session, way.datagram(), parts.server);
}

LinkDelay prepare_scene(SessionParts& parts, const RunOptions& options) {
  connection::ServerLink& way = parts.way;
  const net::Address server = parts.server;
  const double rate_hz = parts.file.station.rate_hz;
  if (parts.farewell) parts.farewell->leave_to_loop();
  parts.farewell.emplace(*parts.session, way.datagram(), server);
  const int probes = std::clamp(static_cast<int>(kProbeS * rate_hz), kProbeMin, kProbeMax);
  const LinkDelay link =
      measure_link(*parts.session, way, server, rate_hz, probes, options.connect_timeout_s, parts.stop);
  const link::Welcome first = parts.session->welcome();
  parts.view.wait_for(
      {parts.looks_for_twin
           ? "The server's sample is made ready here, so that it can be felt without the link's delay. "
             "The first time this takes some seconds."
           : "The server's sample is on its way, so that it can be drawn.",
       options.server, slave_limits(first), first.start_pos_w_nm,
       [&scene = parts.scene, shown = std::shared_ptr<const surface::HeightGrid>()]() mutable {
         return newest_scene_ground(scene, shown);
       },
       [&scene = parts.scene] { return shown_scene(scene); }, stop_as_by_signal},
      [&] { parts.starter.call([&] { get_ready(parts, options); }); });
  return link;
}

}  // namespace telenano::app
