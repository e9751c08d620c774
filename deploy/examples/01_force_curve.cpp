// A force–distance curve on flat silicon oxide, from a scene written in the program.
// Prints CSV; at the end, on stderr, where the tip jumped into contact and what it took to pull it off.
#include <algorithm>
#include <cstdio>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/force_curve.h"
#include "telenano/nve_server/scene/scene.h"

namespace {

constexpr const char* kScene = R"(
name = "my_oxide"
[sample]
name = "silicon oxide"
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "flat"
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 2.0
[probe.tip]
name = "silicon"
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[forces]
van_der_waals = true
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
speed_max_nm_s = 100000.0
retract_speed_nm_s = 1000.0
top_nm = 100.0
depth_nm = 60.0
half_width_nm = 500.0
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 20.0
)";

}  // namespace

int main() {
  using namespace telenano;
  try {
    const auto scene = scene::parse_scene(kScene, "my_oxide.toml");
    scene::CurvePlan plan;
    plan.from_nm = 40;
    plan.to_nm = -10;
    double pull_off_nn = 0;
    double snap_in_nm = 0;
    double last_tip_nm = plan.from_nm;
    std::puts("approach,base_nm,tip_nm,force_nn");
    scene::run_curve(*scene, plan, [&](const scene::CurveRow& row) {
      std::printf("%d,%.3f,%.4f,%.4f\n", row.approach ? 1 : 0, row.base_z_nm, row.tip_z_nm, row.force_nn);
      if (row.approach && last_tip_nm - row.tip_z_nm > 0.1 && snap_in_nm == 0) snap_in_nm = row.base_z_nm;
      if (!row.approach) pull_off_nn = std::max(pull_off_nn, -row.force_nn);
      last_tip_nm = row.tip_z_nm;
    });
    std::fprintf(stderr, "snap-in with the base at %.2f nm, pull-off %.2f nN\n", snap_in_nm, pull_off_nn);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
