#include "telenano/nve_server/fit/fit_uncertainty.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "telenano/common/base/det_math.h"

namespace telenano::fit {
namespace {

constexpr double kQuantile = 3.841458820694124;  // χ² of one degree of freedom, 95 %

}  // namespace

FitUncertainty::FitUncertainty(const PreparedCurve& curve, const FitSetup& setup, FitProblem& problem,
                               FitSearch& search, const Minimum& minimum)
    : curve_(curve), setup_(setup), problem_(problem), search_(search), best_(minimum.best) {
  search.evaluate(best_.p, cost_);
  used_ = search.used();
  residual_ = search.residual();
  search.jacobian(best_.p, used_, residual_, jacobian_);
  sum_up(problem.at().count);
  weight_ = weights_of(residual_);
  normal_ = jacobian_.transpose() * weight_.asDiagonal() * jacobian_;
  // By columns of equal size: nm, logarithms and a tilt stand side by side.
  const Vector scale = normal_.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * normal_ * scale.asDiagonal();
  const Matrix inverse = pseudo_inverse(scaled);
  covariance_ = scale.asDiagonal() * inverse * scale.asDiagonal();

  FitSetup stiffer = setup;
  stiffer.compliance_nm_nn /= 1.0 + kLogStep;
  FitSetup wider = setup;
  wider.radius_nm *= 1.0 + kLogStep;
  by_stiffness_ = moved_by(stiffer);
  by_radius_ = moved_by(wider);
  by_invols_ = moved_by_scale();

  rise_ = 0.5 * kQuantile * std::max(reduced_, 1.0);
  valleys_ = apart(minimum.modes, best_, problem.at().laws, rise_);
}

void FitUncertainty::sum_up(Eigen::Index parameters) {
  double sum = 0;
  double count = 0;
  double lagged = 0;
  double squares = 0;
  for (Eigen::Index i = 0; i < residual_.size(); ++i) {
    const double e = std::clamp(residual_[i], -kHuber, kHuber);
    sum += e * e;
    count += used_[static_cast<std::size_t>(i)] != 0 ? 1 : 0;
    squares += e * e;
    if (i > 0) lagged += e * std::clamp(residual_[i - 1], -kHuber, kHuber);
  }
  reduced_ = sum / std::max(count - static_cast<double>(parameters), 1.0);
  left_correlation_ = squares > 0 ? lagged / squares : 0;
}

/// What an error of a calibration does: the fit moves by −(JᵀWJ)⁻¹ JᵀW ∂r.
Vector FitUncertainty::moved(const Vector& change) const {
  return -covariance_ * (jacobian_.transpose() * weight_.cwiseProduct(change));
}

Vector FitUncertainty::moved_by(const FitSetup& other) const {
  FitProblem again(curve_, other);
  Vector r;
  if (!again.residuals(best_.p, used_, r)) return Vector::Zero(problem_.at().count);
  return moved((r - residual_) / kLogStep);
}

/// Of the deflection.
Vector FitUncertainty::moved_by_scale() const {
  std::vector<double> bent[2] = {curve_.approach.deflection_nm, curve_.retract.deflection_nm};
  for (std::size_t segment = 0; segment < 2; ++segment)
    for (double& d : bent[segment]) d -= curve_.offset_nm[segment];
  Vector larger;
  problem_.whiten(bent[0], bent[1], used_, larger);
  return moved(larger);
}

void FitUncertainty::find_interval(int i, double error, std::optional<double>& low,
                                   std::optional<double>& high) {
  low = profile_end(search_, best_, i, -1.0, error, rise_);
  high = profile_end(search_, best_, i, 1.0, error, rise_);
  // Before a step a profile may stop: to the one side it ends no nearer than to the other, if the curvature says so, too.
  if (moves_steps(problem_.at()) && low && high) {
    const double wide = std::min(1.96 * error, std::max(best_.p[i] - *low, *high - best_.p[i]));
    low = std::min(*low, best_.p[i] - wide);
    high = std::max(*high, best_.p[i] + wide);
  }
  for (const Found& valley : valleys_) {
    const double left = rise_ - (valley.cost - best_.cost);
    if (low && valley.p[i] < *low) low = profile_end(search_, valley, i, -1.0, error, left);
    if (high && valley.p[i] > *high) high = profile_end(search_, valley, i, 1.0, error, left);
  }
}

Estimate FitUncertainty::estimate(int i, const char* name, const char* unit, double to_unit) {
  Estimate e;
  e.name = name;
  e.unit = unit;
  e.value = to_unit * det_exp(best_.p[i]);
  const double error = std::sqrt(std::max(covariance_(i, i), 0.0) * std::max(reduced_, 1.0));
  std::optional<double> low, high;
  find_interval(i, error, low, high);
  if (low) e.low = to_unit * det_exp(*low);
  if (high) e.high = to_unit * det_exp(*high);
  e.sensitivity_stiffness = by_stiffness_[i];
  e.sensitivity_invols = by_invols_[i];
  e.sensitivity_radius = problem_.at().radius < 0 ? by_radius_[i] : 0.0;
  // The lever's own error is independent of the curve's noise: their squares add.
  const double of_lever = 1.96 * std::abs(e.sensitivity_stiffness) * setup_.stiffness_error;
  const auto widened = [&](std::optional<double>& end) {
    if (!end || !(of_lever > 0)) return;
    const double way = *end < e.value ? -1.0 : 1.0;
    end = e.value * det_exp(way * std::hypot(det_log(*end / e.value), of_lever));
  };
  widened(e.low);
  widened(e.high);
  return e;
}

std::vector<std::vector<double>> FitUncertainty::correlation(const std::vector<int>& shown) const {
  std::vector<std::vector<double>> rows;
  for (const int a : shown) {
    std::vector<double> row;
    for (const int b : shown) {
      const double product = std::sqrt(covariance_(a, a) * covariance_(b, b));
      row.push_back(product > 0 ? covariance_(a, b) / product : 0.0);
    }
    rows.push_back(row);
  }
  return rows;
}

}  // namespace telenano::fit
