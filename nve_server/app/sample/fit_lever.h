#pragma once

#include <optional>
#include <string>

#include "telenano/nve_server/app/sample/fit_options.h"

namespace telenano::scene {
struct Scene;
}

namespace telenano::app {

/// The lever's stiffness along z as it was measured, and its relative standard deviation.
struct MeasuredLever {
  double stiffness_n_m = 0;
  double error = 0;
  std::string how;  // for a person
};

/// By --thermal, --reference-curve, or none of them. Throws UserError.
std::optional<MeasuredLever> measured_lever(const FitOptions& options);

/// How a file's deflection becomes nanometres. Throws UserError.
fit::Preparation preparation_of(const FitOptions& options, double stiffness_n_m);

/// What is known of lever, tip and law, and what is looked for. Throws UserError.
fit::FitSetup setup_of(const FitOptions& options, const scene::Scene& scene,
                       const std::optional<MeasuredLever>& lever);

/// "32x32", "500:250.5": two numbers.
bool two_numbers(const std::string& text, double& first, double& second, char between = 'x');

}  // namespace telenano::app
