#include "telenano/master/app/scene_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <exception>
#include <filesystem>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/base/fnv1a.h"
#include "telenano/common/config/shared_files.h"
#include "telenano/common/config/surface_force.h"
#include "telenano/common/config/toml_document.h"

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

// Of a description only what tells where its scan is: the rest is the server's to judge.
LocalScene read_scene(const std::string& path) {
  const config::TomlDocument document = config::TomlDocument::load(path);
  LocalScene scene{path, document.content(), "", config::surface_force(document.root())};
  const auto surface = document.root().optional_table("surface");
  if (surface && surface->text_or("kind", "") == "scan")
    scene.scan_path = document.resolve(surface->text("file"));
  if (surface) scene.force = surface->text_or("force", scene.force);
  const auto probe = document.root().optional_table("probe");
  if (probe) scene.tip_radius_nm = probe->number_or("tip_radius_nm", config::positive(), 0);
  return scene;
}

std::string hash_of(const LocalScene& scene) {
  std::string bytes;
  if (!scene.scan_path.empty()) surface::read_gsf(scene.scan_path, &bytes);
  return fmt::format("{:016x}", fnv1a(bytes, fnv1a(scene.text)));
}

// The name comes from a server: it may lead nowhere else.
bool is_plain(const std::string& name) {
  return !name.empty() && name.front() != '.' && name.find('/') == std::string::npos;
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string scan_of(const std::string& scene_path, const std::string& text) {
  const LocalScene scene = read_scene(scene_path);
  if (scene.scan_path.empty()) {
    throw UserError(
        fmt::format("--surface {}: this scene has no scan; without --surface a plane is drawn", text));
  }
  return scene.scan_path;
}

}  // namespace

std::optional<LocalScene> find_scene(const std::string& name, const std::string& hash,
                                     const std::string& also) {
  std::vector<std::string> places;
  if (!also.empty()) places.push_back(also);
  for (const std::string& stem : config::shared_names("scenes", ".toml"))
    places.push_back((config::shared_folder() / "scenes" / (stem + ".toml")).lexically_normal().string());
  if (is_plain(name)) places.push_back(name + ".toml");
  for (const std::string& place : places) {
    std::error_code failed;
    if (!fs::is_regular_file(place, failed)) continue;
    try {
      if (config::TomlDocument::load(place).root().text_or("name", "") != name) continue;
      LocalScene scene = read_scene(place);
      if (hash_of(scene) != hash) continue;
      scene.path = fs::absolute(place, failed).lexically_normal().string();
      return scene;
    } catch (const std::exception&) {  // no scene, or its scan is gone
    }
  }
  return std::nullopt;
}

std::string find_surface(const std::string& text) {
  std::error_code failed;
  const bool is_path = text.find('/') != std::string::npos || fs::exists(text, failed);
  if (is_path) return fs::path(text).extension() == ".toml" ? scan_of(text, text) : text;
  const auto scenes = config::shared_names("scenes", ".toml");
  const auto scans = config::shared_names("data", ".gsf");
  const std::string stem = fs::path(text).stem().string();
  const auto among = [](const std::string& name, const std::vector<std::string>& names) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const std::string& name : {text, stem}) {
    if (among(name, scenes) && fs::path(text).extension() != ".gsf")
      return scan_of(config::find_shared(name, "scenes", ".toml"), text);
  }
  if (among(text, scans) || (among(stem, scans) && fs::path(text).extension() == ".gsf"))
    return config::find_shared(text, "data", ".gsf");
  throw UserError(fmt::format(
      "--surface {}: no such file, and no supplied scene or scan has this name (scenes: {}; scans: {})", text,
      joined(scenes), joined(scans)));
}

std::string doubt_of_surface(const GivenSurface& given, const config::SlaveLimits& session) {
  const auto local = find_scene(session.scene_name, session.scene_hash);
  if (local) {
    if (local->scan_path.empty() && given.scan.title != session.scene_name) {
      throw UserError(fmt::format(
          "--surface {}: the session's scene '{}' has no scan; without --surface a plane is drawn",
          given.path, session.scene_name));
    }
    const std::string hash = fmt::format("{:016x}", fnv1a(given.bytes, fnv1a(local->text)));
    if (hash == session.scene_hash) return "";
  }
  if (given.scan.title == session.scene_name) return "";  // marked in a session of it, by --save-surface
  if (local) {
    const surface::Scan own = surface::read_gsf(local->scan_path);
    if (own.width_nm != given.scan.width_nm || own.height_nm != given.scan.height_nm) {
      throw UserError(
          fmt::format("--surface {}: is not the session's scan: it is {:g} x {:g} nm, and the scan of scene "
                      "'{}' is {:g} x {:g} nm; give --surface {}",
                      given.path, given.scan.width_nm, given.scan.height_nm, session.scene_name, own.width_nm,
                      own.height_nm, local->scan_path));
    }
  }
  const Vec3& low = session.workspace_min_w_nm;
  const Vec3& high = session.workspace_max_w_nm;
  constexpr double kRounding_nm = 1e-3;
  const std::array<double, 2> reach = {given.scan.width_nm, given.scan.height_nm};
  for (int axis = 0; axis < 2; ++axis) {
    if (!(high[axis] > low[axis])) continue;
    if (low[axis] >= -kRounding_nm && high[axis] <= reach[static_cast<std::size_t>(axis)] + kRounding_nm)
      continue;
    throw UserError(
        fmt::format("--surface {}: is not the session's scan: it reaches from 0 to {:g} nm along {}, and the "
                    "tip of scene '{}' from {:g} to {:g} nm; give the scan of that scene, or omit --surface",
                    given.path, reach[static_cast<std::size_t>(axis)], axis == 0 ? "x" : "y",
                    session.scene_name, low[axis], high[axis]));
  }
  if (local) return fmt::format("not the scan of '{}': heights may be wrong", session.scene_name);
  return fmt::format("unproven: is this the scan of '{}'?", session.scene_name);
}

}  // namespace telenano::app
