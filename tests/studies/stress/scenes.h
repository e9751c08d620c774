#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>

#include "telenano/common/control/local_slave.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/port_model.h"
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
  /// Of a kind that has a file.
  std::unique_ptr<control::LocalSlave> make_twin(SceneKind kind) const;
  /// Null for those that have no file.
  std::shared_ptr<const scene::Scene> file(SceneKind kind) const;
  bool has(SceneKind kind) const;

 private:
  std::map<SceneKind, std::shared_ptr<const scene::Scene>> files_;
  std::map<SceneKind, slave::PortGround> grounds_;  // a walk of some thousands of balances each
};

}  // namespace telenano::studies::stress
