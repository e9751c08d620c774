#include "telenano/nve_server/app/sample/fit_map.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <system_error>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/app/sample/fit_files.h"
#include "telenano/nve_server/app/sample/fit_lever.h"
#include "telenano/nve_server/app/sample/user_files.h"

namespace telenano::app {
namespace {

struct MapOf {
  const char* name;  // of the estimate, and the file's
  const char* title;
  const char* unit;
  double in_unit;  // of the estimate's own
};
constexpr MapOf kMaps[] = {{"E", "Young's modulus", "Pa", 1e9},   {"w", "work of adhesion", "J/m2", 1e-3},
                           {"R", "tip radius", "m", 1e-9},        {"z0", "equilibrium distance", "m", 1e-9},
                           {"H", "Hamaker constant", "J", 1e-18}, {"humidity", "humidity", "", 1e-2},
                           {"film", "adsorbed films", "m", 1e-9}};

std::string map_file(const FitOptions& options, const MapOf& what) {
  return (std::filesystem::path(options.map) / (std::string(what.name) + ".gsf")).string();
}

}  // namespace

fit::ParameterMap map_of(const FitOptions& options, std::size_t curves) {
  fit::ParameterMap map;
  if (options.map.empty()) {
    if (!options.map_grid.empty() || !options.map_size.empty())
      throw UserError("--map-grid and --map-size-nm need --map FOLDER");
    return map;
  }
  double columns = 0, rows = 0;
  const bool whole = two_numbers(options.map_grid, columns, rows) && columns >= 1 && rows >= 1 &&
                     columns <= 4096 && rows <= 4096 && columns == std::floor(columns) &&
                     rows == std::floor(rows);
  if (!whole) {
    throw UserError("--map-grid is '" + fit::plain_line(options.map_grid) +
                    "', expected COLUMNSxROWS, such as 32x32");
  }
  const bool sized = two_numbers(options.map_size, map.width_nm, map.length_nm) && map.width_nm > 0 &&
                     map.length_nm > 0 && map.width_nm < 1e9 && map.length_nm < 1e9;
  if (!sized) {
    throw UserError("--map-size-nm is '" + fit::plain_line(options.map_size) +
                    "', expected WIDTHxLENGTH in nm, such as 500x500");
  }
  map.columns = static_cast<int>(columns);
  map.rows = static_cast<int>(rows);
  const auto places = static_cast<std::size_t>(map.columns) * static_cast<std::size_t>(map.rows);
  if (places != curves) {
    throw UserError("--map-grid " + options.map_grid + " has " + std::to_string(places) + " places, and " +
                    std::to_string(curves) +
                    " curves are given: expected one per place, line by line from the lower left");
  }
  return map;
}

void check_map_targets(const FitOptions& options) {
  for (const MapOf& what : kMaps) check_target(map_file(options, what), "--map", options);
}

void write_maps(const FitOptions& options, fit::ParameterMap map, const std::vector<FittedCurve>& curves) {
  std::error_code error;
  std::filesystem::create_directories(options.map, error);
  if (error) throw RunError(options.map + ": cannot be made: " + error.message());
  for (const MapOf& what : kMaps) {
    map.values.clear();
    bool any = false;
    for (const FittedCurve& curve : curves) {
      const auto& all = curve.fit.estimates;
      const auto found =
          std::find_if(all.begin(), all.end(), [&](const auto& e) { return e.name == what.name; });
      const bool there = curve.fit.error.empty() && found != all.end();
      any = any || there;
      map.values.push_back(there ? what.in_unit * found->value : std::nan(""));
    }
    if (!any) continue;
    map.title = what.title;
    map.unit = what.unit;
    std::size_t filled = 0;
    write_text(map_file(options, what), fit::format_map(map, filled));
    std::printf("# map of %s: %s", what.title, map_file(options, what).c_str());
    if (filled > 0) std::printf(" (%zu places without a fit have the median)", filled);
    std::printf("\n");
  }
}

}  // namespace telenano::app
