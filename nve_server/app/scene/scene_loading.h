#pragma once

#include <functional>
#include <memory>
#include <string>

#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/scene/scene_bundle.h"

namespace telenano::app {

/// Loads a scene with the fields of its scan from the user's cache ($TELENANO_CACHE, or "off"), and says on
/// `tell` what takes long: lines without an end.
std::shared_ptr<const scene::Scene> load_scene(const std::string& name_or_path,
                                               const std::function<void(const std::string&)>& tell);

/// The same with its bundle for a server that starts: tells stderr, and the service manager, which would
/// otherwise take a slow machine's first start for one that hangs. Throws StoppedWhileLoading when asked to
/// stop (server_signals.h).
scene::SceneWithBundle load_scene_with_bundle(const std::string& name_or_path);

/// The same, telling stderr if that is a terminal: a command's error output is for its errors.
std::shared_ptr<const scene::Scene> load_scene(const std::string& name_or_path);

}  // namespace telenano::app
