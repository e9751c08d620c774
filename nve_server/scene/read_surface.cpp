#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>
#include <utility>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/fnv1a.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/potential/retraction.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/physics/surface/plane_surface.h"
#include "telenano/nve_server/physics/surface/sampled_shapes.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/shape_fields.h"
#include "telenano/nve_server/physics/surface/softening.h"
#include "telenano/nve_server/physics/surface/sphere_surface.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "telenano/nve_server/scene/fields_cache.h"
#include "telenano/nve_server/scene/levelling.h"
#include "telenano/nve_server/scene/readers.h"
#include "telenano/nve_server/scene/tiles_ahead.h"

namespace telenano::scene {
namespace {

using config::between;
using config::TomlTable;
using physics::HeightGrid;

constexpr double kRadPerDeg = kPi / 180.0;
constexpr double kPileUp = 1.0;  // flow keeps the volume

/// What touches the ground: the tip, or the particle that lies on it.
struct Sphere {
  double radius_nm = 0;
  const physics::TipSampleParameters* law = nullptr;
};

std::vector<Sphere> spheres_of(const Scene& scene) {
  std::vector<Sphere> spheres = {{scene.probe.tip_radius_nm, &scene.law_parameters}};
  if (scene.particle) {
    const physics::ParticleParameters& p = scene.particle->parameters;
    spheres.push_back({p.particle_radius_nm, &p.particle_sample});
  }
  return spheres;
}

physics::SofteningRule softening_of(const Sphere& sphere) {
  const physics::TipSampleParameters& p = *sphere.law;
  return physics::softening_rule(sphere.radius_nm, p.work_of_adhesion_n_m, 0.75 * p.contact_modulus_gpa,
                                 p.equilibrium_distance_nm);
}

/// What a surface is made of until it is known whether it has to be a grid.
struct Built {
  std::shared_ptr<const physics::Surface> exact;  ///< in closed form
  HeightGrid grid;                                ///< else
  double half_width_nm = 0;                       ///< of an unbounded shape
  /// Of the closed form.
  std::function<std::shared_ptr<const physics::ContactFields>(const Sphere&)> fields;
};

physics::SampledArea area_around_origin(double half_width, double spacing) {
  return {-half_width, -half_width, 2.0 * half_width, 2.0 * half_width, spacing};
}

HeightGrid sampled(const physics::Surface& surface, const physics::SampledArea& area) {
  HeightGrid grid = physics::sample_level(area, 0.0);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      grid.z_nm[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                static_cast<std::size_t>(column)] =
          surface.height_nm(grid.x_first_nm + column * grid.dx_nm, grid.y_first_nm + row * grid.dy_nm);
    }
  }
  return grid;
}

template <class... Values>
std::string words(const Values&... values) {
  std::ostringstream text;
  (text << ... << values);
  return text.str();
}

// A mistake that only the shape itself can see (an edge finer than the grid) gets the file and the section.
template <class Make>
auto within(const TomlTable& table, const Make& make) {
  try {
    return make();
  } catch (const UserError& error) {
    table.fail("kind", error.what());
  }
}

Built read_plane(const TomlTable& table, double half_width, SurfaceDescription& ground) {
  physics::PlaneSurface::Shape shape;
  const auto slope = between(-physics::PlaneSurface::kMaxSlope, physics::PlaneSurface::kMaxSlope);
  shape.slope_x = table.number_or("slope_x", slope, 0.0);
  shape.slope_y = table.number_or("slope_y", slope, 0.0);
  shape.extent_nm = half_width;
  ground.text = words("plane of slopes ", shape.slope_x, " and ", shape.slope_y);
  return {std::make_shared<physics::PlaneSurface>(shape), {}, half_width, [shape](const Sphere& on_it) {
            return std::make_shared<physics::PlaneFields>(shape, on_it.radius_nm);
          }};
}

Built read_sphere(const TomlTable& table, double half_width, SurfaceDescription& ground) {
  physics::SphereSurface::Shape shape;
  shape.radius_nm = table.number("radius_nm", between(1.0, 1e5));
  shape.x_nm = table.number_or("x_nm", between(-half_width, half_width), 0.0);
  shape.y_nm = table.number_or("y_nm", between(-half_width, half_width), 0.0);
  shape.height_nm = table.number_or("height_nm", config::positive(shape.radius_nm), shape.radius_nm);
  ground.text =
      words("sphere of radius ", shape.radius_nm, " nm that rises ", shape.height_nm, " nm from a plate");
  return {within(table, [&] { return std::make_shared<physics::SphereSurface>(shape); }),
          {},
          half_width,
          [shape, table](const Sphere& on_it) {
            return within(table, [&] {
              return std::make_shared<physics::SphereFields>(shape, on_it.radius_nm, softening_of(on_it));
            });
          }};
}

Built read_step(const TomlTable& table, const physics::SampledArea& area, SurfaceDescription& ground) {
  physics::StepShape shape;
  shape.height_nm = table.number("height_nm", between(-1e4, 1e4));
  shape.width_nm = table.number_or("edge_nm", between(0.1, 1e4), std::max(4.0, 8.0 * area.spacing_nm));
  shape.direction_rad = kRadPerDeg * table.number_or("direction_deg", between(-360.0, 360.0), 0.0);
  shape.x_nm = table.number_or("x_nm", between(-1e6, 1e6), 0.0);
  shape.y_nm = table.number_or("y_nm", between(-1e6, 1e6), 0.0);
  ground.text = words("step of ", shape.height_nm, " nm over an edge of ", shape.width_nm, " nm");
  return {nullptr, within(table, [&] { return physics::sample_step(area, shape); }), 0.0, nullptr};
}

Built read_grating(const TomlTable& table, const physics::SampledArea& area, SurfaceDescription& ground) {
  physics::GratingShape shape;
  const std::string profile = table.choice_or("profile", {"sinusoid", "trapezoid"}, "sinusoid");
  shape.profile =
      profile == "sinusoid" ? physics::GratingProfile::kSinusoid : physics::GratingProfile::kTrapezoid;
  shape.height_nm = table.number("height_nm", between(1e-3, 1e4));
  shape.period_nm = table.number("period_nm", between(1.0, 1e5));
  if (shape.profile == physics::GratingProfile::kTrapezoid) {
    shape.edge_nm = table.number_or("edge_nm", between(0.1, 0.5 * shape.period_nm), 0.2 * shape.period_nm);
  }
  shape.direction_rad = kRadPerDeg * table.number_or("direction_deg", between(-360.0, 360.0), 0.0);
  shape.x_nm = table.number_or("x_nm", between(-1e6, 1e6), 0.0);
  shape.y_nm = table.number_or("y_nm", between(-1e6, 1e6), 0.0);
  ground.text = words(profile, " grating of ", shape.height_nm, " nm every ", shape.period_nm, " nm");
  return {nullptr, within(table, [&] { return physics::sample_grating(area, shape); }), 0.0, nullptr};
}

Built read_scan(const config::TomlDocument& document, const TomlTable& table, SurfaceDescription& ground,
                const std::string* given, std::string& bytes) {
  const std::string file = table.text("file");
  if (file.empty()) table.fail("file", "is empty, expected a .gsf scan");
  surface::Scan scan;
  if (given != nullptr) {
    if (file != kGivenScan) table.fail("file", std::string("expected ") + kGivenScan);
    ground.scan_path = kGivenScan;
    scan = surface::parse_gsf(*given, document.path() + ": " + kGivenScan);
    bytes = *given;
  } else {
    ground.scan_path = document.resolve(file);
    scan = surface::read_gsf(ground.scan_path, &bytes);
  }
  ground.scan_title = scan.title;
  const std::string levelling = table.choice_or("level", {"none", "plane", "lines"}, "none");
  level(scan.grid, *levelling_from_name(levelling));
  if (levelling == "none") ground.scan_hash = fnv1a(bytes);
  ground.text = ground.scan_path + (levelling == "none" ? "" : ", levelled by " + levelling);
  return {nullptr, std::move(scan.grid), 0.0, nullptr};
}

// A grid keeps a margin from its rim, beyond which nothing was measured.
void keep_inside(const physics::SplineSurface& surface, const TomlTable& limits, SurfaceDescription& ground) {
  const double half_extent =
      0.5 * std::min(surface.x_last_nm() - surface.x_first_nm(), surface.y_last_nm() - surface.y_first_nm());
  const double margin = limits.number_or("margin_nm", {0.0, half_extent, false, true}, 0.1 * half_extent);
  ground.x_min_nm = surface.x_first_nm() + margin;
  ground.x_max_nm = surface.x_last_nm() - margin;
  ground.y_min_nm = surface.y_first_nm() + margin;
  ground.y_max_nm = surface.y_last_nm() - margin;
}

std::shared_ptr<const physics::BranchPotential> law_of(const Sphere& sphere) {
  return std::make_shared<physics::BranchPotential>(physics::TipSampleLaw(*sphere.law, sphere.radius_nm),
                                                    sphere.radius_nm);
}

/// `make`(sphere, law): the fields of the ground for it.
template <class Make>
void make_potential(Scene& scene, const Make& make) {
  const std::vector<Sphere> spheres = spheres_of(scene);
  const auto tip_law = law_of(spheres[0]);
  scene.potential =
      std::make_shared<physics::PotentialEquilibrium>(make(spheres[0], *tip_law), tip_law, scene.friction);
  if (!scene.particle) return;
  const auto law = law_of(spheres[1]);
  scene.particle_ground = std::make_shared<physics::TipPotential>(make(spheres[1], *law), law);
}

/// From the cache, or made and kept there; of a large scan by tiles, which the cache is not asked for.
class FieldsOfGrid {
 public:
  FieldsOfGrid(const HeightGrid& grid, std::shared_ptr<const physics::SplineSurface> surface,
               const SceneLoading& loading, Scene& scene)
      : grid_(grid),
        surface_(std::move(surface)),
        loading_(loading),
        scene_(scene),
        ground_(scene.ground),
        sets_(scene.particle ? 2 : 1) {
    ground_.fields_from_cache = !loading.fields_cache.empty();
  }

  std::shared_ptr<const physics::ContactFields> operator()(const Sphere& sphere,
                                                           const physics::BranchPotential& law) {
    std::vector<double> fixed_nm;
    if (law.bridge().active()) fixed_nm.push_back(law.bridge().softening_nm());
    const physics::SofteningRule rule = softening_of(sphere);
    const auto pull_off =
        std::make_shared<const physics::RetractionKernel>(physics::retraction_kernel(law, sphere.radius_nm));
    if (physics::ScanFields::is_large(grid_, sphere.radius_nm, rule)) {
      ground_.fields_from_cache = false;
      auto tiles = std::make_shared<physics::ScanFields>(physics::ScanFields::by_tiles(
          grid_, {surface_, &surface_->spline()}, sphere.radius_nm, rule, fixed_nm, pull_off));
      scene_.tiles_ahead.push_back(std::make_shared<TilesAhead>(tiles));
      return tiles;
    }
    auto fields = std::make_shared<physics::ScanFields>(made(sphere.radius_nm, rule, fixed_nm, pull_off));
    ground_.fields_bytes += fields->bytes();
    done_ += 1.0;
    return fields;
  }

 private:
  physics::ScanFields made(double radius, const physics::SofteningRule& rule,
                           const std::vector<double>& fixed_nm,
                           const std::shared_ptr<const physics::RetractionKernel>& pull_off) {
    std::function<void(double)> progress;
    if (loading_.progress) progress = [this](double part) { loading_.progress((done_ + part) / sets_); };
    if (loading_.fields_cache.empty())
      return physics::ScanFields(grid_, radius, rule, fixed_nm, progress, pull_off);
    const FieldsCache cache(loading_.fields_cache);
    if (auto kept = cache.find(grid_, radius, rule, fixed_nm, pull_off.get())) return std::move(*kept);
    ground_.fields_from_cache = false;
    physics::ScanFields fields(grid_, radius, rule, fixed_nm, progress, pull_off);
    cache.keep(grid_, radius, rule, fixed_nm, fields, pull_off.get());
    return fields;
  }

  const HeightGrid& grid_;
  std::shared_ptr<const physics::SplineSurface> surface_;  // its spline is what is dilated
  const SceneLoading& loading_;
  Scene& scene_;
  SurfaceDescription& ground_;
  double sets_;
  double done_ = 0;
};

}  // namespace

void make_level_ground(Scene& scene) {
  make_potential(scene, [](const Sphere& sphere, const auto&) {
    return std::make_shared<physics::PlaneFields>(physics::PlaneSurface::Shape{}, sphere.radius_nm);
  });
}

// A wider tip touches beyond the rim, where nothing is known, and its fields are many times as wide as the
// grid: a tip of 500 nm on a scan of 0.2 nm took all memory.
void check_fits(const TomlTable& table, const char* key, const HeightGrid& grid, double radius_nm) {
  constexpr double kMostSides = 4;
  const double side = std::min((grid.columns - 1) * grid.dx_nm, (grid.rows - 1) * grid.dy_nm);
  if (radius_nm <= kMostSides * side) return;
  table.fail(key, words(radius_nm, " nm is too wide for a surface of ", side,
                        " nm: expected at most four times its shorter side"));
}

std::string read_surface(const config::TomlDocument& document, const SceneLoading& loading, Scene& scene,
                         const std::string* given) {
  const TomlTable root = document.root();
  const TomlTable table = root.table("surface");
  const TomlTable limits = root.table("limits");
  SurfaceDescription& ground = scene.ground;
  ground.kind = table.choice("kind", {"flat", "plane", "step", "sphere", "grating", "scan"});
  const double tip_radius = scene.probe.tip_radius_nm;
  const bool scan = ground.kind == "scan";
  const bool sampled_shape = ground.kind == "step" || ground.kind == "grating";

  const auto marks = root.optional_table("marks");
  const bool yields = scene.sample.hardness_gpa > 0;
  if (marks && !yields) marks->fail("spacing_nm", "marks need [sample] hardness_gpa");
  // Scenes from before say how the ground acts on the tip; there is one way now.
  if (table.text_or("force", "potential") != "potential") {
    table.fail("force", "the nearest point (\"foot\") was removed: the ground is one potential; omit it");
  }
  if (table.has("radius_force")) {
    table.fail("radius_force", "is now part of the potential; omit it");
  }
  if (yields) {
    scene.marks = Marks{scene.sample.hardness_gpa, kPileUp};
    if (marks) scene.marks->pile_up = marks->number_or("pile_up", between(0.0, 1.0), kPileUp);
  }

  // The patch of an unbounded shape, and how finely it is kept where it has to be a grid.
  double half_width = 0;
  double spacing = 0;
  if (!scan) {
    half_width =
        limits.number_or("half_width_nm", between(1.0, 1e6), yields || sampled_shape ? 150.0 : 500.0);
    if (sampled_shape || yields) {
      const TomlTable& where = marks ? *marks : table;
      spacing = where.number_or("spacing_nm", between(0.05, 1e3), std::min(1.0, tip_radius / 8.0));
    }
  }
  const physics::SampledArea area = area_around_origin(half_width, spacing);

  std::string bytes;
  Built built;
  if (ground.kind == "flat") {
    ground.text = "the plane z = 0";
    built = {std::make_shared<physics::FlatSurface>(), {}, half_width, [](const Sphere& sphere) {
               return std::make_shared<physics::PlaneFields>(physics::PlaneSurface::Shape{},
                                                             sphere.radius_nm);
             }};
  } else if (ground.kind == "plane") {
    built = read_plane(table, half_width, ground);
  } else if (ground.kind == "sphere") {
    built = read_sphere(table, half_width, ground);
  } else if (ground.kind == "step") {
    built = read_step(table, area, ground);
  } else if (ground.kind == "grating") {
    built = read_grating(table, area, ground);
  } else {
    built = read_scan(document, table, ground, given, bytes);
  }

  if (built.exact && !yields) {
    scene.surface = built.exact;
    ground.x_min_nm = ground.y_min_nm = -half_width;
    ground.x_max_nm = ground.y_max_nm = half_width;
    if (!built.exact->is_flat() || scene.particle) {
      make_potential(scene, [&](const Sphere& sphere, const auto&) { return built.fields(sphere); });
    }
  } else {
    if (built.exact) built.grid = within(table, [&] { return sampled(*built.exact, area); });
    ground.spacing_nm = std::max(built.grid.dx_nm, built.grid.dy_nm);
    // What marks may change is carried over whole; the largest scans would need gigabytes in each session.
    constexpr std::size_t kMostMarked = std::size_t{2048} * 2048;
    if (yields && built.grid.z_nm.size() > kMostMarked) {
      table.fail("kind", words("has ", built.grid.columns, " x ", built.grid.rows,
                               " heights, expected at most 2048 x 2048 of a sample that keeps marks "
                               "([sample] hardness_gpa)"));
    }
    check_fits(root.table("probe"), "tip_radius_nm", built.grid, tip_radius);
    if (scene.particle) {
      check_fits(root.table("particle"), "radius_nm", built.grid,
                 scene.particle->parameters.particle_radius_nm);
    }
    const auto surface = std::make_shared<physics::SplineSurface>(built.grid);
    FieldsOfGrid fields(built.grid, surface, loading, scene);
    make_potential(scene, [&](const Sphere& sphere, const auto& law) { return fields(sphere, law); });
    keep_inside(*surface, limits, ground);
    scene.surface = surface;
  }
  if (scene.ground.spacing_nm > 0 || !scene.surface->is_flat()) {
    ground.text +=
        words(", heights ", scene.surface->lowest_nm(), " to ", scene.surface->highest_nm(), " nm");
  }
  return bytes;
}

}  // namespace telenano::scene
