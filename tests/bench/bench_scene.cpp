// What each term of a scene costs: the step of the slave in the full scene (humid_flakes), then with one term
// left out of its description at a time. The scene that is built has no trace of what was left out, so the
// difference to the first row is what leaving it out saves. Last the flat, dry, rigid sample, the least there
// is. Goals: the full scene 2 us a step, the least 300 ns.
//
// The tip goes as in `telenano-nve check`, to and fro sideways at a constant commanded height at 1 kHz: 1 nm
// a step or a tenth of that, hovering or pressed. Times are of blocks of 25 steps (averages the clock's own
// cost away); Newton's iterations are those of single steps.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano {
namespace {

const std::string kScenes = std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/";

class Description {
 public:
  explicit Description(const std::string& name) {
    std::ifstream file(kScenes + name + ".toml");
    text_.assign(std::istreambuf_iterator<char>(file), {});
    if (const auto at = text_.find("\"../data/"); at != std::string::npos) text_.insert(at + 1, kScenes);
  }

  /// The line that starts with `key`; with nothing to put instead it goes.
  Description& line(const std::string& key, const std::string& instead = "") {
    return cut(find("\n" + key) + 1, "\n", instead);
  }
  /// The table of this header, up to the next table.
  Description& table(const std::string& header, const std::string& instead = "") {
    return cut(find("\n[" + header + "]") + 1, "\n[", instead);
  }

  std::shared_ptr<const scene::Scene> scene() const {
    const auto path = std::filesystem::temp_directory_path() /
                      ("telenano-bench-scene-" + std::to_string(::getpid()) + ".toml");
    std::ofstream(path) << text_;
    auto loaded = scene::load_scene(path.string());
    std::filesystem::remove(path);
    return loaded;
  }

 private:
  std::size_t find(const std::string& what) const {
    const std::size_t at = text_.find(what);
    if (at == std::string::npos) throw std::runtime_error("no " + what + " in the scene");
    return at;
  }
  Description& cut(std::size_t from, const std::string& until, const std::string& instead) {
    const std::size_t to = text_.find(until, from);
    text_.replace(from, to == std::string::npos ? to : to + 1 - from, instead);
    return *this;
  }
  std::string text_;
};

Description humid_flakes() {
  return Description("humid_flakes");
}
Description without_friction() {
  return humid_flakes().table("friction");
}
Description without_capillary() {
  return humid_flakes().table("forces.capillary");
}
Description without_retardation_and_cone() {
  return humid_flakes().line("retardation_nm").line("cone_half_angle_deg").line("cone_height_nm");
}
// The same stiffness along its own normal, none of the beam's other compliances, upright.
Description without_lateral_bending() {
  return humid_flakes().table("probe.beam").line("tilt_deg").line("points", "stiffness_n_m = 44.7\n");
}
// Retardation and cone are van der Waals forces too, and go with it.
Description without_van_der_waals() {
  return without_retardation_and_cone().line("van_der_waals", "van_der_waals = false\n");
}
Description without_surface() {
  return humid_flakes()
      .table("surface", "[surface]\nkind = \"flat\"\n")
      .line("margin_nm")
      .line("x_nm", "x_nm = 0.0\n")
      .line("y_nm", "y_nm = 0.0\n");
}
Description flat_dry() {
  return Description("flat_silicon_oxide");
}
Description flat_dry_rigid() {
  return flat_dry().line("stiffness_n_m = 40", "rigid = true\n");
}

// The tip is busy elsewhere: the particle rests, 150 nm and more away.
Description particle_far() {
  return Description("particle").line("x_nm = 60.0", "x_nm = 250.0\n");
}
Description without_particle() {
  return Description("particle").table("particle").table("particle.material").table("particle.friction");
}
// The same on the scan, the particle some 200 nm away from where the tip goes.
const std::string kParticleOnScan = R"([particle]
radius_nm = 30.0
x_nm = 480.0
y_nm = 120.0
[particle.material]
youngs_modulus_gpa = 2.0
poisson_ratio = 0.4
surface_energy_j_m2 = 0.066
[particle.friction]
sample_shear_strength_mpa = 30.0
tip_shear_strength_mpa = 30.0
rolling_length_nm = 0.3

)";
Description scan_without_particle() {
  return Description("flakes");
}
Description scan_particle_far() {
  return scan_without_particle().line("[coupling]", kParticleOnScan + "[coupling]\n");
}

// Heights three times those of the scan: slopes of 30 to 45 degrees.
Description steep_flakes() {
  surface::Scan scan = surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  for (double& z : scan.grid.z_nm) z *= 3.0;
  const auto path = std::filesystem::temp_directory_path() / "telenano-bench-steep.gsf";
  surface::write_gsf(path.string(), scan);
  return Description("flakes").line("file = ", "file = \"" + path.string() + "\"\n");
}

Description dry_smooth() {
  return humid_flakes().table("friction").table("forces.capillary");
}

double percentile(std::vector<double>& values, int percent) {
  std::sort(values.begin(), values.end());
  return values[values.size() * static_cast<std::size_t>(percent) / 100];
}

void scene_step(benchmark::State& state, Description description(), bool sleeps, double height_nm,
                double move_nm) {
  constexpr int kStepsPerBlock = 25;
  const auto described = description().scene();
  const auto scene = std::make_shared<scene::Scene>(*described);
  if (scene->particle) scene->particle->parameters.sleeps = sleeps;
  slave::NveSlave slave(scene);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  input.follow = true;
  const double bottom = scene->start_touch_w_nm + height_nm;
  Vec3 target = scene->start_apex_w_nm;
  while (target.z() != bottom) {
    target.z() = target.z() - bottom > 1.0 ? target.z() - 1.0 : bottom;
    input.tip_target_pos_w_nm = target;
    slave.step(input, 1e-3, output);
  }
  double x = 0, direction = move_nm;
  std::vector<double> ns, iterations;
  ns.reserve(static_cast<std::size_t>(state.max_iterations));
  iterations.reserve(static_cast<std::size_t>(state.max_iterations) * kStepsPerBlock);
  int faults = 0;
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kStepsPerBlock; ++i) {
      x += direction;
      if (std::abs(x) > 100.0) direction = -direction;
      input.tip_target_pos_w_nm = target + Vec3(x, 0.37 * x, 0.0);
      slave.step(input, 1e-3, output);
      iterations.push_back(slave.trace().tip.iterations);
      faults += output.fault_bits != 0;
    }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
    ns.push_back(spent.count() / kStepsPerBlock);
    state.SetIterationTime(1e-9 * spent.count());
  }
  state.counters["p50_ns"] = percentile(ns, 50);
  state.counters["p99_ns"] = percentile(ns, 99);
  state.counters["newton_p50"] = percentile(iterations, 50);
  state.counters["newton_p99"] = percentile(iterations, 99);
  state.counters["faults"] = faults;
}

const bool kRegistered = [] {
  const struct {
    const char* name;
    Description (*description)();
    bool sleeps = true;
  } rows[] = {{"full", humid_flakes},
              {"without_friction", without_friction},
              {"without_capillary", without_capillary},
              {"without_retardation_and_cone", without_retardation_and_cone},
              {"without_lateral_bending", without_lateral_bending},
              {"without_van_der_waals", without_van_der_waals},
              {"without_surface", without_surface},
              {"dry_smooth", dry_smooth},
              {"flat_dry", flat_dry},
              {"flat_dry_rigid", flat_dry_rigid},
              {"particle_far", particle_far},
              {"particle_far_awake", particle_far, false},
              {"particle_far_without", without_particle},
              {"scan_particle_far", scan_particle_far},
              {"scan_particle_far_awake", scan_particle_far, false},
              {"scan_particle_far_without", scan_without_particle},
              {"scan_steep", steep_flakes}};
  const struct {
    const char* name;
    double height_nm, move_nm;
  } motions[] = {{"pressed_5nm/slow", -5, 0.1}, {"pressed_5nm/fast", -5, 1}, {"hovering_10nm/fast", 10, 1}};
  for (const auto& motion : motions) {
    for (const auto& row : rows) {
      const auto name = std::string("scene_step/") + motion.name + "/" + row.name;
      benchmark::RegisterBenchmark(name.c_str(),
                                   [row, motion](benchmark::State& state) {
                                     scene_step(state, row.description, row.sleeps, motion.height_nm,
                                                motion.move_nm);
                                   })
          ->UseManualTime()
          ->Iterations(400);
    }
  }
  return true;
}();

}  // namespace
}  // namespace telenano
