#include "telenano/master/scene/scene_check.h"

#include <cmath>
#include <string_view>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/packed.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/scene/levelling.h"
#include "telenano/nve_server/scene/scene_bundle.h"
#include "telenano/nve_server/slave/canonical_motion.h"

namespace telenano::scene_store {
namespace {

constexpr const char* kSubject = "scene bundle";
constexpr int kSampledSide = 257;

/// The heights of its scan; none: it has none.
surface::HeightGrid scan_of(const scene::BundleParts& parts) {
  surface::HeightGrid grid;
  if (parts.scan.empty()) return grid;
  grid = surface::parse_gsf(parts.scan, kSubject).grid;
  for (const config::TomlValue& value : parts.values) {
    if (value.path != "surface.level") continue;
    const auto* const name = std::get_if<std::string>(&value.value);
    if (name != nullptr)
      scene::level(grid, scene::levelling_from_name(*name).value_or(scene::Levelling::kNone));
  }
  return grid;
}

/// As the description has it; 0: it has none. That it is a radius is for the reader to see.
double tip_radius_of(const scene::BundleParts& parts) {
  for (const config::TomlValue& value : parts.values) {
    if (value.path != "probe.tip_radius_nm") continue;
    if (const auto* const whole = std::get_if<std::int64_t>(&value.value)) return static_cast<double>(*whole);
    if (const auto* const number = std::get_if<double>(&value.value)) return *number;
  }
  return 0;
}

/// Heights for the picture: those of the scan, or of the shape at even places over where the tip may go.
surface::HeightGrid ground_of_scene(const scene::Scene& scene, const scene::BundleParts& parts) {
  surface::HeightGrid grid = scan_of(parts);
  if (!parts.scan.empty()) return grid;
  if (scene.surface->is_flat()) return grid;
  grid.columns = grid.rows = kSampledSide;
  grid.x_first_nm = scene.ground.x_min_nm;
  grid.y_first_nm = scene.ground.y_min_nm;
  grid.dx_nm = (scene.ground.x_max_nm - scene.ground.x_min_nm) / (kSampledSide - 1);
  grid.dy_nm = (scene.ground.y_max_nm - scene.ground.y_min_nm) / (kSampledSide - 1);
  for (int row = 0; row < grid.rows; ++row)
    for (int column = 0; column < grid.columns; ++column)
      grid.z_nm.push_back(scene.surface->height_nm(grid.x_first_nm + column * grid.dx_nm,
                                                   grid.y_first_nm + row * grid.dy_nm));
  return grid;
}

void pack(recording::Packer& packed, const surface::HeightGrid& ground) {
  packed.put(ground.columns).put(ground.rows).put(ground.dx_nm).put(ground.dy_nm);
  packed.put(ground.x_first_nm).put(ground.y_first_nm);
  packed.raw(ground.z_nm.data(), ground.z_nm.size() * sizeof(double));
}

/// 'G' and a bundle: its scan. 'S' and a bundle: all that there is to find.
std::string answer(std::string_view request) {
  const std::string_view bundle = request.substr(1);
  const scene::BundleParts parts = scene::open_bundle(bundle);
  if (request.front() == 'G') {
    recording::Packer packed;
    packed.put(tip_radius_of(parts));
    pack(packed, scan_of(parts));
    return packed.take();
  }
  const auto scene = scene::decode_bundle(bundle);
  scene::check_bundle_text(parts);
  const surface::HeightGrid ground = ground_of_scene(*scene, parts);
  recording::Packer packed;
  packed.text(scene->name).text(parts.text).put(scene->hash).put(slave::canonical_motion_hash(scene));
  packed.put(scene->probe.tip_radius_nm);
  pack(packed, ground);
  return packed.take();
}

/// Throws RunError, one line, for what nobody can draw.
void unpack(recording::Unpacker& from, surface::HeightGrid& grid) {
  grid.columns = from.get<int>();
  grid.rows = from.get<int>();
  grid.dx_nm = from.get<double>();
  grid.dy_nm = from.get<double>();
  grid.x_first_nm = from.get<double>();
  grid.y_first_nm = from.get<double>();
  const auto side = [](int n) { return n >= 2 && n <= SceneChecker::kGroundMax; };
  const bool flat = grid.columns == 0 && grid.rows == 0;
  bool good = flat || (side(grid.columns) && side(grid.rows) && grid.dx_nm > 0 && grid.dy_nm > 0 &&
                       std::isfinite(grid.dx_nm + grid.dy_nm + grid.x_first_nm + grid.y_first_nm));
  const std::size_t count =
      good ? static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows) : 0;
  good = good && from.left() == count * sizeof(double);
  if (good && count > 0) {
    grid.z_nm.resize(count);
    std::memcpy(grid.z_nm.data(), from.raw(count * sizeof(double)).data(), count * sizeof(double));
    for (const double z : grid.z_nm) good = good && std::isfinite(z);
  }
  if (!good)
    throw RunError(std::string(kSubject) + ": its surface cannot be drawn: more than " +
                   std::to_string(SceneChecker::kGroundMax) +
                   " heights per side, or values that are not numbers");
}

/// 0, not known, for what is no radius of a tip.
double unpack_tip_radius(recording::Unpacker& from) {
  const double radius_nm = from.get<double>();
  return radius_nm >= SceneChecker::kTipRadiusLeast_nm && radius_nm <= SceneChecker::kTipRadiusMost_nm
             ? radius_nm
             : 0;
}

recording::ChildLimits limits_of(std::size_t memory_bytes, int seconds) {
  recording::ChildLimits limits;
  limits.time = std::chrono::seconds(seconds);
  limits.memory_bytes = memory_bytes;
  limits.answer_bytes = std::size_t{64} << 20;
  limits.reader = "this program";
  limits.advice = "it is not used";
  return limits;
}

}  // namespace

SceneChecker::SceneChecker(std::size_t memory_bytes, int seconds, int processes) {
  for (int i = 0; i < processes; ++i)
    processes_.push_back(
        std::make_unique<recording::ChildCall>(kSubject, answer, limits_of(memory_bytes, seconds)));
}

recording::ChildCall& SceneChecker::process() noexcept {
  while (at_ + 1 < processes_.size() && processes_[at_]->is_over()) ++at_;
  return *processes_[at_];
}

void SceneChecker::stop() noexcept {
  for (const auto& process : processes_) process->stop();
}

SceneShape SceneChecker::shape_of(const std::string& bundle, const StillWanted& still_wanted) {
  const std::string answered = process().ask("G" + bundle, still_wanted);
  recording::Unpacker from(answered);
  SceneShape shape;
  shape.tip_radius_nm = unpack_tip_radius(from);
  unpack(from, shape.heights);
  return shape;
}

CheckedScene read_finding(const std::string& finding) {
  recording::Unpacker from(finding);
  CheckedScene scene;
  scene.name = from.text();
  scene.text = from.text();
  scene.scene_hash = from.get<std::uint64_t>();
  scene.canonical_motion = from.get<std::uint64_t>();
  scene.tip_radius_nm = unpack_tip_radius(from);
  unpack(from, scene.ground);
  return scene;
}

}  // namespace telenano::scene_store
