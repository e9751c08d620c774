#include "master/twin/load_twin.h"

#include "nve_server/scene/scene.h"
#include "master/twin/scene_twin.h"

namespace telenano::twin {

std::vector<std::unique_ptr<control::LocalSlave>> load_twins(const std::string& name_or_path,
                                                             std::size_t count) {
  const auto scene = scene::load_scene(name_or_path);
  std::vector<std::unique_ptr<control::LocalSlave>> twins;
  for (std::size_t i = 0; i < count; ++i) twins.push_back(std::make_unique<SceneTwin>(scene));
  return twins;
}

}  // namespace telenano::twin
