#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/surface/gsf.h"

namespace telenano::import {

/// A name for files and scenes: letters, digits, '-' and '_' of `text`, all else '_', 1 to 40 characters.
std::string plain_name(std::string_view text);

struct ImportedScene {
  std::string name;                   ///< of the scene, as plain_name makes it
  std::string scan_file;              ///< beside the scene, as plain_name makes it with .gsf
  std::vector<std::string> comments;  ///< where it comes from and what was done to it, a line each
  double tip_radius_nm = 20;          ///< 1 to 1e4
};

/// The scene's description: what a scan does not say (materials, lever, limits) has the values of the scene
/// `flakes`, with comments that say so. The tip starts over the middle.
std::string scene_text(const ImportedScene& scene, const surface::Scan& scan);

/// A tip whose radius is more than four times the scan's shorter side: it would touch beyond the rim, where
/// nothing was measured, and its fields would be many times as wide as the scan.
inline bool tip_too_wide(const surface::Scan& scan, double tip_radius_nm) {
  return tip_radius_nm > 4.0 * (scan.width_nm < scan.height_nm ? scan.width_nm : scan.height_nm);
}

/// Wider pixels than half the tip's radius: fewer than four of them across the ball, so that the ground's
/// curvature where the tip touches is the interpolation's and not the sample's.
inline bool pixels_coarse(const surface::HeightGrid& grid, double tip_radius_nm) {
  return grid.dx_nm > 0.5 * tip_radius_nm || grid.dy_nm > 0.5 * tip_radius_nm;
}

}  // namespace telenano::import
