#pragma once

#include <string>
#include <vector>

#include "telenano/nve_server/app/sample/fit_options.h"

namespace telenano::scene {
struct Scene;
}

namespace telenano::app {

/// On stdout, for a person.
void print_one(const FittedCurve& curve);

/// A line of estimates a curve.
std::string csv_table(const std::vector<FittedCurve>& curves);

/// FittedCurve, model and residual, point by point.
std::string csv_residuals(const std::vector<FittedCurve>& curves);

void draw(const FittedCurve& curve, const std::string& file);

/// Of the curves that were fitted; the middle one's logarithm, or between the two middle ones.
double median_of(const std::vector<FittedCurve>& curves, double fit::CurveFit::*what);

/// The scene's text with what was found. Throws UserError where it cannot be edited.
std::string fitted_text(const FitOptions& options, const scene::Scene& scene, const fit::FitSetup& setup,
                        const std::vector<FittedCurve>& curves);

}  // namespace telenano::app
