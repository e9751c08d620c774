#include "tests/studies/stress/scenes.h"

#include "telenano/common/config/shared_files.h"
#include "telenano/master/twin/scene_twin.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies::stress {
namespace {

const char* file_name(SceneKind kind) {
  switch (kind) {
    case SceneKind::kOxide:
      return "flat_silicon_oxide.toml";
    case SceneKind::kPolystyrene:
      return "flat_polystyrene.toml";
    case SceneKind::kPdms:
      return "flat_pdms.toml";
    case SceneKind::kScan:
      return "flakes.toml";
    case SceneKind::kMoist:
      return "humid_flakes.toml";
    case SceneKind::kMarks:
      return "lithography.toml";
    case SceneKind::kParticle:
      return "particle.toml";
    default:
      return nullptr;
  }
}

}  // namespace

Scenes::Scenes(const std::filesystem::path& folder, const std::vector<SceneKind>& kinds) {
  for (const SceneKind kind : kinds) {
    if (files_.contains(kind)) continue;
    const char* const name = file_name(kind);
    const auto& scene = files_[kind] =
        name == nullptr ? nullptr : scene::load_scene((folder / name).string());
    if (scene) grounds_.emplace(kind, slave::PortGround(*scene));
  }
}

const Scenes& Scenes::of_this_tree() {
  static const Scenes scenes(config::shared_folder() / "scenes",
                             {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPolystyrene, SceneKind::kPdms,
                              SceneKind::kScan, SceneKind::kHard});
  return scenes;
}

std::unique_ptr<slave::Slave> Scenes::make(SceneKind kind, double start_height_nm) const {
  if (const auto& scene = files_.at(kind)) {
    return std::make_unique<slave::NveSlave>(scene, grounds_.at(kind));
  }
  support::WallSlaveConfig wall;
  wall.start_height_nm = start_height_nm;
  if (kind == SceneKind::kHard) wall.stiffness_n_m = 2000;
  return std::make_unique<support::WallSlave>(wall);
}

std::unique_ptr<control::LocalSlave> Scenes::make_twin(SceneKind kind) const {
  return std::make_unique<twin::SceneTwin>(files_.at(kind), grounds_.at(kind));
}

std::shared_ptr<const scene::Scene> Scenes::file(SceneKind kind) const {
  return files_.at(kind);
}

bool Scenes::has(SceneKind kind) const {
  return files_.contains(kind);
}

}  // namespace telenano::studies::stress
