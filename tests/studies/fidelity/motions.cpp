#include "tests/studies/fidelity/motions.h"

#include <algorithm>

#include "telenano/common/base/error.h"

namespace telenano::studies::fidelity {
namespace {

using Waypoint = device::IntendedMotion::Waypoint;
using Script = std::vector<Waypoint>;

/// Waypoints by how long each part takes.
class Path {
 public:
  explicit Path(double height_nm) { script_.push_back({0, {0, 0, height_nm}}); }
  Path& to(double x_nm, double y_nm, double z_nm, double seconds) {
    script_.push_back({script_.back().time_s + seconds, {x_nm, y_nm, z_nm}});
    return *this;
  }
  Path& rest(double seconds) {
    const Vec3 pos = script_.back().pos_nm;
    return to(pos.x(), pos.y(), pos.z(), seconds);
  }
  Script done() const { return script_; }

 private:
  Script script_;
};

/// Down to `depth_nm` below the surface and up again, as slowly as one looks for a force.
Script slow_indent(double height_nm, double depth_nm) {
  return Path(height_nm)
      .to(0, 0, 3, 0.8)
      .to(0, 0, -depth_nm, 1.2)
      .rest(0.4)
      .to(0, 0, 3, 1.2)
      .to(0, 0, height_nm, 0.6)
      .done();
}

/// Twice, as fast as a hand taps: some 0.1 m/s with the default scale.
Script fast_indent(double height_nm, double depth_nm) {
  Path path(height_nm);
  for (int i = 0; i < 2; ++i) path.to(0, 0, -depth_nm, 0.4).rest(0.2).to(0, 0, height_nm, 0.4).rest(0.3);
  return path.done();
}

/// Lines of `side_nm` to and fro at 40 nm/s, 5 nm apart.
Script raster(double height_nm, double depth_nm, double side_nm, int lines) {
  Path path(height_nm);
  path.to(0, 0, -depth_nm, 1.0);
  double x = 0, y = 0;
  for (int i = 0; i < lines; ++i) {
    x = x > 0 ? 0 : side_nm;
    path.to(x, y, -depth_nm, side_nm / 40);
    if (i + 1 < lines) path.to(x, y += 5, -depth_nm, 0.2);
  }
  return path.to(x, y, height_nm, 1.0).done();
}

Script twice_off_rubber() {
  Path path(20);
  for (int i = 0; i < 2; ++i) path.to(0, 0, -25, 0.5).rest(0.2).to(0, 0, 104, 0.7).rest(0.3);
  return path.done();
}

std::vector<SceneMotion> make_motions() {
  return {
      {"flat_silicon_oxide", "indent_slow", true, slow_indent(20, 12)},
      {"flat_silicon_oxide", "indent_fast", true, fast_indent(20, 12)},
      {"flat_polystyrene", "indent_slow", false, slow_indent(20, 8)},
      {"flat_polystyrene", "indent_fast", false, fast_indent(20, 8)},
      // Rubber lets go of the tip only some 95 nm above where it stands: half a millimetre of the hand a nm.
      {"flat_pdms", "indent_slow", true,
       Path(20)
           .to(0, 0, 3, 0.8)
           .to(0, 0, -25, 1.0)
           .rest(0.3)
           .to(0, 0, 40, 1.0)
           .to(0, 0, 104, 1.2)
           .rest(0.4)
           .done(),
       2e-6},
      {"flat_pdms", "indent_fast", false, twice_off_rubber(), 2e-6},
      {"flat_table", "indent_fast", false, fast_indent(20, 12)},
      {"flakes", "indent_fast", false, fast_indent(20, 12)},
      {"flakes", "raster", true, raster(20, 6, 40, 3)},
      {"flakes_potential", "raster", false, raster(20, 6, 40, 3)},
      // Onto the wet ground, along it and off again: the bridge holds on longer than the solid does.
      {"humid_flakes", "touch", false,
       Path(20)
           .to(0, 0, 2, 0.8)
           .to(0, 0, -4, 0.8)
           .to(15, 0, -4, 0.6)
           .to(0, 0, -4, 0.6)
           .to(0, 0, 6, 1.0)
           .to(0, 0, 20, 0.5)
           .done()},
      {"lithography", "indent_slow", false, slow_indent(20, 15)},
      // A groove of 50 nm, back along it, and up.
      {"lithography", "plough", true,
       Path(20).to(0, 0, -12, 0.8).to(50, 0, -12, 1.2).to(0, 0, -12, 1.2).to(0, 0, 20, 0.8).done()},
      // The particle's centre is 60 nm ahead, 30 nm up; the tip meets it below its top and shoves it on.
      {"particle", "push", true,
       Path(40).to(0, 0, 10, 0.8).to(70, 0, 10, 2.0).rest(0.2).to(50, 0, 20, 0.6).to(50, 0, 60, 0.6).done()},
      // Down on its top, hold, off again.
      {"particle", "press", false,
       Path(40).to(0, 0, 75, 0.6).to(60, 0, 75, 0.8).to(60, 0, 52, 0.8).rest(0.2).to(60, 0, 80, 0.8).done()},
  };
}

}  // namespace

std::span<const SceneMotion> scene_motions() {
  static const std::vector<SceneMotion> motions = make_motions();
  return motions;
}

std::vector<const SceneMotion*> chosen_motions(const std::vector<std::string>& names, bool quick) {
  std::vector<const SceneMotion*> chosen;
  if (names.empty()) {
    for (const SceneMotion& m : scene_motions()) {
      if (!quick || m.quick) chosen.push_back(&m);
    }
    return chosen;
  }
  for (const std::string& name : names) {
    const std::size_t before = chosen.size();
    std::string known;
    for (const SceneMotion& m : scene_motions()) {
      const std::string full = std::string(m.scene) + "/" + m.motion;
      known += (known.empty() ? "" : ", ") + full;
      const bool wanted = name == full || name == m.scene;
      if (wanted && std::find(chosen.begin(), chosen.end(), &m) == chosen.end()) chosen.push_back(&m);
    }
    const bool again = std::any_of(chosen.begin(), chosen.end(), [&](const SceneMotion* m) {
      return name == m->scene || name == std::string(m->scene) + "/" + m->motion;
    });
    if (chosen.size() == before && !again)
      throw UserError("fidelity: --scenes: '" + name + "' is unknown; expected a scene or one of " + known);
  }
  return chosen;
}

}  // namespace telenano::studies::fidelity
