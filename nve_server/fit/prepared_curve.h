#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "telenano/nve_server/fit/noise_model.h"
#include "telenano/nve_server/fit/raw_curve.h"

namespace telenano::fit {

/// Where the deflection leaps: snap-in or pull-off.
struct Leap {
  std::size_t before = 0;  ///< the last point before it
  std::size_t after = 0;   ///< the first point after it
  double z_nm = 0;         ///< of the base, in the middle
  double sigma_nm = 0;     ///< how well that is known: half of the width over √3, with the noise
  double height_nm = 0;    ///< of the deflection, positive
};

/// One way, in order of time. The base's height is positive upwards; deflection is positive where the sample
/// pushes.
struct PreparedSegment {
  std::vector<double> z_nm;
  std::vector<double> deflection_nm;
  std::vector<double> slope;  ///< smoothed d(deflection)/dz: what noise of z makes of the deflection
  std::optional<Leap> leap;
  std::optional<Leap> step;  ///< on the approach, if looked for: where a liquid bridge forms, before any leap
  std::size_t free_begin = 0;  ///< the part without any force, [begin, end)
  std::size_t free_end = 0;
};

struct PreparedCurve {
  PreparedSegment approach;
  PreparedSegment retract;
  double z_middle_nm = 0;  ///< the baseline is offset + tilt·(z − z_middle), by way: approach, retract
  double offset_nm[2] = {0, 0};
  double tilt[2] = {0, 0};            ///< virtual deflection and drift, nm/nm
  double noise_nm = 0;                ///< rms of the free part about its baseline
  double z_noise_nm = 0;              ///< white part of the noise of z
  NoiseModel noise;                   ///< of the free part, along time: approach, then retract
  double touch_z_nm = 0;              ///< base at touch, roughly: a start
  double deepest_slope = 0;           ///< d(deflection)/d(−z) at the deepest tenth; 1: a rigid sample
  std::optional<double> invols_nm_v;  ///< that turned volts into nm
  std::vector<std::string> notes;     ///< what was done that a person would want to know
  std::string error;                  ///< not empty: why this curve cannot be fitted
};

struct Preparation {
  double stiffness_n_m = 0;  ///< turns a file's forces into deflections
  std::optional<double> invols_nm_v;
  bool invols_from_stiff = false;  ///< volts per nm from the deepest tenth, taken as rigid
  bool bridge_step = false;        ///< look for the step at which a liquid bridge forms
};

/// Signs, units, leaps, baseline and noise of a curve. Never throws but for want of memory.
///
/// Baseline: a line under each way, by least squares over the free part, which goes on until the deflection
/// stands out of the far quarter's line by six times its noise. One slope would do for virtual deflection
/// (light that the sample reflects is a matter of the height), but drift has the other sign on the way back.
/// Noise: see noise_model.h, from the free part of both ways.
/// Step: on a lever so stiff that it does not leap, the bridge's force sets in within one point, in a curve
/// that bends. It is where parabolas through the points before and after miss each other the most, by more
/// than seven times what the noise makes of that.
/// A curve that is not one approach and its retract, or whose detector clips, is refused: see curve_check.h.
PreparedCurve prepare(const RawCurve& raw, const Preparation& how);

/// Noise from one point to the next that neither slope nor slow drift is part of: third differences, whose
/// variance for white noise is 20 times its own; by the median, so that leaps do not count.
double rough_noise(const std::vector<double>& y);

/// On a spring: the part of the base's way by which the deflection grows in contact, d(deflection)/d(−z), by least
/// squares over the deeper half of the contact, mean of both ways. Its standard deviation is by the residuals'
/// scatter, and at least a quarter of what the ways differ by (friction, the piezo's hysteresis).
struct ReferenceSlope {
  double value = 0;
  double error = 0;
};
ReferenceSlope reference_slope(const PreparedCurve& curve);

}  // namespace telenano::fit
