#include "tests/studies/replay/replay_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/nve_server/scene/scene_bundle.h"
#include "tests/studies/replay/replay.h"

namespace telenano::studies {
namespace {

struct ReplayOptions {
  std::vector<std::string> files;
  std::string scene;
};

using ScenePtr = std::shared_ptr<const scene::Scene>;

std::string hash_of(const scene::Scene& scene) {
  return fmt::format("{:016x}", scene.hash);
}

constexpr const char* kUnknownForce = "unknown";  // to a station without the scene

/// Null where it cannot be read, or is another.
template <class Load>
ScenePtr if_recorded(const RecordedSession& recorded, const Load& load) {
  try {
    ScenePtr scene = load();
    return hash_of(*scene) == recorded.scene_hash ? scene : nullptr;
  } catch (const UserError&) {
    return nullptr;
  }
}

/// The very scene that was recorded: given, as the recording holds it whole, where the station had it, by its
/// name among those that came with the program or in this folder, or as the recording holds it.
ScenePtr scene_of(const RecordedSession& recorded, const std::string& given) {
  if (!given.empty()) {
    ScenePtr scene = scene::load_scene(given);
    if (hash_of(*scene) == recorded.scene_hash) return scene;
    throw UserError(
        fmt::format("{}: was recorded on another scene than {} (hash {}, not {}); name its file by "
                    "--scene FILE",
                    recorded.path.string(), scene->path, recorded.scene_hash, hash_of(*scene)));
  }
  if (!recorded.scene_bundle.empty()) {
    if (auto scene = if_recorded(recorded, [&] { return scene::decode_bundle(recorded.scene_bundle); }))
      return scene;
  }
  const std::string& name = recorded.scene_name;
  // The name comes from a server: it may lead nowhere else.
  const bool plain = !name.empty() && name.front() != '.' && name.find('/') == std::string::npos;
  std::vector<std::string> places;
  if (!recorded.scene_path.empty()) places.push_back(recorded.scene_path);
  if (plain) places.insert(places.end(), {name, "./" + name + ".toml"});
  for (const std::string& place : places) {
    if (auto scene = if_recorded(recorded, [&] { return scene::load_scene(place); })) return scene;
  }
  if (!recorded.scene_text.empty()) {
    const std::string as = recorded.scene_path.empty() ? name : recorded.scene_path;
    if (auto scene = if_recorded(recorded, [&] { return scene::parse_scene(recorded.scene_text, as); }))
      return scene;
  }
  throw UserError(fmt::format(
      "{}: was recorded on the scene '{}' (hash {}), and no such file is here, neither among those that came "
      "with the program nor as {}.toml in this folder; name its file by --scene FILE",
      recorded.path.string(), name, recorded.scene_hash, name));
}

/// Forces over relief were others before the ground was one potential: by the nearest point ("foot", or no
/// word), of which there is no program any more. On a level sample it is the same law.
ScenePtr with_recorded_force(const RecordedSession& recorded, ScenePtr scene) {
  const std::string& then = recorded.surface_force;
  if (!scene->potential || then == "potential" || then == kUnknownForce) return scene;
  throw UserError(
      fmt::format("{}: was recorded with the ground by the nearest point (surface.force = \"{}\"), which is "
                  "gone: replay it with the program that recorded it, version {}",
                  recorded.path.string(), then.empty() ? "foot" : then, "0.1 or before"));
}

bool run_one(const std::string& file, const std::string& scene) {
  const RecordedSession recorded = load_session(file);
  const ReplayResult result = replay(recorded, with_recorded_force(recorded, scene_of(recorded, scene)));
  std::printf("%s,%lld,%lld,%lld,%lld,%.3g,%lld,%s\n", file.c_str(),
              static_cast<long long>(result.recorded_ticks), static_cast<long long>(result.replayed_ticks),
              static_cast<long long>(result.equal_ticks), static_cast<long long>(result.steps),
              result.largest_force_error_n, static_cast<long long>(result.told_ticks),
              result.exact() ? "yes" : "no");
  std::fflush(stdout);
  if (!result.exact()) {
    std::fprintf(stderr,
                 "telenano-lab: %s: tick %lld differs first, in %s: %.17g was recorded, %.17g came out\n",
                 file.c_str(), static_cast<long long>(result.first_difference), result.column.c_str(),
                 result.recorded, result.replayed);
  }
  if (!result.ended.empty()) {
    std::fprintf(stderr, "telenano-lab: %s: replayed to tick %lld: %s\n", file.c_str(),
                 static_cast<long long>(result.replayed_ticks), result.ended.c_str());
  }
  return result.exact();
}

}  // namespace

void add_replay_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand(
      "replay",
      "Replay recorded sessions in virtual time and check that every force is the recorded one, bit for bit");
  const auto options = std::make_shared<ReplayOptions>();
  command->add_option("FILE", options->files, "recordings")->required();
  command
      ->add_option("--scene", options->scene,
                   "Scene: a file (TOML) or the name of a supplied scene (default: the recorded one)")
      ->type_name(config::kSceneOrFile);
  command->callback([options, &exit_code] {
    std::printf(
        "file,recorded_ticks,replayed_ticks,equal_ticks,slave_steps,largest_force_error_n,told_ticks,"
        "exact\n");
    for (const std::string& file : options->files)
      if (!run_one(file, options->scene)) exit_code = 1;
  });
}

}  // namespace telenano::studies
