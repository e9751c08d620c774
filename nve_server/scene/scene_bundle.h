#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/config/toml_document.h"
#include "telenano/nve_server/scene/scene.h"

/// A scene as one piece of bytes, to be sent, kept and built again elsewhere: what it describes as numbers,
/// the description's text for people, and its scan as the file had it. No path in it is ever opened.
///
///   bytes  content (little-endian)
///   4      "TLNB"
///   4      1, the version of this form
///   4      kPhysicsVersion of who wrote it
///   4      number of entries, 2 or 3
///   each   1 length of the name, the name, 4 length of the content, the content
///
/// Entries, in this order, each once: "scan.gsf" where the surface is a scan, "scene.toml" the text as read,
/// "values" its numbers: 4 their count, then each value by rising path: 1 kind, 1 length of the path, the
/// path ("probe.tip.poisson_ratio"), and by kind 0 a table without keys: nothing; 1 truth: 1 byte, 0 or 1;
/// 2 integer: 8; 3 number: 8, finite; 4 text: 2 length, the text without control characters. `surface.file`
/// is always "scan.gsf". Nothing follows. So the same scene has the same bytes wherever it is read.
///
/// It is not compressed: heights of real scans are noise in their lower bits (deflate takes 13 % off the two
/// that come with the project, 28 % with their bytes sorted first), and what is not packed cannot be a bomb.
namespace telenano::scene {

/// To be raised whenever the same scene moves otherwise than before. Who forgets it is found by the
/// canonical motion (slave/canonical_motion.h).
/// 2: scans, steps and gratings are one potential where the scene does not say.
/// 3: with a particle, too.
inline constexpr std::uint32_t kPhysicsVersion = 10;

/// What a reader takes. A scene within them may still ask for much memory and time when it is built.
struct BundleLimits {
  std::size_t bytes = (std::size_t{1} << 24) + (std::size_t{1} << 20);  ///< 2048 × 2048 heights and the rest
  std::size_t text_bytes = std::size_t{1} << 18;
  std::size_t values = 256;
};

struct SceneWithBundle {
  std::shared_ptr<const Scene> scene;
  std::string bundle;    ///< empty: it has none,
  std::string why_none;  ///< because of this (too large, a text with control characters)
};

/// load_scene, and the bundle of exactly what was read. Throws UserError as that does.
SceneWithBundle load_scene_with_bundle(const std::string& name_or_path, const SceneLoading& loading = {});
/// parse_scene likewise.
SceneWithBundle parse_scene_with_bundle(std::string content, const std::string& name);

/// What a bundle holds, checked for its form.
struct BundleParts {
  std::uint32_t physics_version = 0;
  std::string text;
  std::string scan;  ///< bytes of a .gsf; empty: none
  std::vector<config::TomlValue> values;
};

/// Throws UserError, one line, for whatever is not as above or beyond `limits`.
BundleParts open_bundle(std::string_view bytes, const BundleLimits& limits = {});
/// The scene, built from the numbers: no text is parsed. Throws UserError: what open_bundle() refuses,
/// another physics version, and what no scene may be. Its memory and time are those of load_scene: bounded
/// by the readers' ranges only.
std::shared_ptr<const Scene> decode_bundle(std::string_view bytes, const BundleLimits& limits = {});
/// Does the text say the same as the numbers? Parses it. Throws UserError where not.
void check_bundle_text(const BundleParts& parts);

}  // namespace telenano::scene
