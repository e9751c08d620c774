#pragma once

#include "telenano/nve_server/fit/prepared_curve.h"

namespace telenano::fit {

/// The base moves as it is driven, a ramp or a sine's half; the deflection rests, leaps and bends. True where it is the
/// other way round on both ways: the file's columns look exchanged.
bool columns_look_exchanged(const PreparedCurve& curve);

}  // namespace telenano::fit
