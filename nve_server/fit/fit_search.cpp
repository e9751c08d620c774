#include "telenano/nve_server/fit/fit_search.h"

#include <algorithm>
#include <cmath>

namespace telenano::fit {
namespace {

/// A point that is left out costs what a fitted one does on average: leaving out must not pay.
double cost_of(const Vector& r, const std::vector<char>& used) {
  double cost = 0.5 * static_cast<double>(std::count(used.begin(), used.end(), 0));
  for (Eigen::Index i = 0; i + kLeaps < r.size(); ++i) {
    const double size = std::abs(r[i]);
    cost += size <= kHuber ? 0.5 * size * size : kHuber * (size - 0.5 * kHuber);
  }
  return cost + 0.5 * r.tail(kLeaps).squaredNorm();
}

}  // namespace

Vector weights_of(const Vector& r) {
  Vector weight = Vector::Ones(r.size());
  for (Eigen::Index i = 0; i + kLeaps < r.size(); ++i)
    if (std::abs(r[i]) > kHuber) weight[i] = kHuber / std::abs(r[i]);
  return weight;
}

bool FitSearch::evaluate(const Vector& p, double& cost) {
  problem_.mask(p, used_);
  if (!problem_.residuals(p, used_, residual_)) return false;
  cost = cost_of(residual_, used_);
  return true;
}

bool FitSearch::jacobian(const Vector& p, const std::vector<char>& used, const Vector& residual,
                         Matrix& jacobian) {
  const ParameterLayout& at = problem_.at();
  jacobian.resize(problem_.rows(), at.count);
  Vector moved;
  // What does not change the path first: it is kept.
  for (int pass = 0; pass < 2; ++pass) {
    for (int i = 0; i < at.count; ++i) {
      const bool of_law = i < at.laws;
      if (of_law != (pass == 1)) continue;
      Vector q = p;
      const double step = of_law ? kLogStep : i >= at.offsets + 2 ? 1e-7 : 1e-5;
      q[i] += step;
      if (!problem_.residuals(q, used, moved)) return false;
      jacobian.col(i) = (moved - residual) / step;
    }
  }
  return true;
}

Found FitSearch::descend(const Vector& start, int iterations, int fixed) {
  Found found;
  found.p = start.cwiseMax(bounds_.low).cwiseMin(bounds_.high);
  problem_.keep_distance(found.p, fixed);
  if (!evaluate(found.p, found.cost)) return found;
  found.good = true;
  double damping = 1e-3;
  for (int i = 0; i < iterations; ++i) {
    double at_start = 0;
    if (!evaluate(found.p, at_start)) break;
    const std::vector<char> used = used_;
    const Vector residual = residual_;
    Matrix j;
    if (!jacobian(found.p, used, residual, j)) break;
    const Vector weight = weights_of(residual);
    if (fixed >= 0) j.col(fixed).setZero();
    Matrix normal = j.transpose() * weight.asDiagonal() * j;
    const Vector gradient = j.transpose() * weight.cwiseProduct(residual);
    if (fixed >= 0) normal(fixed, fixed) = 1.0;
    bool better = false;
    double gained = 0;
    for (int k = 0; k < 12 && !better; ++k) {
      Matrix damped = normal;
      damped.diagonal() += damping * normal.diagonal().cwiseMax(1e-12);
      Vector step = -solve_symmetric(damped, gradient);
      if (!step.allFinite()) break;
      for (int law = 0; law < problem_.at().laws; ++law) step[law] = std::clamp(step[law], -1.5, 1.5);
      Vector trial = (found.p + step).cwiseMax(bounds_.low).cwiseMin(bounds_.high);
      problem_.keep_distance(trial, fixed);
      double cost = 0;
      if (evaluate(trial, cost) && cost < found.cost) {
        gained = found.cost - cost;
        found.p = trial;
        found.cost = cost;
        damping = std::max(0.2 * damping, 1e-9);
        better = true;
      } else {
        damping *= 6.0;
      }
    }
    if (!better || gained < 1e-4) break;
  }
  return found;
}

std::optional<double> profile_end(FitSearch& search, const Found& best, int i, double way, double error,
                                  double rise) {
  const double limit = way > 0 ? search.bounds().high[i] : search.bounds().low[i];
  double inside = 0;
  double inside_rise = 0;
  double step = std::clamp(1.96 * error, 1e-7, 2.0);
  Vector p = best.p;
  for (int k = 0; k < 12; ++k) {
    double distance = inside + step;
    const bool at_limit = distance >= std::abs(limit - best.p[i]);
    if (at_limit) distance = std::abs(limit - best.p[i]);
    Vector q = p;
    q[i] = best.p[i] + way * distance;
    const Found found = search.descend(q, 12, i);
    if (search.at_end_of_others(found.p)) return std::nullopt;
    const double risen = found.good ? std::max(found.cost - best.cost, 0.0) : 1e9;
    if (risen >= rise) {
      // Between the two, the root of the rise is nearly a line.
      double low = inside;
      double low_root = std::sqrt(inside_rise);
      double high = distance;
      double high_root = std::sqrt(risen);
      const double aim = std::sqrt(rise);
      for (int h = 0; h < 6; ++h) {
        const double part = std::clamp((aim - low_root) / (high_root - low_root), 0.1, 0.9);
        const double middle = low + part * (high - low);
        q = p;
        q[i] = best.p[i] + way * middle;
        const Found again = search.descend(q, 12, i);
        const double root = again.good ? std::sqrt(std::max(again.cost - best.cost, 0.0)) : 1e4;
        if (std::abs(root - aim) < 0.01 * aim) return best.p[i] + way * middle;
        (root < aim ? low : high) = middle;
        (root < aim ? low_root : high_root) = root;
      }
      const double part = std::clamp((aim - low_root) / (high_root - low_root), 0.0, 1.0);
      return best.p[i] + way * (low + part * (high - low));
    }
    if (at_limit) return std::nullopt;
    p = found.p;
    inside = distance;
    inside_rise = risen;
    // What the rise so far promises, but at most thrice as far.
    const double promised = risen > 0 ? distance * std::sqrt(rise / risen) * 1.1 - distance : 2.0 * distance;
    step = std::clamp(promised, 0.1 * distance, 2.0 * distance);
    // Flat: the curve may have nothing to say, and the way to the limit is long.
    if (risen < 1e-3 * rise) step = std::max(step, 0.3);
  }
  return std::nullopt;
}

std::vector<Found> apart(std::vector<Found> modes, const Found& best, int laws, double rise) {
  std::sort(modes.begin(), modes.end(), [](const Found& a, const Found& b) { return a.cost < b.cost; });
  std::vector<Found> valleys;
  const auto same = [&](const Found& a, const Found& b) {
    return (a.p.head(laws) - b.p.head(laws)).cwiseAbs().maxCoeff() < 0.01;
  };
  for (const Found& mode : modes) {
    if (mode.cost - best.cost >= rise || same(mode, best)) continue;
    if (std::any_of(valleys.begin(), valleys.end(), [&](const Found& v) { return same(v, mode); })) continue;
    valleys.push_back(mode);
  }
  return valleys;
}

}  // namespace telenano::fit
