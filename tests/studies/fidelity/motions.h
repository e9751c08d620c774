#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/master/device/intended_motion.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::studies::fidelity {

/// A motion that suits a scene: what one does there, in some seconds, from the start and back up again.
struct SceneMotion {
  const char* scene;                                     ///< name of the file in deploy/scenes
  const char* motion;                                    ///< unique within the scene
  bool quick;                                            ///< part of a quick run
  std::vector<device::IntendedMotion::Waypoint> script;  ///< nm; z over the surface at the start
  double velocity_scale = 1e-6;                          ///< α_v; the hand's box must hold the motion
};

/// All scenes that come with the project.
std::span<const SceneMotion> scene_motions();

/// Which of them: names of scenes ("flakes") or scene/motion ("flakes/raster"); empty: all. Throws UserError
/// for a name that is neither.
std::vector<const SceneMotion*> chosen_motions(const std::vector<std::string>& names, bool quick);

}  // namespace telenano::studies::fidelity
