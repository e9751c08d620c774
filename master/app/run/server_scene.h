#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/loop/scene_pipe.h"

namespace telenano::app {

/// One of the scenes that a server offers (PROTOCOL.md, section 17).
struct SceneChoice {
  std::string name;
  std::uint64_t hash = 0;
};

/// All of them, in the server's order; none: it has only the one that it serves. The session has no loop, and is
/// kept awake meanwhile. Throws RunError when the list does not come in time, or on `stop`.
std::vector<SceneChoice> list_scenes(link::ClientSession& session, connection::ServerLink& way,
                                     const net::Address& server, loop::ScenePipe& pipe,
                                     const std::atomic<bool>& stop);

/// Brings the session to the scene of this name, if it is not there; then its Welcome is that scene's. Likewise;
/// throws RunError also where the server has no such scene, or does not bring it there.
void choose_scene(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                  loop::ScenePipe& pipe, const std::string& name, const std::vector<SceneChoice>& scenes,
                  const std::atomic<bool>& stop);

/// "a, b, c".
std::string names_of(const std::vector<SceneChoice>& scenes);

}  // namespace telenano::app
