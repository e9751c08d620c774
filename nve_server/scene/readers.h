#pragma once

#include <memory>
#include <optional>
#include <string>

#include "telenano/common/config/toml_document.h"
#include "telenano/nve_server/scene/scene.h"

/// The sections of a scene description, one reader each. They throw UserError naming file, line, key and
/// expected range. Private to load_scene.
namespace telenano::scene {

inline const config::Range kModulus_gpa = config::between(1e-4, 2000.0);
inline const config::Range kStiffness_n_m = config::between(1e-3, 1e5);

Material read_material(const config::TomlTable& table);
/// The same with `hardness_gpa`.
Material read_sample(const config::TomlTable& table);

/// [probe]: fills scene.probe and scene.cantilever.
void read_probe(const config::TomlTable& table, Scene& scene);

/// [contact], [forces], [friction], each of which may be missing: fills scene.law_parameters and
/// scene.friction for tip and sample.
void read_forces(const config::TomlTable& root, Scene& scene);

/// [surface] and [marks]: builds scene.surface. Returns the bytes of the scan, for the hash: those of its
/// file, or `given` in place of all files.
std::string read_surface(const config::TomlDocument& document, const SceneLoading& loading, Scene& scene,
                         const std::string* given);

/// Of the law, friction and tip that are in the scene: scene.level.
void make_level(Scene& scene);

/// The level ground as fields, for a particle to lie on: scene.potential and scene.particle_ground.
void make_level_ground(Scene& scene);

/// [particle]: fills scene.particle.
void read_particle(const config::TomlTable& table, Scene& scene);

/// All of them. `scan`: null, and the scan is read from the file that the document names, or its bytes.
/// `scan_read` (may be null) gets the bytes of the scan, empty where there is none.
std::shared_ptr<const Scene> make_scene(const config::TomlDocument& document, const SceneLoading& loading,
                                        const std::string* scan = nullptr, std::string* scan_read = nullptr);

/// What load_scene reads.
config::TomlDocument load_description(const std::string& name_or_path);

/// The name of a scan that did not come from a file of this machine.
inline constexpr const char* kGivenScan = "scan.gsf";

}  // namespace telenano::scene
