#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>

#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/slave.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// The scenes of a sweep, each loaded once and shared by all runs. Threads may use one object.
class Scenes {
 public:
  /// `folder` with the scenes' files; those in `kinds` are loaded now. Throws UserError.
  Scenes(const std::filesystem::path& folder, const std::vector<SceneKind>& kinds);
  /// All of them, from this source tree.
  static const Scenes& of_this_tree();

  std::unique_ptr<slave::Slave> make(SceneKind kind, double start_height_nm) const;
  /// Null for those that have no file.
  std::shared_ptr<const scene::Scene> file(SceneKind kind) const;
  bool has(SceneKind kind) const;

 private:
  std::map<SceneKind, std::shared_ptr<const scene::Scene>> files_;
};

}  // namespace telenano::studies::stress
