#include "telenano/nve_server/scene/scene.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/fnv1a.h"
#include "telenano/common/config/shared_files.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/scene/readers.h"

namespace telenano::scene {

using config::between;
using config::positive;
using config::TomlTable;

Material read_material(const TomlTable& table) {
  Material material;
  material.name = table.text_or("name", "");
  material.youngs_modulus_gpa = table.number("youngs_modulus_gpa", kModulus_gpa);
  material.poisson_ratio = table.number("poisson_ratio", {-1.0, 0.5, true, false});
  material.surface_energy_j_m2 = table.number("surface_energy_j_m2", between(1e-5, 10.0));
  return material;
}

Material read_sample(const TomlTable& table) {
  Material sample = read_material(table);
  sample.hardness_gpa = table.number_or("hardness_gpa", between(1e-4, 1000.0), 0.0);
  return sample;
}

void make_level(Scene& scene) {
  const double radius = scene.probe.tip_radius_nm;
  scene.level = std::make_shared<physics::LevelEquilibrium>(
      std::make_shared<physics::TipSampleLaw>(scene.law_parameters, radius), radius, scene.friction);
}

namespace {

// What a Welcome can carry, with a closing zero.
constexpr std::size_t kNameBytesMax = 47;

void read_limits(const TomlTable& table, Scene& scene) {
  Limits& limits = scene.limits;
  limits.force_max_nn = table.number("force_max_nn", positive(1e6));
  // A tip that may not bear its own adhesion could never let go.
  const double adhesion = scene.law().attraction_bound_nn(scene.probe.tip_radius_nm);
  if (!(limits.force_max_nn > adhesion)) {
    std::ostringstream text;
    text << "is " << limits.force_max_nn << ", expected more than the attraction of this tip, " << adhesion
         << " nN";
    table.fail("force_max_nn", text.str());
  }
  limits.speed_max_nm_s = table.number_or("speed_max_nm_s", between(1.0, 1e7), 1e5);
  limits.retract_speed_nm_s = table.number_or("retract_speed_nm_s", between(1.0, 1e6), 1000.0);
  limits.rate_max_hz = static_cast<std::uint32_t>(table.integer_or("rate_max_hz", 10, 100000, 8000));
  const double top = table.number_or("top_nm", between(1.0, 1e5), 100.0);
  const double depth = table.number_or("depth_nm", between(0.0, 1e4), 50.0);
  limits.workspace_min_w_nm =
      Vec3(scene.ground.x_min_nm, scene.ground.y_min_nm, scene.surface->lowest_nm() - depth);
  limits.workspace_max_w_nm =
      Vec3(scene.ground.x_max_nm, scene.ground.y_max_nm, scene.surface->highest_nm() + top);
}

void read_start(const TomlTable& table, Scene& scene) {
  const Limits& limits = scene.limits;
  const double x =
      table.number("x_nm", between(limits.workspace_min_w_nm.x(), limits.workspace_max_w_nm.x()));
  const double y =
      table.number("y_nm", between(limits.workspace_min_w_nm.y(), limits.workspace_max_w_nm.y()));
  scene.start_touch_w_nm = scene.touch_height_nm(x, y);
  const double room = limits.workspace_max_w_nm.z() - scene.start_touch_w_nm;
  const double height = table.number("height_nm", {0.5, room, false, false});
  scene.start_apex_w_nm = Vec3(x, y, scene.start_touch_w_nm + height);
}

}  // namespace

std::shared_ptr<const Scene> make_scene(const config::TomlDocument& document, const SceneLoading& loading,
                                        const std::string* scan, std::string* scan_read) {
  const TomlTable root = document.root();
  auto scene = std::make_shared<Scene>();
  scene->path = document.path();
  scene->name = root.text("name");
  if (scene->name.empty() || scene->name.size() > kNameBytesMax) {
    root.fail("name", "expected 1 to " + std::to_string(kNameBytesMax) + " bytes");
  }
  scene->sample = read_sample(root.table("sample"));
  read_probe(root.table("probe"), *scene);
  read_forces(root, *scene);
  const TomlTable coupling = root.table("coupling");
  scene->coupling.stiffness_n_m = coupling.number("stiffness_n_m", kStiffness_n_m);
  scene->coupling.damping_n_s_m = coupling.number_or("damping_n_s_m", between(0.0, 1e3), 0.0);

  if (const auto particle = root.optional_table("particle")) read_particle(*particle, *scene);
  std::string scan_bytes = read_surface(document, loading, *scene, scan);
  make_level(*scene);
  read_limits(root.table("limits"), *scene);
  read_start(root.table("start"), *scene);
  if (const auto session = root.optional_table("session")) {
    scene->session_timeout_ms = static_cast<std::uint32_t>(session->integer_or("timeout_ms", 50, 60000, 500));
  }
  document.finish();
  scene->hash = fnv1a(scan_bytes, fnv1a(document.content()));
  if (scan_read != nullptr) *scan_read = std::move(scan_bytes);
  return scene;
}

config::TomlDocument load_description(const std::string& name_or_path) {
  return config::TomlDocument::load(config::find_shared(name_or_path, "scenes", ".toml"));
}

physics::Compliance Scene::port_compliance_nm_nn() const {
  return Mat3::Identity() / coupling.stiffness_n_m + probe_compliance_nm_nn();
}

physics::Compliance Scene::probe_compliance_nm_nn() const {
  return cantilever.compliance_nm_nn();
}

double Scene::touch_height_nm(double x_nm, double y_nm) const {
  if (!potential) return 0.0;
  return potential->touch_height_nm(x_nm, y_nm, surface->highest_nm() + 2.0 * probe.tip_radius_nm);
}

std::shared_ptr<const Scene> load_scene(const std::string& name_or_path, const SceneLoading& loading) {
  return make_scene(load_description(name_or_path), loading);
}

std::shared_ptr<const Scene> parse_scene(std::string content, const std::string& name,
                                         const SceneLoading& loading) {
  return make_scene(config::TomlDocument::parse(std::move(content), name), loading);
}

}  // namespace telenano::scene
