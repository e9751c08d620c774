#pragma once

#include <string>
#include <vector>

#include "telenano/common/surface/height_grid.h"
#include "tests/support/elastic_patch.h"

/// Retraction curves of a sphere from the boundary elements of elastic_patch.h, at places of a scan or over
/// shapes.
namespace telenano::elastic {

struct Probe {
  double radius_nm = 20;
  double modulus_gpa = 52.5;
  testing::ElasticPatch::Adhesion adhesion;
  /// Adhesion of no range (JKR) instead, for soft samples: ElasticPatch::stick().
  bool short_range = false;
  int elements = 128;
  double spacing_nm = 0.2604;
  /// Where the tip's axis stands from the middle of an element, in elements. Off the middle, the rim of a sphere's
  /// contact does not come off in rings.
  double axis_x = 0, axis_y = 0;
};

/// The undeformed gap of the patch's elements with the sphere at first touch, and the apex height there.
struct Ground {
  std::vector<double> gap;
  double touch_nm = 0;
};

/// The scan under an apex at (x, y), bicubic spline, its mirror image beyond the rim.
Ground ground_of(const Probe& probe, const surface::HeightGrid& scan, double x_nm, double y_nm);
/// Heights of a formula over (x, y) from the apex.
template <class Height>
Ground ground_of(const Probe& probe, const testing::ElasticPatch& patch, Height height) {
  Ground ground;
  double least = 1e300;
  for (int j = 0; j < probe.elements; ++j) {
    for (int i = 0; i < probe.elements; ++i) {
      const double x = patch.offset_nm(i) + probe.axis_x * probe.spacing_nm,
                   y = patch.offset_nm(j) + probe.axis_y * probe.spacing_nm;
      ground.gap.push_back(testing::sphere_profile(probe.radius_nm, x, y) - height(x, y));
      if (ground.gap.back() < least) least = ground.gap.back();
    }
  }
  for (double& gap : ground.gap) gap -= least;
  ground.touch_nm = -least;
  return ground;
}

struct State {
  double z_nm;  ///< apex height above first touch
  double force_nn;
};

/// Balances at the given heights, one after the other from the last one's displacement (so along the branch
/// of the first). NaN where none is found. With adhesion of no range the first is met from a wide contact, as the
/// attraction of longer range would have made it.
std::vector<State> follow(const Probe& probe, const Ground& ground, const std::vector<double>& z_nm);

/// The tip pressed and led along x at a constant apex height.
struct LineState {
  double along_nm;  ///< from the place
  double touch_nm;  ///< apex height of first touch there
  double z_nm;      ///< apex height
  double force_nn;  ///< on the tip, up
  double lateral_nn;
};
/// Over a scan from −length/2 to length/2 of (x, y), `depth_nm` below first touch at (x, y). The lateral force is
/// that of the tractions on the slope of the undeformed ground below each element: −∂/∂x of the energy that the
/// displacements have made least.
std::vector<LineState> along_line(const Probe& probe, const surface::HeightGrid& scan, double x_nm,
                                  double y_nm, double length_nm, double step_nm, double depth_nm);

/// Of a table of such lines (place, column, row, along_nm, touch_nm, z_nm, force_nn, lateral_nn).
struct Line {
  int number = 0, column = 0, row = 0;
  std::vector<LineState> states;
};
std::vector<Line> read_lines(const std::string& path);

/// One place of a reference table (place, column, row, touch_nm, z_nm, force_nn; lines with # and the heading
/// left out); the flat sample has place -1 and no column.
struct Place {
  int number = 0, column = 0, row = 0;
  double touch_nm = 0;
  std::vector<State> states;
  /// The greatest attraction, by a parabola through the three deepest states.
  double pull_off_nn() const;
};
/// Throws RunError if it cannot be read.
std::vector<Place> read_places(const std::string& path);

}  // namespace telenano::elastic
