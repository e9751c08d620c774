#include "tests/studies/replay/replay_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "common/base/error.h"
#include "tests/studies/replay/replay.h"

namespace telenano::studies {
namespace {

struct ReplayOptions {
  std::vector<std::string> files;
  std::string scene;
};

std::shared_ptr<const scene::Scene> scene_of(const RecordedSession& recorded, const std::string& given) {
  const auto scene = scene::load_scene(given.empty() ? recorded.scene_name : given);
  const std::string hash = fmt::format("{:016x}", scene->hash);
  if (hash == recorded.scene_hash) return scene;
  throw UserError(
      fmt::format("{}: was recorded on another scene than {} (hash {}, not {}); name its file by --scene",
                  recorded.path.string(), scene->path, recorded.scene_hash, hash));
}

bool run_one(const std::string& file, const std::string& scene) {
  const RecordedSession recorded = load_session(file);
  const ReplayResult result = replay(recorded, scene_of(recorded, scene));
  std::printf("%s,%lld,%lld,%lld,%lld,%.3g,%s\n", file.c_str(), static_cast<long long>(result.recorded_ticks),
              static_cast<long long>(result.replayed_ticks), static_cast<long long>(result.equal_ticks),
              static_cast<long long>(result.steps), result.largest_force_error_n,
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
      "Run recorded sessions again in virtual time: every force must come out as recorded, bit for bit");
  const auto options = std::make_shared<ReplayOptions>();
  command->add_option("FILE", options->files, "recordings")->required();
  command->add_option(
      "--scene", options->scene,
      "Scene: a file (TOML), or the name of one that came with the program; left out: as recorded");
  command->callback([options, &exit_code] {
    std::printf("file,recorded_ticks,replayed_ticks,equal_ticks,slave_steps,largest_force_error_n,exact\n");
    for (const std::string& file : options->files)
      if (!run_one(file, options->scene)) exit_code = 1;
  });
}

}  // namespace telenano::studies
