#pragma once

#include <cmath>
#include <memory>
#include <numbers>
#include <string>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::afm {

/// Silicon oxide with a step up of `height_nm`, 60 nm from where the tip approaches, towards `direction_deg`. The
/// lever yields along Z alone, or is a beam that points to `points`, "+y" or "-y".
inline std::shared_ptr<const scene::Scene> with_a_step(double height_nm, int direction_deg = 0,
                                                       double edge_nm = 6, const std::string& points = "") {
  double x_nm = direction_deg == 0 ? -60 : direction_deg == 180 ? 60 : 0;
  double y_nm = direction_deg == 90 ? -60 : direction_deg == 270 ? 60 : 0;
  if (direction_deg % 90 != 0) {
    x_nm = -60 * std::cos(direction_deg * std::numbers::pi / 180);
    y_nm = -60 * std::sin(direction_deg * std::numbers::pi / 180);
  }
  // As stiff as the other, 40 N/m, and its tip a tenth of its length high.
  const std::string lever = points.empty() ? "stiffness_n_m = 40.0\n" : "points = \"" + points + "\"\n";
  const std::string beam = points.empty() ? "" : R"([probe.beam]
youngs_modulus_gpa = 169.0
width_um = 28.894
thickness_um = 4.0
length_um = 125.0
tip_height_um = 12.5
)";
  return scene::parse_scene(R"(name = "step"
[sample]
name = "silicon oxide"
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "step"
height_nm = )" + std::to_string(height_nm) +
                                R"(
edge_nm = )" + std::to_string(edge_nm) +
                                R"(
spacing_nm = )" + std::to_string(edge_nm / 8.5) +
                                R"(
direction_deg = )" + std::to_string(direction_deg) +
                                R"(.0
x_nm = 0.0
y_nm = 0.0
[probe]
tip_radius_nm = 20.0
)" + lever + beam + R"([probe.tip]
name = "silicon"
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
speed_max_nm_s = 100000.0
retract_speed_nm_s = 1000.0
top_nm = 100.0
depth_nm = 60.0
half_width_nm = 150.0
margin_nm = 25.0
rate_max_hz = 8000
[start]
x_nm = )" + std::to_string(x_nm) +
                                R"(
y_nm = )" + std::to_string(y_nm) +
                                R"(
height_nm = 20.0
)",
                            "the scene of a step");
}

}  // namespace telenano::afm
