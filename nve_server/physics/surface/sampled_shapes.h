#pragma once

#include "telenano/nve_server/physics/surface/height_grid.h"

/// Shapes that have no fields in closed form, as heights on a grid for a SplineSurface; a level sample
/// too, where marks are to stay in it.
///
/// The spline's error in height is (kh)⁴/384 or so of the amplitude of a wave of k = 2π/period, its
/// curvature's (kh)²/12: at 16 samples a period 6e-5 and 1.3 %, at 32 samples 4e-6 and 0.3 %. An edge counts
/// as a wave of twice its width.
namespace telenano::physics {

struct SampledArea {
  double x_first_nm = -100;
  double y_first_nm = -100;
  double width_nm = 200;    ///< along x
  double length_nm = 200;   ///< along y
  double spacing_nm = 0.5;  ///< at most; the extents are divided evenly
};
inline constexpr int kMaxSamples = 1 << 22;

/// z = 0 up to the edge and `height` beyond it, along `direction` from x towards y, the edge's middle through
/// (x, y). Its profile t³(10 − 15t + 6t²) (C², steepest 1.875 height/width) has 8 samples at least.
struct StepShape {
  double x_nm = 0;
  double y_nm = 0;
  double direction_rad = 0;
  double height_nm = 5;
  double width_nm = 4;
};

/// Lines across `direction`, z from 0 to `height`; (x, y) in the middle of a groove.
///   sinusoid:  z = height (1 − cos 2πs/period)/2
///   trapezoid: as wide on top as below, edges as those of a step, `edge_nm` <= period/2
/// 16 samples a period and 8 an edge at least.
enum class GratingProfile { kSinusoid, kTrapezoid };
struct GratingShape {
  GratingProfile profile = GratingProfile::kSinusoid;
  double x_nm = 0;
  double y_nm = 0;
  double direction_rad = 0;
  double height_nm = 10;
  double period_nm = 100;
  double edge_nm = 20;  ///< of the trapezoid
};

/// They throw UserError for what is no number, not positive, finer than the grid, or more than kMaxSamples.
HeightGrid sample_level(const SampledArea& area, double height_nm);
HeightGrid sample_step(const SampledArea& area, const StepShape& shape);
HeightGrid sample_grating(const SampledArea& area, const GratingShape& shape);

}  // namespace telenano::physics
