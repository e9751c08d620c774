#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/vec3.h"
#include "nve_server/physics/probe.h"
#include "nve_server/physics/surface.h"
#include "nve_server/physics/tip_equilibrium.h"
#include "nve_server/physics/tip_sample_law.h"

namespace telenano::scene {

struct Material {
  std::string name;
  double youngs_modulus_gpa = 0;
  double poisson_ratio = 0;
  double surface_energy_j_m2 = 0;
};

struct Probe {
  double tip_radius_nm = 20;
  Material tip;
  bool rigid = false;
  double stiffness_n_m = 0;  ///< of the cantilever along W z; not used when rigid
  std::string origin;        ///< "direct", "rectangular beam", "rigid"
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
  bool van_der_waals = true;
  std::string surface_kind;  ///< "flat" or "scan"
  std::string scan_path;     ///< empty for a flat sample
  std::string scan_title;
  Coupling coupling;
  Limits limits;
  Vec3 start_apex_w_nm = Vec3::Zero();
  std::uint32_t session_timeout_ms = 500;

  physics::TipSampleParameters law_parameters;
  physics::Probe cantilever;
  std::shared_ptr<const physics::Surface> surface;
  std::shared_ptr<const physics::TipEquilibrium> equilibrium;
  double start_touch_w_nm = 0;  ///< height of the apex at contact under the start position

  /// Springs between the commanded end and the apex: coupling in series with the cantilever.
  physics::Compliance port_compliance_nm_nn() const;
  /// The cantilever alone, its base held: what a force–distance curve needs.
  physics::Compliance probe_compliance_nm_nn() const;
};

/// Reads and checks a description (TOML) and its scan, and builds the pipeline. Throws UserError: one line
/// naming file, line, key and expected range.
std::shared_ptr<const Scene> load_scene(const std::string& path);

}  // namespace telenano::scene
