#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/control/local_slave.h"
#include "telenano/common/link/client_session.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/scene/scene_keeper.h"
#include "telenano/master/station/station.h"
#include "telenano/master/station/twin_run.h"

namespace telenano::app {

using Twins = std::vector<std::unique_ptr<control::LocalSlave>>;

/// Steps that are kept until the server has made them; twice what is felt without its word.
inline constexpr double kTwinRingS = 4;

/// The longest round trip: what comes later confirms a step that is too old to be felt (TwinRun::lag_most_s).
inline constexpr double kTwinMostS = 0.5 * kTwinRingS;

/// A scene that comes for the first time: 265 kB take 0.7 s over 20 ms. What takes longer comes later.
inline constexpr double kSceneWaitS = 2;

station::TwinRunConfig twin_config(double rate_hz);

/// Bytes of this twin's state that are taken from a server at most.
std::size_t snapshot_room(const control::LocalSlave& twin);

/// Why a tick has no room for this twin; empty: it has.
std::string too_slow(control::LocalSlave& twin, double rate_hz);

/// Twins of the server's scene; none, and `why`: there can be none in this session. `wanted`: somebody has
/// asked for the twin; else it is the rule's first choice, nobody waits for it but some seconds, the first
/// time, and what takes its place is the rule's next. The session stays awake meanwhile.
Twins find_twins(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                 double rate_hz, bool wanted, bool quiet, scene_store::SceneKeeper& keeper,
                 const std::atomic<bool>& stop, std::string& why);

/// Says what of the wish for a twin this server does not give.
void use_twin(std::vector<std::unique_ptr<control::LocalSlave>> twins, const link::Welcome& welcome,
              const station::StationConfig& config, station::Station& station, bool quiet);

/// One line of what takes the twin's place, and why.
void tell_no_twin(const std::string& why, bool wanted);

}  // namespace telenano::app
