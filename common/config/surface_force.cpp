#include "telenano/common/config/surface_force.h"

namespace telenano::config {

std::string surface_force(const TomlTable& scene) {
  const auto surface = scene.optional_table("surface");
  const auto sample = scene.optional_table("sample");
  const bool flat = !surface || surface->text_or("kind", "") == "flat";
  const bool yields = sample && sample->has("hardness_gpa");
  return flat && !yields && !scene.has("particle") ? "law" : "potential";
}

}  // namespace telenano::config
