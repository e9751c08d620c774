#pragma once

#include <optional>
#include <vector>

#include "telenano/nve_server/fit/fit_minimum.h"
#include "telenano/nve_server/fit/fit_problem.h"
#include "telenano/nve_server/fit/fit_search.h"

namespace telenano::fit {

/// How well a minimum is known: noise, intervals, correlations, and what errors of the calibration do. All arguments must
/// outlive it.
class FitUncertainty {
 public:
  FitUncertainty(const PreparedCurve& curve, const FitSetup& setup, FitProblem& problem, FitSearch& search,
                 const Minimum& minimum);

  double cost() const { return cost_; }  ///< at the minimum
  const std::vector<char>& used() const { return used_; }
  double reduced() const { return reduced_; }                    ///< as CurveFit
  double left_correlation() const { return left_correlation_; }  ///< likewise
  const Matrix& normal() const { return normal_; }

  /// Of parameter `i`, a logarithm.
  Estimate estimate(int i, const char* name, const char* unit, double to_unit);
  std::vector<std::vector<double>> correlation(const std::vector<int>& shown) const;

 private:
  void sum_up(Eigen::Index parameters);
  Vector moved(const Vector& change) const;
  Vector moved_by(const FitSetup& other) const;
  Vector moved_by_scale() const;
  void find_interval(int i, double error, std::optional<double>& low, std::optional<double>& high);

  const PreparedCurve& curve_;
  const FitSetup& setup_;
  FitProblem& problem_;
  FitSearch& search_;
  const Found& best_;
  double cost_ = 1e300;
  std::vector<char> used_;
  Vector residual_, weight_;
  Matrix jacobian_, normal_, covariance_;
  double reduced_ = 0;
  double left_correlation_ = 0;
  Vector by_stiffness_, by_radius_, by_invols_;
  double rise_ = 0;  // of the cost, to where an interval ends
  std::vector<Found> valleys_;
};

}  // namespace telenano::fit
