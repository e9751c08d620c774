// Closed forms in place of the exact law: their error is the model's, not the computer's.
#include <algorithm>
#include <cmath>

#include "tests/studies/precision/law_methods.h"

namespace telenano::studies {
namespace {

/// P = Delta^1.5 - offset.
class PowerLaw final : public LawMethod {
 public:
  explicit PowerLaw(double offset) : offset_(offset) {}
  void run(std::span<const double> overlaps, double* loads) override {
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      const double d = std::max(0.0, overlaps[i]);
      loads[i] = overlaps[i] > 0 ? d * std::sqrt(d) - offset_ : -offset_;
    }
  }

 private:
  double offset_;
};

/// Delta = A^2 - (2/3) sqrt(6A), P = A^3 - A sqrt(6A). With A = s^2: s^4 - b s - Delta = 0, b = (2/3) sqrt 6,
/// by Ferrari's resolvent m^3 + 4 Delta m = b^2, the larger real root.
class Jkr final : public LawMethod {
 public:
  void run(std::span<const double> overlaps, double* loads) override {
    const double b = 2.0 / 3.0 * std::sqrt(6.0);
    // s^4 - b s - Delta has a double root at s = (b/4)^(1/3): the fold under displacement control.
    const double s_fold = std::cbrt(b / 4);
    const double fold = -3 * s_fold * s_fold * s_fold * s_fold;
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      const double d = std::max(overlaps[i], fold);
      const double p = 4 * d / 3;
      const double half = b * b / 2;
      const double root = std::sqrt(std::max(0.0, half * half + p * p * p));
      const double up = std::cbrt(half + root);
      // The other cube root by the product, which does not cancel: up * down = -p.
      const double m = up - p / up;
      const double n = std::sqrt(m);
      const double s = 0.5 * (n + std::sqrt(std::max(0.0, 2 * b / n - m)));
      const double a = s * s;
      loads[i] = a * a * a - a * s * std::sqrt(6.0);
    }
  }
};

}  // namespace

std::vector<LawMethodEntry> closed_law_methods() {
  const std::string family = "closed forms (model error)";
  return {{family, "Hertz", false, [](double) { return std::make_unique<PowerLaw>(0.0); }, false},
          {family, "DMT", false, [](double) { return std::make_unique<PowerLaw>(2.0); }, false},
          {family, "JKR", false, [](double) { return std::make_unique<Jkr>(); }, false}};
}

}  // namespace telenano::studies
