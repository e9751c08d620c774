#pragma once

#include <vector>

#include "telenano/nve_server/fit/fit_problem.h"
#include "telenano/nve_server/fit/fit_search.h"

namespace telenano::fit {

/// How far each parameter may go.
Bounds bounds_of(const ParameterLayout& at, const FitSetup& setup);

/// The least cost, from several starts.
struct Minimum {
  Found best;                ///< not good: there is no equilibrium from any start
  std::vector<Found> modes;  ///< with humidity or film: other minima, which may be as good
  int starts = 0;
  int starts_agree = 0;  ///< that end within 1 % of the best cost
};
Minimum find_minimum(FitSearch& search, const ParameterLayout& at, const PreparedCurve& curve,
                     const FitSetup& setup);

/// Are steps of the curve moved by a parameter (humidity, film)? No slope leads to them from afar.
inline bool moves_steps(const ParameterLayout& at) {
  return at.humidity >= 0 || at.film >= 0;
}

}  // namespace telenano::fit
