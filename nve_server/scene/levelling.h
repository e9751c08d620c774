#pragma once

#include <optional>
#include <string_view>

#include "telenano/nve_server/physics/surface/height_grid.h"

namespace telenano::scene {

/// What is taken out of a scan before it is touched: the sample's tilt under the scanner, and the jumps
/// between scan lines.
enum class Levelling { kNone, kPlane, kLines };

/// "none", "plane" or "lines".
std::optional<Levelling> levelling_from_name(std::string_view name) noexcept;

/// Takes out the least-squares plane z = c + a x + b y. On a full grid the centred columns and rows are
/// orthogonal, so that the normal equations are three quotients, a = Σ x z / Σ x² (x, y from the middle).
/// Leaves a mean of 0.
void level_plane(physics::HeightGrid& grid);

/// Aligns each line (a row, along x, which is how a scanner goes) to the one below by the **median of their
/// differences**, then takes out the mean and the least-squares tilt along x. Why the median of differences:
/// a mean, or a tilt fitted to each line, is pulled by whatever stands on the line (a flake leaves a dark
/// band on either side); the median of the line itself moves as soon as half of it is covered; the
/// difference of neighbours is zero but at the flake's borders, so that even a flake as wide as the scan
/// stays but for a step at its lower and its upper edge. What it costs: the errors of the medians, about
/// 1.25 σ/√columns each, add up from line to line as a random walk, and the mean slope along y is lost.
///
/// Linear drifts and offsets of any size go entirely; applied twice it does the same as once (both to
/// rounding).
void level_lines(physics::HeightGrid& grid);

/// One of the above, then the lowest sample at z = 0 as frame W has it.
void level(physics::HeightGrid& grid, Levelling levelling);

}  // namespace telenano::scene
