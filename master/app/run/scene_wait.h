#pragma once

#include <atomic>
#include <functional>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/datagram.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/scene/scene_keeper.h"

namespace telenano::app {

/// What of the scene is waited for, each with those before it: a recording needs its bytes, a window its
/// heights, a twin or a photograph the whole.
enum class SceneWait { kBytes, kGround, kLookedAt };

/// Gives the scene a little time before the loop begins. The session is kept awake meanwhile; what is not here in time comes while it runs. Returns
/// after at most `wait_s`, or on `stop`. `rate_hz`: the session's. `each_second`: called so often.
void wait_for_scene(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                    scene_store::SceneKeeper& keeper, SceneWait wanted, double wait_s, double rate_hz,
                    const std::atomic<bool>& stop, const std::function<void()>& each_second = nullptr);

}  // namespace telenano::app
