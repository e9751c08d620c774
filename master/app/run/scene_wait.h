#pragma once

#include <atomic>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/datagram.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/scene/scene_keeper.h"

namespace telenano::app {

/// Gives the scene a little time before the loop begins: what records needs its bytes, what draws needs it
/// looked at. The session is kept awake meanwhile; what is not here in time comes while it runs. Returns
/// after at most `wait_s`, or on `stop`.
void wait_for_scene(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                    scene_store::SceneKeeper& keeper, bool looked_at, double wait_s,
                    const std::atomic<bool>& stop);

}  // namespace telenano::app
