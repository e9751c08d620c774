#pragma once

#include <cstdint>

#include "telenano/common/recording/sample.h"
#include "telenano/common/surface/height_grid.h"
#include "telenano/master/viewer/view_facts.h"

/// A session that never was, for pictures that must come out the same everywhere: a scan made by formula and
/// a tip that comes down on it, presses and draws a circle.
namespace telenano::support {

/// `side` × `side` heights over 600 × 600 nm: two round hills, a step and a fine ripple; 0 to about 15 nm.
surface::HeightGrid view_scan(int side);
double view_height_nm(double x_nm, double y_nm);  ///< the formula itself

viewer::ViewFacts view_facts();

/// Row `tick` of the session, at 1 kHz. Down from 30 nm to 3 nm deep within 2 s, then round a circle of
/// 60 nm radius about (300, 300) in contact, once in 8 s.
recording::Sample view_sample(std::int64_t tick);

}  // namespace telenano::support
