#pragma once

#include <span>
#include <vector>

#include "telenano/master/calibration/dynamics_sample.h"

namespace telenano::calibration {

struct TimedPosition {
  double time_s = 0;
  double position_m = 0;
};

/// The positions of a track whose time is known to a millisecond, and what was between them where the processor was taken away
/// for 3 to 20 ms: there one each millisecond, on the cubic that fits the positions of the 8 ms before and after best.
///
/// Error       of a motion of 8 Hz and amplitude a: below 0.004 a in a gap of 19 ms (FilledPositions.MeetASineInAGap). A straight
///             line over the gap would have 1 − cos(2π f h) = 0.11 a, h half of the gap.
/// Left open   gaps of more than 20 ms, and those with fewer than four positions on a side.
std::vector<TimedPosition> filled_positions(std::span<const DynamicsSample> track);

}  // namespace telenano::calibration
