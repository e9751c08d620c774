#include "telenano/common/config/surface_force.h"

namespace telenano::config {

std::string default_surface_force(const TomlTable& scene) {
  const auto surface = scene.optional_table("surface");
  if (!surface || scene.has("particle")) return "foot";
  const auto sample = scene.optional_table("sample");
  const bool yields = sample && sample->has("hardness_gpa");  // any shape is a grid then
  const std::string kind = surface->text_or("kind", "");
  return yields || kind == "scan" || kind == "step" || kind == "grating" ? "potential" : "foot";
}

}  // namespace telenano::config
