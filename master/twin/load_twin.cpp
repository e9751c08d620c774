#include "telenano/master/twin/load_twin.h"

#include "telenano/master/twin/scene_twin.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/scene/scene_bundle.h"

namespace telenano::twin {

namespace {

std::vector<std::unique_ptr<control::LocalSlave>> twins_of(const std::shared_ptr<const scene::Scene>& scene,
                                                           std::size_t count) {
  std::vector<std::unique_ptr<control::LocalSlave>> twins;
  const slave::PortGround ground(*scene);
  for (std::size_t i = 0; i < count; ++i) twins.push_back(std::make_unique<SceneTwin>(scene, ground));
  return twins;
}

}  // namespace

std::vector<std::unique_ptr<control::LocalSlave>> load_twins(const std::string& name_or_path,
                                                             std::size_t count) {
  return twins_of(scene::load_scene(name_or_path), count);
}

std::vector<std::unique_ptr<control::LocalSlave>> decode_twins(std::string_view bundle, std::size_t count) {
  return twins_of(scene::decode_bundle(bundle), count);
}

}  // namespace telenano::twin
