#pragma once

#include <string>
#include <vector>

#include "telenano/nve_server/fit/fit_problem.h"

namespace telenano::fit {

/// Of the logarithms of `shown` the combination that the curve tells best, whatever the others are: the direction
/// of the most information after touch and baselines have taken theirs.
std::string best_known(const Matrix& normal, const std::vector<int>& shown,
                       const std::vector<Estimate>& names, double reduced);

/// What a curve cannot tell, in the fit's notes.
void say_what_is_not_known(CurveFit& fit, const PreparedCurve& curve, const FitSetup& setup);

}  // namespace telenano::fit
