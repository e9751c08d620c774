#pragma once

#include <cstddef>
#include <vector>

#include "telenano/common/surface/height_grid.h"

/// What is done to a scan before it is touched. Grids have 2 or more columns and rows, and finite heights
/// where nothing else is said.
namespace telenano::import {

/// Puts smooth heights where `gap` says true: the discrete Laplace equation with the heights around as its
/// boundary (no flow over the scan's rim), to 1e-6 of their range or 2000 sweeps. False, and nothing is done,
/// if all are gaps. What `grid` holds in a gap is not looked at.
bool fill_gaps(surface::HeightGrid& grid, const std::vector<bool>& gap);

/// The scan's noise as one pixel has it, in nm: 1.4826 times the median of |second differences along x|/√6,
/// which slopes, steps and spikes do not change while they are fewer than half of the pixels; no less than
/// 1/65536 of the range, which is one step of the converter that measured it.
double pixel_noise_nm(const surface::HeightGrid& grid);

/// Takes out what one or two pixels hold alone: a pixel that is more than `sigma` (1 or more) times
/// pixel_noise_nm from the median of the 5 × 5 pixels around it, with at most one other of them beyond half
/// of its way. The end of a ridge of one pixel's width has two of its own within reach and stays, as every
/// corner does. It gets that median. Returns how many.
std::size_t remove_spikes(surface::HeightGrid& grid, double sigma);

/// How many that would be.
std::size_t count_spikes(const surface::HeightGrid& grid, double sigma);

struct Plane {
  double slope_x = 0;  ///< dz/dx
  double slope_y = 0;  ///< dz/dy
  bool converged = false;
};

/// The plane of most of the scan, by least squares that leave out what stands on it: Tukey's biweight (weight
/// (1 − (r/4.685 s)²)², s = 1.4826 median |r|), iterated from the medians of height differences of pixels
/// close by. A plain least-squares plane tilts towards a flake that lies to one side; here flakes count for
/// nothing once they are further than 4.7 s from the plane, and most of the scan must lie on it.
Plane fit_plane(const surface::HeightGrid& grid);

/// Takes the slopes out; the height in the middle stays.
void subtract(surface::HeightGrid& grid, const Plane& plane);

}  // namespace telenano::import
