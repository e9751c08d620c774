#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "telenano/nve_server/fit/fit_problem.h"

namespace telenano::fit {

inline constexpr double kHuber = 3.0;     // standard deviations
inline constexpr double kLogStep = 1e-4;  // of a logarithm: well above the path's own 1e-8

/// Of Huber's loss in least squares. A leap's place is not to be an outlier: it is what holds the points on
/// their sides.
Vector weights_of(const Vector& r);

struct Bounds {
  Vector low;
  Vector high;
};

struct Found {
  Vector p;
  double cost = 1e300;
  bool good = false;
};

/// Levenberg and Marquardt's descent within bounds.
class FitSearch {
 public:
  FitSearch(FitProblem& problem, Bounds bounds) : problem_(problem), bounds_(std::move(bounds)) {}

  bool evaluate(const Vector& p, double& cost);

  /// By differences, at fixed `used`.
  bool jacobian(const Vector& p, const std::vector<char>& used, const Vector& residual, Matrix& jacobian);

  /// `fixed` (−1: none) stays as it is.
  Found descend(const Vector& start, int iterations, int fixed = -1);

  bool at_end_of_others(const Vector& p) const { return problem_.at_end_of_others(p); }
  const std::vector<char>& used() const { return used_; }
  const Vector& residual() const { return residual_; }
  const Bounds& bounds() const { return bounds_; }

 private:
  FitProblem& problem_;
  Bounds bounds_;
  std::vector<char> used_;
  Vector residual_;
};

/// Where the profile of parameter `i` has risen by `rise`, from the best fit in direction `way`.
std::optional<double> profile_end(FitSearch& search, const Found& best, int i, double way, double error,
                                  double rise);

/// Those of `modes` that are inside of `rise` above the best, each at other laws than the ones before.
std::vector<Found> apart(std::vector<Found> modes, const Found& best, int laws, double rise);

}  // namespace telenano::fit
