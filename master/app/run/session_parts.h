#pragma once

#include <atomic>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/run/early_thread.h"
#include "telenano/master/app/run/keep_awake.h"
#include "telenano/master/app/run/next_run.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/run/server_scene.h"
#include "telenano/master/app/run/session_twin.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/app/view/session_view.h"
#include "telenano/master/connection/connect.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/scene/scene_keeper.h"
#include "telenano/master/station/station.h"

namespace telenano::app {

/// What lasts while a session goes from one of the server's scenes to another.
struct SessionParts {
  const RunOptions& options;
  const std::atomic<bool>& stop;
  const StationFile& file;
  bool simulated;
  scene_store::SceneKeeper& scene;
  SessionView& view;
  std::optional<NextRun>& next;
  SessionDevice& opened;
  connection::ServerLink& way;
  const net::Address& server;
  bool wants_twin;
  std::size_t step_ring;  ///< that is asked for where there may be a twin
  link::ClientConfig& client_config;
  std::optional<link::ClientSession>& session;
  std::optional<connection::Farewell>& farewell;
  std::vector<SceneChoice> scenes{};
  // From scene to scene.
  bool looks_for_twin;
  Twins twins{};
  std::string no_twin{};
  std::string record;          ///< file of the next recording; empty: none
  std::string metrics{};       ///< address
  std::string scene_before{};  ///< name of the one that was left; empty: this is the first
  std::optional<station::Station> station{};
  EarlyThread starter{};
  std::optional<KeepAwake> awake{};  ///< between the loops of two scenes
};

}  // namespace telenano::app
