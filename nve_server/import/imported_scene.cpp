#include "telenano/nve_server/import/imported_scene.h"

#include <algorithm>
#include <sstream>

#include "telenano/nve_server/import/gwy_file.h"

namespace telenano::import {

std::string plain_name(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  std::string name;
  for (const char c : text.substr(0, kLongest)) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    name.push_back(plain ? c : '_');
  }
  return name.empty() ? "scan" : name;
}

std::string scene_text(const ImportedScene& scene, const surface::Scan& scan) {
  const surface::HeightGrid& grid = scan.grid;
  const double radius = scene.tip_radius_nm;
  const double half_extent_nm = 0.5 * std::min((grid.columns - 1) * grid.dx_nm, (grid.rows - 1) * grid.dy_nm);
  // A tenth of the scan, but more than the tip needs: beyond the rim nothing was measured.
  const double margin_nm = std::min(std::max(0.1 * half_extent_nm, 1.25 * radius), 0.5 * half_extent_nm);
  // Above the attraction of these materials, 2π·0.4 J/m²·R = 2.5 nN a nm at most, which a scene demands.
  const double force_max_nn = std::max(500.0, 10.0 * radius);

  // A wide tip on a steep scan touches above the highest sample already; a scene must start above that.
  const double range_nm = *std::max_element(grid.z_nm.begin(), grid.z_nm.end());
  const double top_nm = std::max({100.0, radius, 0.2 * range_nm});

  std::ostringstream text;
  text.precision(9);
  for (const std::string& comment : scene.comments) text << "# " << printable(comment, 1000) << "\n";
  text << "# Frame W: x to the right, y up the image, z out of the sample; origin at the lower left corner, "
          "lowest sample at z = 0.\n"
       << "name = \"" << scene.name << "\"\n\n"
       << "[sample]                      # a scan carries no material: silicon oxide stands in for yours\n"
       << "name = \"silicon oxide\"\n"
       << "youngs_modulus_gpa = 70.0\n"
       << "poisson_ratio = 0.27\n"
       << "surface_energy_j_m2 = 0.2\n\n"
       << "[surface]\n"
       << "kind = \"scan\"\n"
       << "file = \"" << scene.scan_file << "\"   # relative to this file\n"
       << "level = \"none\"                # done already, see above\n\n"
       << "[probe]\n"
       << "tip_radius_nm = " << radius << "\n"
       << "stiffness_n_m = 40.0          # your lever's\n\n"
       << "[probe.tip]\n"
       << "name = \"silicon\"\n"
       << "youngs_modulus_gpa = 160.0\n"
       << "poisson_ratio = 0.27\n"
       << "surface_energy_j_m2 = 0.2\n\n"
       << "[forces]\n"
       << "van_der_waals = true\n\n"
       << "[coupling]                    # virtual coupling between the commanded end and the cantilever's "
          "base\n"
       << "stiffness_n_m = 20.0\n"
       << "damping_n_s_m = 0.0\n\n"
       << "[limits]\n"
       << "force_max_nn = " << force_max_nn << "\n"
       << "speed_max_nm_s = 100000.0\n"
       << "retract_speed_nm_s = 1000.0\n"
       << "top_nm = " << top_nm << "                  # workspace above the highest and\n"
       << "depth_nm = 60.0               # below the lowest point of the surface (of the commanded end)\n"
       << "margin_nm = " << margin_nm << "   # kept from the rim of the scan\n"
       << "rate_max_hz = 8000\n\n"
       << "[start]                       # apex above the height at which it would touch at (x, y)\n"
       << "x_nm = " << 0.5 * scan.width_nm << "\n"
       << "y_nm = " << 0.5 * scan.height_nm << "\n"
       << "height_nm = 20.0\n";
  return text.str();
}

}  // namespace telenano::import
