// Textbook ways through Maugis' equations, to compare with: written from the paper, sharing nothing with the
// product. Before contact the closed form is used by all of them.
#include <algorithm>
#include <cmath>

#include "tests/studies/precision/law_methods.h"

namespace telenano::studies {
namespace {

/// Non-contact Dugdale branch: P = -(pi/2) lambda C^2, C = q + sqrt(q^2 + 2 (Delta + H0)).
struct BeforeContact {
  explicit BeforeContact(double lambda)
      : lambda_(lambda), q(8 * lambda / (3 * M_PI)), h0(2 / (M_PI * lambda)) {
    // (pi/4) lambda C0^2 + (4/3)(pi/2 - 1) lambda^2 C0 = 1
    const double a = M_PI * lambda / 4;
    const double b = 4.0 / 3.0 * (M_PI / 2 - 1) * lambda * lambda;
    const double c0 = 2 / (b + std::sqrt(b * b + 4 * a));
    onset = c0 * c0 / 2 - q * c0 - h0;
    exists = q < c0;
  }
  bool holds(double overlap) const { return exists && overlap < onset; }
  double load(double overlap) const {
    const double c = q + std::sqrt(std::max(0.0, q * q + 2 * (overlap + h0)));
    return -M_PI / 2 * lambda_ * c * c;
  }

  double lambda_, q, h0;
  double onset = 0;
  bool exists = false;
};

/// A point and dDelta/d(parameter).
struct Trial {
  double a = 0, load = 0, overlap = 0, rate = 0, load_rate = 0;
};

Trial at_m(double lambda, double m) {
  const double r = std::sqrt(m * m - 1);
  const double arc = std::atan(r);
  const double alpha = lambda / 2 * (r + (m * m - 2) * arc);
  const double beta = 4.0 / 3.0 * lambda * lambda * (r * arc - m + 1);
  const double alpha_rate = lambda * (r / m + m * arc);
  const double beta_rate = 4.0 / 3.0 * lambda * lambda * (m / r * arc + 1 / m - 1);
  Trial t;
  t.a = 2 / (beta + std::sqrt(beta * beta + 4 * alpha));
  const double a_rate = -(alpha_rate * t.a * t.a + beta_rate * t.a) / (2 * alpha * t.a + beta);
  t.load = t.a * t.a * t.a - lambda * t.a * t.a * (r + m * m * arc);
  t.overlap = t.a * t.a - 4.0 / 3.0 * lambda * t.a * r;
  t.rate = 2 * t.a * a_rate - 4.0 / 3.0 * lambda * (a_rate * r + t.a * m / r);
  return t;
}

Trial at_theta(double lambda, double theta) {
  const double s = std::sin(theta);
  const double k = std::cos(theta);
  const double y = theta * theta;
  double f1 = 0.5 * std::sin(2 * theta) - theta * std::cos(2 * theta);
  double f2 = theta * s - 1 + k;
  if (theta < 0.35) {
    const double x2 = 4 * y;
    f1 = 0.5 * 2 * theta * x2 *
         (1.0 / 3 -
          x2 * (1.0 / 30 - x2 * (1.0 / 840 - x2 * (1.0 / 45360 - x2 * (1.0 / 3991680 - x2 / 518918400)))));
    f2 = y * (0.5 - y * (0.125 - y * (1.0 / 144 - y * (1.0 / 5760 - y / 403200))));
  }
  const double f1_rate = 2 * theta * std::sin(2 * theta);
  const double f2_rate = theta * k;
  const double third = 4.0 / 3.0 * lambda;
  const double b = third * lambda * f2;
  const double c = 2 / (b + std::sqrt(b * b + 2 * lambda * f1));
  const double c_rate =
      -(lambda / 2 * f1_rate * c * c + third * lambda * f2_rate * c) / (lambda * f1 * c + b);
  Trial t;
  t.a = c * k;
  t.load = t.a * t.a * t.a - lambda * c * c * (theta + s * k);
  t.overlap = t.a * t.a - third * c * s;
  const double a_rate = c_rate * k - c * s;
  t.rate = 2 * t.a * a_rate - third * (c_rate * s + c * k);
  t.load_rate = 3 * t.a * t.a * a_rate - 2 * lambda * c * (c_rate * (theta + s * k) + c * k * k);
  return t;
}

/// Plain Newton on a parameter between two limits; warm, or from the large-lambda estimate each time.
class PlainNewton final : public LawMethod {
 public:
  enum class In { kM, kTheta };
  PlainNewton(double lambda, In in, int steps, bool warm)
      : lambda_(lambda), before_(lambda), in_(in), steps_(steps), warm_(warm) {}

  void run(std::span<const double> overlaps, double* loads) override {
    double x = start(overlaps[0]);
    // The first point to convergence as far as the method can: what is compared is the work from step to
    // step.
    if (warm_) x = iterate(overlaps[0], x, 60).first;
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      if (before_.holds(overlaps[i])) {
        loads[i] = before_.load(overlaps[i]);
        x = start(overlaps[i]);
        continue;
      }
      if (!warm_ || !std::isfinite(x)) x = start(overlaps[i]);
      const auto [next, load] = iterate(overlaps[i], x, steps_);
      x = next;
      loads[i] = load;
    }
  }

 private:
  Trial at(double x) const { return in_ == In::kM ? at_m(lambda_, x) : at_theta(lambda_, x); }

  // theta ~ sqrt(3/(2A))/lambda at large lambda, at most 1.3; m = 1/cos theta.
  double start(double overlap) const {
    const double a = 1 + std::sqrt(std::max(0.0, overlap));
    const double theta = std::min(1.3, std::sqrt(1.5 / a) / lambda_);
    return in_ == In::kTheta ? theta : 1 / std::cos(theta);
  }

  /// n evaluations; the last correction is applied to first order, so that n = 1 costs one evaluation.
  std::pair<double, double> iterate(double overlap, double x, int steps) const {
    Trial t;
    for (int k = 0; k < steps; ++k) {
      t = at(x);
      const double last = x;
      x += (overlap - t.overlap) / t.rate;
      if (in_ == In::kTheta) {
        x = std::clamp(x, 0.5 * last, 0.5 * (last + M_PI / 2));
      } else if (!(x > 1)) {
        x = 0.5 * (1 + last);
      }
      if (x == last) break;
    }
    t = at(x);
    return {x, t.load};
  }

  double lambda_;
  BeforeContact before_;
  In in_;
  int steps_;
  bool warm_;
};

/// Bisection of the overlap in log(m - 1), and for each m bisection of Maugis' equation in A.
class NestedBisection final : public LawMethod {
 public:
  NestedBisection(double lambda, int steps) : lambda_(lambda), before_(lambda), steps_(steps) {
    // The fold is the minimum of the overlap, and bisection needs the monotone side: the lowest of a scan,
    // then golden section around it.
    const auto overlap = [&](double log_t) {
      const double t = std::exp(log_t);
      const double r = std::sqrt(t * (2 + t));
      const double arc = std::atan(r);
      const double alpha = lambda_ / 2 * (r + ((1 + t) * (1 + t) - 2) * arc);
      const double beta = 4.0 / 3.0 * lambda_ * lambda_ * (r * arc - t);
      const double a = 2 / (beta + std::sqrt(beta * beta + 4 * alpha));
      return a * a - 4.0 / 3.0 * lambda_ * a * r;
    };
    double lowest = 0;
    double least = HUGE_VAL;
    for (double x = -35; x <= 14; x += 0.1) {
      if (overlap(x) >= least) continue;
      least = overlap(x);
      lowest = x;
    }
    double low = lowest - 0.1;
    double high = lowest + 0.1;
    const double ratio = 0.5 * (std::sqrt(5.0) - 1);
    for (int i = 0; i < 60; ++i) {
      const double x1 = high - ratio * (high - low);
      const double x2 = low + ratio * (high - low);
      (overlap(x1) < overlap(x2) ? high : low) = overlap(x1) < overlap(x2) ? x2 : x1;
    }
    fold_ = std::exp(0.5 * (low + high));
  }

  void run(std::span<const double> overlaps, double* loads) override {
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      if (before_.holds(overlaps[i])) {
        loads[i] = before_.load(overlaps[i]);
        continue;
      }
      double low = -35;
      double high = std::log(fold_);
      for (int k = 0; k < steps_; ++k) {
        const double mid = 0.5 * (low + high);
        (outer(std::exp(mid)).second > overlaps[i] ? low : high) = mid;
      }
      loads[i] = outer(std::exp(0.5 * (low + high))).first;
    }
  }

 private:
  /// Load and overlap at m = 1 + t.
  std::pair<double, double> outer(double t) const {
    const double m = 1 + t;
    const double r = std::sqrt(t * (2 + t));
    const double arc = std::atan(r);
    const double alpha = lambda_ / 2 * (r + (m * m - 2) * arc);
    const double beta = 4.0 / 3.0 * lambda_ * lambda_ * (r * arc - t);
    double low = -40;
    double high = 12;
    for (int k = 0; k < steps_; ++k) {
      const double mid = 0.5 * (low + high);
      const double a = std::exp(mid);
      (alpha * a * a + beta * a < 1 ? low : high) = mid;
    }
    const double a = std::exp(0.5 * (low + high));
    return {a * a * a - lambda_ * a * a * (r + m * m * arc), a * a - 4.0 / 3.0 * lambda_ * a * r};
  }

  double lambda_;
  BeforeContact before_;
  int steps_;
  double fold_ = 1e14;
};

}  // namespace

InContact::State InContact::at(double overlap) {
  if (!(theta_ > 0)) theta_ = lambda_ < 1 ? 1.0 : 0.8 / lambda_;
  Trial t;
  for (int i = 0; i < 60; ++i) {
    t = at_theta(lambda_, theta_);
    const double last = theta_;
    theta_ = std::clamp(last + (overlap - t.overlap) / t.rate, 0.5 * last, 0.5 * (last + M_PI / 2));
    if (std::fabs(theta_ - last) <= 1e-15 * last) break;
  }
  return {t.load, t.load_rate / t.rate};
}

std::vector<LawMethodEntry> iterative_law_methods() {
  using In = PlainNewton::In;
  std::vector<LawMethodEntry> entries;
  const auto add = [&](const char* family, In in, int steps, bool warm) {
    entries.push_back({family, "n = " + std::to_string(steps), false, [=](double lambda) {
                         return std::make_unique<PlainNewton>(lambda, in, steps, warm);
                       }});
  };
  for (const int n : {1, 2, 3, 5}) add("plain Newton on theta, warm", In::kTheta, n, true);
  for (const int n : {5, 10, 20}) add("plain Newton on theta, cold", In::kTheta, n, false);
  for (const int n : {1, 2, 3, 5, 20}) add("plain Newton on m, warm", In::kM, n, true);
  for (const int n : {12, 25, 50}) {
    entries.push_back({"nested bisection", std::to_string(n) + " x " + std::to_string(n), false,
                       [n](double lambda) { return std::make_unique<NestedBisection>(lambda, n); }});
  }
  return entries;
}

}  // namespace telenano::studies
