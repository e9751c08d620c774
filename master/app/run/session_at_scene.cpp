#include "telenano/master/app/run/session_at_scene.h"

#include <fmt/format.h>

#include <cstdio>

#include "telenano/common/config/print.h"
#include "telenano/master/app/run/scene_preparation.h"
#include "telenano/master/app/run/scene_session.h"

namespace telenano::app {
namespace {

/// The options as they are for the scene at hand: what was asked for the first one only is over, and a recording is of
/// one scene.
RunOptions options_here(const SessionParts& parts) {
  RunOptions options = parts.options;
  if (parts.scene_before.empty()) return options;
  options.record = parts.record;
  options.overwrite = false;
  options.metrics = parts.metrics;
  options.undo_marks_at_s.reset();
  return options;
}

}  // namespace

std::optional<int> run_at_scene(SessionParts& parts) {
  const RunOptions options = options_here(parts);
  const LinkDelay link = prepare_scene(parts, options);
  // A person has closed the window: nothing was begun, and the session's Bye goes with `farewell`.
  if (parts.stop && parts.view.has_window()) {
    config::print(stderr, "stopped by the operator\n");
    return 0;
  }
  SceneSession session(parts, options, link);
  return session.run();
}

void go_on(SessionParts& parts) {
  parts.awake.reset();
  parts.twins.clear();
  parts.no_twin.clear();
  parts.looks_for_twin = parts.step_ring > 0;
  if (parts.looks_for_twin && parts.client_config.step_ring == 0) connect_again(parts, parts.step_ring);
}

}  // namespace telenano::app
