#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <span>

#include "telenano/common/link/client_session.h"
#include "telenano/common/link/rate_control.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/latest_value.h"
#include "telenano/common/rt/spsc_queue.h"

namespace telenano::loop {

/// What the newest Welcome offers.
struct OfferedScene {
  link::SceneOffer scene;
  std::uint64_t sessions = 0;  ///< Welcomes so far: another number, another session
  bool up = false;             ///< requests can be answered
};
struct ScenePiece {
  std::uint64_t bundle = 0;
  std::uint32_t chunk = 0;
  std::uint32_t size = 0;
  std::array<std::uint8_t, link::kSceneChunkBytes> data{};
};
struct SceneAsk {
  std::uint64_t bundle = 0;
  std::uint32_t chunk = 0;
};

/// Between the loop, which has the session, and whoever fetches the scene (PROTOCOL.md, section 14) in a
/// thread of its own: what is offered and the pieces go one way, the requests the other. Neither side waits,
/// and the loop only copies: what is dropped here is as lost on the way, and asked for again.
struct ScenePipe {
  rt::LatestValue<OfferedScene> offer;
  rt::SpscQueue<ScenePiece> pieces{512};
  rt::SpscQueue<SceneAsk> requests{64};
  /// Requests a second that the link has room for, as the loop's rate control sees it.
  std::atomic<double> link_most_per_s{link::RateControl::kBulkMost_per_s};

  // The loop's side.

  /// After session.on_datagram() has said kSceneChunk.
  void take(const link::SceneChunk& chunk) noexcept {
    piece_.bundle = chunk.bundle;
    piece_.chunk = chunk.chunk;
    piece_.size = chunk.size;
    std::copy_n(chunk.data.begin(), std::min<std::size_t>(chunk.size, chunk.data.size()),
                piece_.data.begin());
    pieces.push(piece_);
  }

  /// Once a tick, after the command: tells of the session and sends what is asked for, `most` at most. Returns how many.
  int turn(link::ClientSession& session, net::Datagram& socket, const net::Address& server,
           std::span<std::uint8_t> buffer, int most = 2) noexcept {
    const bool up = session.state() == link::ClientState::kEstablished;
    if (session.sessions() != told_.sessions || up != told_.up) {
      told_ = {session.welcome().scene, session.sessions(), up};
      offer.store(told_);
    }
    SceneAsk request;
    int sent = 0;
    for (int i = 0; i < most && requests.pop(request); ++i) {
      if (request.bundle != session.welcome().scene.name()) continue;
      const std::size_t size = session.make_scene_request(request.chunk, buffer);
      if (size == 0) continue;
      socket.send(std::span<const std::uint8_t>(buffer).first(size), server);
      ++sent;
    }
    return sent;
  }

 private:
  OfferedScene told_;
  ScenePiece piece_;
};

}  // namespace telenano::loop
