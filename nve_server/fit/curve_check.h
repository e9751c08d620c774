#pragma once

#include <string>
#include <vector>

#include "telenano/nve_server/fit/prepared_curve.h"

/// What a fit would read as something else. A curve is one approach from away from the sample into contact and one
/// retract back out of contact, each without a stop. Each function says what is not so, in one line without the
/// file's name; empty: nothing found.
namespace telenano::fit {

/// Of the heights in time: a way that is missing or turns, a pause before the last and after the first point.
/// Approach and retract may differ in speed; a base may slow down towards its turn (a sine), but not stop.
std::string wrong_motion(const std::vector<double>& approach_z_nm, const std::vector<double>& retract_z_nm);

/// Of a curve with signs, leaps, baselines and noise: a detector that clips, a far part that is in contact, a
/// deflection that grows faster than the base moves.
std::string wrong_deflection(const PreparedCurve& curve);

}  // namespace telenano::fit
