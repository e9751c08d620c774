#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "telenano/nve_server/app/serve/serve_afm.h"
#include "telenano/nve_server/app/serve/serve_security.h"
#include "telenano/nve_server/app/serve/serve_workers.h"

namespace telenano::app {

/// The flags of `serve`.
struct ServeOptions {
  std::vector<std::string> scenes;
  std::string surfaces;
  std::string listen = "127.0.0.1:5100";
  std::size_t max_sessions = 64;
  std::optional<std::size_t> sessions_per_peer;  // left out: a quarter of all
  std::string local_rights;                      // left out: operate
  std::string local_users;                       // left out: every local user
  std::optional<int> timeout_ms;                 // left out: as the scene says
  int resume_s = 30;
  bool no_scene_sharing = false;
  std::string share;  // left out: as the scene's slave must be, else private
  bool busy_poll = false;
  bool low_latency = false;
  int realtime_priority = 0;
  std::string audit;
  std::string metrics;
  bool metrics_public = false;
  std::string web;
  bool web_public = false;
  std::size_t web_clients = 8;
  std::string dscp = "ef";
  ServeSecurity security;
  ServeAfm afm;

  /// The one that sessions begin in; empty: none was given.
  std::string scene() const { return scenes.empty() ? "" : scenes.front(); }
};

/// For the log: what is served.
std::string names_of(const ServeOptions& options);

/// What the threads need to know. Throws UserError for flags that do not go together.
WorkersConfig checked_workers(ServeOptions& options);

}  // namespace telenano::app
