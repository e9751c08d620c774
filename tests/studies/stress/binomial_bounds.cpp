#include "tests/studies/stress/binomial_bounds.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace telenano::studies::stress {

double binomial_upper(std::size_t hits, std::size_t trials, double confidence) {
  if (hits >= trials) return 1;
  const auto n = static_cast<double>(trials);
  // Logarithms: the coefficients of 30 000 trials are far beyond a double.
  std::vector<double> log_coefficients;
  log_coefficients.reserve(hits + 1);
  double log_coefficient = 0;
  for (std::size_t i = 0; i <= hits; ++i) {
    log_coefficients.push_back(log_coefficient);
    const auto k = static_cast<double>(i);
    log_coefficient += std::log((n - k) / (k + 1));
  }
  const auto at_most_hits = [&](double p) {
    const double log_p = std::log(p), log_q = std::log1p(-p);
    double sum = 0;
    for (std::size_t i = 0; i <= hits; ++i) {
      const auto k = static_cast<double>(i);
      sum += std::exp(log_coefficients[i] + k * log_p + (n - k) * log_q);
    }
    return sum;
  };
  // The probability falls as p grows. Halved until the two ends are neighbours: the upper one is returned, so
  // that rounding never promises too much.
  double low = static_cast<double>(hits) / n, high = 1;
  for (;;) {
    const double middle = low + (high - low) / 2;
    if (middle <= low || middle >= high) return high;
    (at_most_hits(middle) > 1 - confidence ? low : high) = middle;
  }
}

double binomial_lower(std::size_t hits, std::size_t trials, double confidence) {
  if (hits == 0) return 0;
  return std::max(0.0, 1 - binomial_upper(trials - hits, trials, confidence));
}

}  // namespace telenano::studies::stress
