#include "telenano/nve_server/server/server.h"

#include <algorithm>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/server/session_features.h"

namespace telenano::server {

using link::DropCause;

namespace {

/// Openings at once; the sessions that run wait for so long at most.
constexpr std::int64_t kOpeningBurstNs = 10'000'000;
constexpr std::size_t kPartyOpenings = 1024;

/// A name that fills its place has no zero at its end.
std::string text_of(const link::SceneName& name) {
  return {name.text.begin(), std::find(name.text.begin(), name.text.end(), '\0')};
}

std::unique_ptr<slave::Slave> first_slave(const ServedScene& scene) {
  auto slave = scene.make_slave ? scene.make_slave() : nullptr;
  if (!slave) throw RunError("the scene '" + text_of(scene.name) + "' made no slave");
  return slave;
}

/// A station knows a scene by its hash, a person by its name.
void require_apart(const std::vector<ServedScene>& scenes) {
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (scenes[i].hash != scenes[k].hash && !(scenes[i].name == scenes[k].name)) continue;
      throw UserError("the scene '" + text_of(scenes[i].name) +
                      "' is served twice: give each --scene once, and each file a name of its own");
    }
  }
}

/// Sharing is offered where there is something to share, and asked for there; a particle and a well where
/// there is one.
std::uint64_t features_of(const ServerConfig& config, const slave::SlaveLimits& limits, bool knows_state,
                          const ServedScene& scene, std::size_t scenes) {
  std::uint64_t bits = config.feature_bits & ~std::uint64_t{link::kFeatureSharing};
  if (config.share == Share::kOneTip) bits |= link::kFeatureSharing;
  if (!limits.has_particle) bits &= ~std::uint64_t{link::kFeatureParticle};
  if (!scene.to_fetch) bits &= ~std::uint64_t{link::kFeatureScene};
  if (!limits.keeps_marks) bits &= ~std::uint64_t{link::kFeatureUndo};
  if (!has_well(limits)) bits &= ~std::uint64_t{link::kFeatureWell};
  if (scenes < 2) bits &= ~std::uint64_t{link::kFeatureSceneSwitch};
  // A log of steps asks for a slave whose state they make.
  constexpr std::uint64_t kLogs = link::kFeatureStepLog | link::kFeatureSharedLog;
  if (!knows_state) bits &= ~kLogs;
  if (config.share != Share::kOneTip) bits &= ~std::uint64_t{link::kFeatureSharedLog};
  return bits;
}

link::ServerHandshakeConfig handshake_config(const ServerConfig& config, std::uint64_t feature_bits,
                                             std::uint32_t rate_max_hz) {
  link::ServerHandshakeConfig handshake;
  handshake.secret = config.secret;
  handshake.feature_bits = feature_bits;
  if (config.share == Share::kOneTip) handshake.required_bits = link::kFeatureSharing;
  handshake.rate_max_hz = rate_max_hz;
  handshake.challenges_per_s = config.challenges_per_s;
  handshake.openings_per_s = config.openings_per_s;
  handshake.openings_per_party_s = std::min(config.openings_per_party_s, config.openings_per_s);
  return handshake;
}

}  // namespace

link::SceneName scene_name(const std::string& text) noexcept {
  link::SceneName name;
  std::copy_n(text.begin(), std::min(text.size(), link::kSceneNameBytes), name.text.begin());
  return name;
}

std::vector<Server::Offered> Server::offered(const ServerConfig& config, std::vector<ServedScene> scenes) {
  if (scenes.empty()) throw UserError("a server needs a scene");
  if (scenes.size() > 1 && config.share == Share::kOneTip)
    throw UserError(
        "several scenes need a tip for each session: leave out --share one-tip, or serve one scene");
  require_apart(scenes);
  std::vector<Offered> all;
  for (ServedScene& scene : scenes) {
    Offered one;
    one.spare = first_slave(scene);
    one.limits = one.spare->limits();
    one.feature_bits = features_of(config, one.limits, one.spare->state_hash() != 0, scene, scenes.size());
    one.scene = std::move(scene);
    all.push_back(std::move(one));
  }
  return all;
}

namespace {
std::vector<ServedScene> only(ServedScene scene) {
  std::vector<ServedScene> one;
  one.push_back(std::move(scene));
  return one;
}
}  // namespace

Server::Server(const ServerConfig& config, ServedScene scene) : Server(config, only(std::move(scene))) {}

Server::Server(const ServerConfig& config, std::vector<ServedScene> scenes)
    : config_(config),
      scenes_(offered(config, std::move(scenes))),
      table_(config.table, config.secret),
      handshake_(handshake_config(config, scenes_[0].feature_bits, scenes_[0].limits.rate_max_hz)),
      tips_(config.share == Share::kOneTip ? 1 : table_.capacity()),
      records_(table_.capacity()),
      parties_(config.work.enforced ? table_.capacity() + 1 : 0),
      is_behind_(table_.capacity(), 0),
      holder_(table_.capacity()),
      load_(config.load_most),
      openings_(config.openings_share, kOpeningBurstNs),
      party_openings_(kPartyOpenings, {config.openings_share *
                                           std::min(1.0, config.openings_per_party_s / config.openings_per_s),
                                       kOpeningBurstNs}),
      scene_chunks_(config.scene_chunks_all_per_s, kPiecesBurst) {
  behind_.reserve(table_.capacity());
  if (shared()) {
    make_tip(0, 0, 0);
    return;
  }
  for (const Offered& one : scenes_) {
    if (!one.scene.one_tip_only) continue;
    throw UserError(
        "the scene '" + text_of(one.scene.name) +
        "' has only one tip: it cannot be private to each session; serve it with --share one-tip");
  }
}

std::size_t Server::drop(DropCause cause) noexcept {
  drops_.add(cause);
  return 0;
}

std::size_t Server::on_datagram(std::span<const std::uint8_t> bytes, const net::Address& from,
                                std::int64_t now_ns, std::span<std::uint8_t> out, const rt::Clock* clock,
                                const net::Standing& standing, bool superseded) noexcept {
  ++counters_.datagrams;
  const DropCause cause = codec_.decode(bytes, incoming_);
  if (cause != DropCause::kNone) return drop(cause);
  standing_ = standing;
  now_ns_ = now_ns;
  clock_ = clock;
  superseded_ = superseded;
  switch (incoming_.type) {
    case link::MessageType::kCommand:
      return on_command(incoming_.command, from, now_ns, out, clock);
    case link::MessageType::kHello:
      return on_hello(incoming_.hello, from, now_ns, out, standing_);
    case link::MessageType::kSnapshotRequest:
      return on_snapshot_request(incoming_.snapshot_request, from, now_ns, out);
    case link::MessageType::kSceneRequest:
      return on_scene_request(incoming_.scene_request, from, now_ns, out);
    case link::MessageType::kSceneListRequest:
      return on_scene_list_request(incoming_.scene_list_request, from, now_ns, out);
    case link::MessageType::kSceneSwitch:
      return on_scene_switch(incoming_.scene_switch, from, now_ns, out);
    case link::MessageType::kBye:
      on_bye(incoming_.bye, from, now_ns);
      return 0;
    default:
      return drop(DropCause::kUnknownType);  // only a server may send these
  }
}

bool Server::make_tip(std::size_t slot, std::size_t scene, std::int64_t now_ns) noexcept {
  Tip& tip = tips_[slot];
  tip = {};
  Offered& of = scenes_[scene];
  if (of.spare) {
    tip.slave = std::move(of.spare);
  } else {
    try {
      tip.slave = of.scene.make_slave();
    } catch (...) {  // out of memory, or a scene file that has vanished: no session, but those that run go on
      tip.slave = nullptr;
    }
  }
  if (!tip.slave) return false;
  tip.output.tip_pos_w_nm = tip.output.commanded_pos_w_nm = tip.slave->limits().start_pos_w_nm;
  tip.last_target_w_nm = tip.slave->limits().start_pos_w_nm;
  tip.last_step_ns = now_ns;
  // Nothing has been read before the first step.
  if (tip.slave->limits().measures) tip.output.measurement_age_ns = slave::kNeverMeasuredNs;
  return true;
}

}  // namespace telenano::server
