#include "common/config/surface_force.h"

namespace telenano::config {

std::string default_surface_force(const TomlTable& scene) {
  const auto surface = scene.optional_table("surface");
  if (!surface || scene.has("particle")) return "foot";
  const auto sample = scene.optional_table("sample");
  if (sample && sample->has("hardness_gpa")) return "foot";
  const std::string kind = surface->text_or("kind", "");
  return kind == "scan" || kind == "step" || kind == "grating" ? "potential" : "foot";
}

}  // namespace telenano::config
