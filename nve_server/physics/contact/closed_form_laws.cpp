#include "telenano/nve_server/physics/contact/closed_form_laws.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"

namespace telenano::physics {
namespace {

double power(double base, double exponent) noexcept {
  return det_exp(exponent * det_log(base));
}

ClosedFormCoefficients schwarz(double square) noexcept {
  const double t = std::sqrt(square);
  const double root6 = std::sqrt(6.0);
  return {1.0, 0.5 * root6 * t, 2.0 - 0.5 * square, (2.0 / 3.0) * root6 * t, 1.0};
}

/// Load and radius by the pair (alpha, L, A0), overlap by the fits of PT.
ClosedFormCoefficients pietrement_troyon(double alpha, double pull_off, double a0) noexcept {
  const double beta = alpha * (0.429 + alpha * (0.235 + alpha * (-0.683 + alpha * 0.516)));
  const double log_alpha = det_log(alpha);
  const double fit = -2.160 * det_exp(0.019 * log_alpha) + 2.7531 * det_exp(0.064 * log_alpha) +
                     0.073 * det_exp(1.919 * log_alpha);
  // dDelta/dg = 0 at g^((4 - 2 beta)/3) = S beta/2, dP/dg = 0 at g = alpha/(1 + alpha).
  const double limit = 2.0 / beta * power(alpha / (1.0 + alpha), (4.0 - 2.0 * beta) / 3.0);
  const double s = std::clamp(fit, 0.0, limit);
  const double sum = 1.0 + alpha;
  return {pull_off * sum * sum / (a0 * a0 * a0), alpha * std::sqrt(pull_off), pull_off,
          s * power(a0, 2.0 - beta), 2.0 * beta};
}

}  // namespace

ClosedFormCoefficients closed_form_coefficients(ContactLaw model, double lambda) noexcept {
  switch (model) {
    case ContactLaw::kHertz:
      return {};
    case ContactLaw::kDmt:
      return {1.0, 0.0, 2.0, 0.0, 1.0};
    case ContactLaw::kSchwarz: {
      const double x = 4.04 * power(lambda, 1.4);
      return schwarz(x < 1e300 ? x / (1.0 + x) : 1.0);
    }
    case ContactLaw::kCarpickOgletreeSalmeron:
    case ContactLaw::kPietrementTroyon: {
      // 1 - exp(-x) is x for the smallest lambda, where the difference would lose digits.
      const double x = lambda / 0.924;
      const double alpha = (x < 1e-5 ? x * (1.0 - 0.5 * x) : 1.0 - det_exp(-x)) / 1.02;
      if (model == ContactLaw::kPietrementTroyon) {
        return pietrement_troyon(
            alpha, 2.000 + alpha * (-0.767 + alpha * 0.267),
            1.264 + alpha * (0.950 + alpha * (-1.365 + alpha * (1.417 - alpha * 0.451))));
      }
      const double u = 4.04 * power(lambda, 1.4);
      const double v = 2.28 * power(lambda, 1.3);
      return pietrement_troyon(alpha, 1.5 + 0.5 / (1.0 + u), 1.54 + 0.279 * (1.0 - 2.0 / (1.0 + v)));
    }
    case ContactLaw::kJkr:
    case ContactLaw::kMaugisDugdale:
      break;
  }
  return schwarz(1.0);
}

}  // namespace telenano::physics
