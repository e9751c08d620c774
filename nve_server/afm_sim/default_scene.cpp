#include "telenano/nve_server/afm_sim/default_scene.h"

namespace telenano::afm_sim {

std::shared_ptr<const scene::Scene> default_scene() {
  return scene::parse_scene(R"(name = "silicon_oxide"
[sample]
name = "silicon oxide"
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "flat"
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 40.0
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
half_width_nm = 5000.0
rate_max_hz = 8000
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 20.0
)",
                            "the default scene");
}

}  // namespace telenano::afm_sim
