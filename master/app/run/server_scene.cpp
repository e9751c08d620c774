#include "telenano/master/app/run/server_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <span>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/loop/session_tender.h"

namespace telenano::app {
namespace {

// A list takes some round trips. Making a slave may take the server a while, or have to wait for its turn.
constexpr double kListS = 10;
constexpr double kSwitchS = 30;
constexpr std::int64_t kAskAgainNs = 100'000'000;
// No person reads a longer list.
constexpr std::uint32_t kScenesMost = 1024;

std::string text_of(const link::SceneName& name) {
  return {name.text.begin(), std::find(name.text.begin(), name.text.end(), '\0')};
}

/// Nothing is fetched meanwhile: any session takes so many commands.
constexpr double kFewest_hz = 10;

/// Tends the session until `done`; `on_event` hears what comes, `send` has its turn each time. False: the time was
/// over, or the session is gone.
bool tend_until(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                loop::ScenePipe& pipe, double most_s, const std::atomic<bool>& stop,
                const std::function<void(link::ClientEvent)>& on_event,
                const std::function<void(std::int64_t)>& send, const std::function<bool()>& done) {
  const rt::SteadyClock clock;
  loop::SessionTender tender(session, way.datagram(), server, pipe, clock, kFewest_hz);
  tender.on_event = on_event;
  const std::int64_t end_ns = clock.now_ns() + std::llround(1e9 * most_s);
  while (!done()) {
    if (stop) throw RunError("stopped before the session began");
    const std::int64_t now_ns = clock.now_ns();
    if (now_ns > end_ns || session.state() == link::ClientState::kClosed ||
        session.state() == link::ClientState::kRefused)
      return false;
    send(now_ns);
    tender.turn();
    way.wait_readable(1'000'000);
  }
  return true;
}

}  // namespace

std::string names_of(const std::vector<SceneChoice>& scenes) {
  std::string names;
  for (const SceneChoice& scene : scenes) names += (names.empty() ? "" : ", ") + scene.name;
  return names;
}

std::vector<SceneChoice> list_scenes(link::ClientSession& session, connection::ServerLink& way,
                                     const net::Address& server, loop::ScenePipe& pipe,
                                     const std::atomic<bool>& stop) {
  std::vector<SceneChoice> scenes;
  if ((session.features() & link::kFeatureSceneSwitch) == 0) return scenes;
  std::optional<std::uint32_t> count;
  std::int64_t next_ns = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  const auto take = [&](link::ClientEvent event) {
    const link::SceneListEntry& entry = session.incoming().scene_list_entry;
    if (event != link::ClientEvent::kSceneEntry || entry.index != scenes.size()) return;
    if (!count) count = std::min(entry.count, kScenesMost);
    scenes.push_back({text_of(entry.scene_name), entry.scene_hash});
    next_ns = 0;
  };
  const auto ask = [&](std::int64_t now_ns) {
    if (now_ns < next_ns) return;
    next_ns = now_ns + std::max(kAskAgainNs, static_cast<std::int64_t>(2 * session.stats().rtt_ns()));
    const std::size_t size =
        session.make_scene_list_request(static_cast<std::uint32_t>(scenes.size()), buffer);
    if (size > 0) way.datagram().send(std::span<const std::uint8_t>(buffer).first(size), server);
  };
  const auto all = [&] { return count && scenes.size() >= *count; };
  if (!tend_until(session, way, server, pipe, kListS, stop, take, ask, all))
    throw RunError("the server does not send its list of scenes; try again");
  return scenes;
}

void choose_scene(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                  loop::ScenePipe& pipe, const std::string& name, const std::vector<SceneChoice>& scenes,
                  const std::atomic<bool>& stop) {
  const std::string served = text_of(session.welcome().scene_name);
  const auto wanted = std::find_if(scenes.begin(), scenes.end(),
                                   [&](const SceneChoice& scene) { return scene.name == name; });
  if (wanted == scenes.end()) {
    if (scenes.empty() && served == name) return;
    throw RunError(scenes.empty()
                       ? fmt::format("--server-scene '{}': the server serves only '{}'", name, served)
                       : fmt::format("--server-scene '{}': the server has {}", name, names_of(scenes)));
  }
  if (session.welcome().scene_hash == wanted->hash) return;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  session.switch_scene(wanted->hash, rt::SteadyClock().now_ns());
  const auto ask = [&](std::int64_t now_ns) {
    const std::size_t size = session.poll(now_ns, buffer);
    if (size > 0) way.datagram().send(std::span<const std::uint8_t>(buffer).first(size), server);
  };
  const auto answered = [&] { return session.scene_switching() != link::SceneSwitching::kAsked; };
  const bool in_time = tend_until(
      session, way, server, pipe, kSwitchS, stop, [](link::ClientEvent) {}, ask, answered);
  if (!in_time)
    throw RunError(
        fmt::format("the server did not move the session to its scene '{}': it does not answer", name));
  if (session.scene_switching() == link::SceneSwitching::kDone) return;
  const bool rate = session.refuse().reason == link::RefuseReason::kRate;
  throw RunError(fmt::format("the server did not move the session to its scene '{}': {}", name,
                             rate ? "it takes fewer commands a second; try a lower --rate"
                                  : "it has no room there now; try again later"));
}

}  // namespace telenano::app
