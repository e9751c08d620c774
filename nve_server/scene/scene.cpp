#include "nve_server/scene/scene.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "common/base/constants.h"
#include "common/base/error.h"
#include "common/config/toml_document.h"
#include "nve_server/physics/flat_surface.h"
#include "nve_server/physics/spline_surface.h"
#include "nve_server/scene/fnv1a.h"
#include "nve_server/scene/gsf.h"

namespace telenano::scene {
namespace {

// What a Welcome can carry, with a closing zero.
constexpr std::size_t kNameBytesMax = 47;

using config::between;
using config::positive;
using config::Range;
using config::TomlTable;

const Range kModulus_gpa = between(1e-4, 2000.0);
const Range kStiffness_n_m = between(1e-3, 1e5);

Material read_material(const TomlTable& table) {
  Material material;
  material.name = table.text_or("name", "");
  material.youngs_modulus_gpa = table.number("youngs_modulus_gpa", kModulus_gpa);
  material.poisson_ratio = table.number("poisson_ratio", {-1.0, 0.5, true, false});
  material.surface_energy_j_m2 = table.number("surface_energy_j_m2", between(1e-5, 10.0));
  return material;
}

// Exactly one of: rigid = true, stiffness_n_m, [probe.beam].
Probe read_probe(const TomlTable& table) {
  Probe probe;
  probe.tip_radius_nm = table.number("tip_radius_nm", between(1.0, 1e4));
  probe.tip = read_material(table.table("tip"));
  probe.rigid = table.boolean_or("rigid", false);
  const auto stiffness = table.optional_number("stiffness_n_m", kStiffness_n_m);
  const auto beam = table.optional_table("beam");
  const int given = (probe.rigid ? 1 : 0) + (stiffness ? 1 : 0) + (beam ? 1 : 0);
  if (given != 1) {
    table.fail("stiffness_n_m", given == 0
                                    ? "missing; expected one of stiffness_n_m, [probe.beam] or rigid = true"
                                    : "give only one of stiffness_n_m, [probe.beam] and rigid = true");
  }
  if (probe.rigid) {
    probe.origin = "rigid";
  } else if (stiffness) {
    probe.origin = "given";
    probe.stiffness_n_m = *stiffness;
  } else {
    // k_z = E b t³ / (4 L³): GPa·µm = 1e3 N/m.
    const double modulus_gpa = beam->number("youngs_modulus_gpa", kModulus_gpa);
    const double width_um = beam->number("width_um", between(0.01, 1e4));
    const double thickness_um = beam->number("thickness_um", between(0.01, 1e3));
    const double length_um = beam->number("length_um", between(0.1, 1e4));
    const double slenderness = thickness_um / length_um;
    probe.origin = "rectangular beam";
    probe.stiffness_n_m = 1e3 * modulus_gpa * width_um * slenderness * slenderness * slenderness / 4.0;
    if (!kStiffness_n_m.contains(probe.stiffness_n_m)) {
      std::ostringstream text;
      text << "gives a stiffness of " << probe.stiffness_n_m << " N/m, expected one "
           << kStiffness_n_m.text();
      table.fail("beam", text.str());
    }
  }
  return probe;
}

physics::ProbeParameters cantilever_parameters(const Probe& probe) {
  physics::ProbeParameters parameters;
  parameters.rigid = probe.rigid;
  if (!probe.rigid) parameters.stiffness_n_m = probe.stiffness_n_m;
  return parameters;
}

physics::TipSampleParameters law_parameters(const Scene& scene) {
  const auto compliance = [](const Material& m) {
    return (1.0 - m.poisson_ratio * m.poisson_ratio) / m.youngs_modulus_gpa;
  };
  physics::TipSampleParameters parameters;
  parameters.contact_modulus_gpa = 4.0 / 3.0 / (compliance(scene.sample) + compliance(scene.probe.tip));
  parameters.work_of_adhesion_n_m =
      2.0 * std::sqrt(scene.sample.surface_energy_j_m2 * scene.probe.tip.surface_energy_j_m2);
  parameters.van_der_waals = scene.van_der_waals;
  return parameters;
}

struct Plane {
  double x_min, x_max, y_min, y_max;
};

// Where the tip may go sideways. A scan keeps a margin from its rim, beyond which nothing was measured.
Plane build_surface(const config::TomlDocument& document, const TomlTable& limits, Scene& scene,
                    std::string& scan_bytes) {
  const TomlTable table = document.root().table("surface");
  scene.surface_kind = table.choice("kind", {"flat", "scan"});
  if (scene.surface_kind == "flat") {
    scene.surface = std::make_shared<physics::FlatSurface>(scene.probe.tip_radius_nm);
    const double half_width = limits.number_or("half_width_nm", between(1.0, 1e6), 500.0);
    return {-half_width, half_width, -half_width, half_width};
  }
  const std::string file = table.text("file");
  if (file.empty()) table.fail("file", "is empty, expected a .gsf scan");
  scene.scan_path = document.resolve(file);
  const Scan scan = read_gsf(scene.scan_path, &scan_bytes);
  scene.scan_title = scan.title;
  auto surface = std::make_shared<physics::SplineSurface>(scan.grid, scene.probe.tip_radius_nm);
  scene.surface = surface;
  const double half_extent = 0.5 * std::min(surface->x_last_nm() - surface->x_first_nm(),
                                            surface->y_last_nm() - surface->y_first_nm());
  const double margin = limits.number_or("margin_nm", {0.0, half_extent, false, true}, 0.1 * half_extent);
  return {surface->x_first_nm() + margin, surface->x_last_nm() - margin, surface->y_first_nm() + margin,
          surface->y_last_nm() - margin};
}

void read_limits(const TomlTable& table, const Plane& plane, Scene& scene) {
  Limits& limits = scene.limits;
  limits.force_max_nn = table.number("force_max_nn", positive(1e6));
  // A tip that may not bear its own adhesion could never let go. 2πwR bounds the pull-off of every theory
  // (DMT).
  const double adhesion = 2.0 * kPi * scene.law_parameters.work_of_adhesion_n_m * scene.probe.tip_radius_nm;
  if (!(limits.force_max_nn > adhesion)) {
    std::ostringstream text;
    text << "is " << limits.force_max_nn << ", expected more than the adhesion of this tip, " << adhesion
         << " nN";
    table.fail("force_max_nn", text.str());
  }
  limits.speed_max_nm_s = table.number_or("speed_max_nm_s", between(1.0, 1e7), 1e5);
  limits.retract_speed_nm_s = table.number_or("retract_speed_nm_s", between(1.0, 1e6), 1000.0);
  limits.rate_max_hz = static_cast<std::uint32_t>(table.integer_or("rate_max_hz", 10, 100000, 8000));
  const double top = table.number_or("top_nm", between(1.0, 1e5), 100.0);
  const double depth = table.number_or("depth_nm", between(0.0, 1e4), 50.0);
  limits.workspace_min_w_nm = Vec3(plane.x_min, plane.y_min, scene.surface->lowest_nm() - depth);
  limits.workspace_max_w_nm = Vec3(plane.x_max, plane.y_max, scene.surface->highest_nm() + top);
}

void read_start(const TomlTable& table, Scene& scene) {
  const Limits& limits = scene.limits;
  const double x =
      table.number("x_nm", between(limits.workspace_min_w_nm.x(), limits.workspace_max_w_nm.x()));
  const double y =
      table.number("y_nm", between(limits.workspace_min_w_nm.y(), limits.workspace_max_w_nm.y()));
  scene.start_touch_w_nm = scene.equilibrium->touch_height_nm(x, y);
  const double room = limits.workspace_max_w_nm.z() - scene.start_touch_w_nm;
  const double height = table.number("height_nm", {0.5, room, false, false});
  scene.start_apex_w_nm = Vec3(x, y, scene.start_touch_w_nm + height);
}

}  // namespace

physics::Compliance Scene::port_compliance_nm_nn() const {
  return Mat3::Identity() / coupling.stiffness_n_m + probe_compliance_nm_nn();
}

physics::Compliance Scene::probe_compliance_nm_nn() const {
  return cantilever.compliance_nm_nn();
}

std::shared_ptr<const Scene> load_scene(const std::string& path) {
  const config::TomlDocument document = config::TomlDocument::load(path);
  const TomlTable root = document.root();
  auto scene = std::make_shared<Scene>();
  scene->path = path;
  scene->name = root.text("name");
  if (scene->name.empty() || scene->name.size() > kNameBytesMax) {
    root.fail("name", "expected 1 to " + std::to_string(kNameBytesMax) + " bytes");
  }
  scene->sample = read_material(root.table("sample"));
  scene->probe = read_probe(root.table("probe"));
  scene->cantilever = physics::Probe(cantilever_parameters(scene->probe));
  if (const auto forces = root.optional_table("forces")) {
    scene->van_der_waals = forces->boolean_or("van_der_waals", true);
  }
  scene->law_parameters = law_parameters(*scene);

  const TomlTable coupling = root.table("coupling");
  scene->coupling.stiffness_n_m = coupling.number("stiffness_n_m", kStiffness_n_m);
  scene->coupling.damping_n_s_m = coupling.number_or("damping_n_s_m", between(0.0, 1e3), 0.0);

  const TomlTable limits = root.table("limits");
  std::string scan_bytes;
  const Plane plane = build_surface(document, limits, *scene, scan_bytes);
  scene->equilibrium = std::make_shared<physics::TipEquilibrium>(
      scene->surface, physics::TipSampleLaw(scene->law_parameters), scene->probe.tip_radius_nm);
  read_limits(limits, plane, *scene);
  read_start(root.table("start"), *scene);
  if (const auto session = root.optional_table("session")) {
    scene->session_timeout_ms = static_cast<std::uint32_t>(session->integer_or("timeout_ms", 50, 60000, 500));
  }
  document.finish();
  scene->hash = fnv1a(scan_bytes, fnv1a(document.content()));
  return scene;
}

}  // namespace telenano::scene
