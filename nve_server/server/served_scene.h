#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "telenano/common/link/messages.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// A scene's bundle, for stations to fetch.
struct SceneToFetch {
  link::SceneOffer offer;
  std::string bytes;  ///< offer.bytes of them
};

/// What is served.
struct ServedScene {
  link::SceneName name;
  std::uint64_t hash = 0;
  /// Called once when the server is made and once for each further session, between its Hello and its
  /// Welcome: never within an established exchange, but in the same loop; so let slaves share what is costly
  /// to load.
  std::function<std::unique_ptr<slave::Slave>()> make_slave;
  std::uint32_t timeout_ms = 2000;  ///< that the scene asks for; who makes the SessionTableConfig decides
  bool one_tip_only = false;        ///< there is only one, as with a real instrument: never Share::kPrivate
  std::shared_ptr<const SceneToFetch> to_fetch;  ///< null: it cannot be fetched,
  std::string why_no_fetch;                      ///< because of this; empty: there is nothing to say
};

/// "flakes" → {'f','l',…,0}; cut to what fits.
link::SceneName scene_name(const std::string& text) noexcept;

}  // namespace telenano::server
