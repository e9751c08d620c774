#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/physics/particle/particle_parameters.h"
#include "telenano/nve_server/physics/probe/probe.h"
#include "telenano/nve_server/physics/surface/surface.h"
#include "telenano/nve_server/scene/material.h"

namespace telenano::physics {
class PotentialEquilibrium;
class TipPotential;
}  // namespace telenano::physics

namespace telenano::scene {

class TilesAhead;

struct Probe {
  double tip_radius_nm = 20;
  Material tip;
  std::optional<double> length_nm;  ///< of the lever, where given
  std::string origin;               ///< of its stiffness: "given", "rectangular beam", "rigid"
};

struct SurfaceDescription {
  std::string kind;       ///< flat, plane, step, sphere, grating, scan
  std::string text;       ///< for a person, one line
  std::string scan_path;  ///< empty unless a scan
  std::string scan_title;
  /// FNV-1a, 64 bit, of the scan's file; 0: none, or levelled after it was read.
  std::uint64_t scan_hash = 0;
  double x_min_nm = 0, x_max_nm = 0, y_min_nm = 0, y_max_nm = 0;  ///< where the tip may go
  double spacing_nm = 0;                                          ///< of the grid; 0: none
  std::size_t fields_bytes = 0;    ///< of the potential's fields, shared by all sessions; 0: by tiles
  bool fields_from_cache = false;  ///< they were not made anew
};

/// Marks stay where the mean pressure passes the sample's hardness.
struct Marks {
  double hardness_gpa = 0;
  double pile_up = 0;  ///< what stands round a mark, of the volume displaced
};

struct Particle {
  Material material;
  double x_nm = 0;
  double y_nm = 0;
  physics::ParticleParameters parameters;
};

struct Coupling {
  double stiffness_n_m = 20;
  double damping_n_s_m = 0;
};

struct Limits {
  double force_max_nn = 0;
  double speed_max_nm_s = 0;
  double retract_speed_nm_s = 0;
  Vec3 workspace_min_w_nm = Vec3::Zero();
  Vec3 workspace_max_w_nm = Vec3::Zero();
  std::uint32_t rate_max_hz = 8000;
};

/// A scene as it runs: immutable, shared by all sessions. Only what the description asks for has been built.
struct Scene {
  std::string name;
  std::string path;
  std::uint64_t hash = 0;  ///< FNV-1a, 64 bit, over the description and the scan as read

  Material sample;
  Probe probe;
  SurfaceDescription ground;
  Coupling coupling;
  Limits limits;
  Vec3 start_apex_w_nm = Vec3::Zero();
  std::uint32_t session_timeout_ms = 500;

  physics::TipSampleParameters law_parameters;
  std::optional<double> hamaker_aj;  ///< where it is given: the equilibrium distance follows from it and w
  std::optional<physics::FrictionParameters> friction;
  std::optional<Marks> marks;
  std::optional<Particle> particle;
  physics::Probe cantilever;
  std::shared_ptr<const physics::Surface> surface;
  /// The law of the contact, and the balance on a level sample with nothing on it.
  std::shared_ptr<const physics::LevelEquilibrium> level;
  /// The balance on any other ground; null on that one.
  std::shared_ptr<const physics::PotentialEquilibrium> potential;
  std::shared_ptr<const physics::TipPotential> particle_ground;  ///< the ground to the particle; or null
  std::vector<std::shared_ptr<const TilesAhead>> tiles_ahead;    ///< of a large scan, one for each sphere
  double start_touch_w_nm = 0;  ///< height of the apex at contact under the start position

  /// Springs between the commanded end and the apex: coupling in series with the cantilever.
  physics::Compliance port_compliance_nm_nn() const;
  /// The cantilever alone, its base held: what a force–distance curve needs.
  physics::Compliance probe_compliance_nm_nn() const;
  /// Height of the apex at which tip and sample touch (overlap 0) over (x, y), as the balance has it.
  double touch_height_nm(double x_nm, double y_nm) const;
  const physics::TipSampleLaw& law() const noexcept { return level->law(); }
};

/// FieldsCache::folder_of_user().
std::string users_fields_cache();

/// How to build a scene. What takes seconds in it: the fields of a scan.
struct SceneLoading {
  /// Folder (fields_cache.h), as the environment has it; empty: fields are made anew, and not kept.
  std::string fields_cache = users_fields_cache();
  /// Hears which part of the fields is made, from 0 to 1; not called where they come from the cache.
  /// What it throws ends the loading.
  std::function<void(double part)> progress{};
};

/// Reads and checks a description (TOML) and its scan, and builds the pipeline. Throws UserError: one line
/// naming file, line, key and expected range.
std::shared_ptr<const Scene> load_scene(const std::string& name_or_path, const SceneLoading& loading = {});
/// The same from a text; `name` stands for its path.
std::shared_ptr<const Scene> parse_scene(std::string content, const std::string& name,
                                         const SceneLoading& loading = {});

}  // namespace telenano::scene
