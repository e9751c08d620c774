// Tables over s = sqrt(Delta - Delta_start), Delta_start the fold if it lies in contact, the onset if not: in
// s the force is analytic there, in Delta it has a square root. Filled from the product's curve; what is
// measured is the interpolation.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/contact/maugis_dugdale.h"
#include "tests/studies/precision/law_methods.h"

namespace telenano::studies {
namespace {

using physics::CurvePoint;
using physics::Held;
using physics::MaugisDugdale;

constexpr Held kOverlapHeld{1.0, 0.0};

/// Where the table begins, and the force and its slope in s there and above.
struct Source {
  explicit Source(double lambda) : curve(lambda) {
    before_contact = curve.q() < curve.onset_radius();
    first = before_contact ? curve.contact(0) : curve.fold(kOverlapHeld);
    start = first.overlap;
    longest = std::sqrt(kTableOverlap - start);
  }
  /// P and dP/ds at s.
  std::pair<double, double> at(double s) const {
    if (s == 0) {
      if (before_contact) return {first.load, 0.0};
      // Delta - Delta_fold = Delta'' du^2/2, so that dP/ds = P'/sqrt(Delta''/2).
      const double h = 1e-5 * first.parameter;
      const double second = (curve.contact(first.parameter + h).overlap_rate -
                             curve.contact(first.parameter - h).overlap_rate) /
                            (2 * h);
      return {first.load, first.load_rate / std::sqrt(0.5 * second)};
    }
    const CurvePoint p = curve.solve(start + s * s, kOverlapHeld).point;
    return {p.load, p.load_rate / p.overlap_rate * 2 * s};
  }
  bool holds_before(double overlap) const { return before_contact && overlap < start; }

  MaugisDugdale curve;
  CurvePoint first;
  bool before_contact = false;
  double start = 0;
  double longest = 0;
};

class HermiteTable final : public LawMethod {
 public:
  HermiteTable(double lambda, int cells) : source_(lambda), cells_(cells), inverse_(cells / source_.longest) {
    const double h = source_.longest / cells;
    for (int i = 0; i <= cells; ++i) nodes_.push_back(source_.at(h * i));
    for (auto& [load, slope] : nodes_) slope *= h;
  }

  void run(std::span<const double> overlaps, double* loads) override {
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      if (source_.holds_before(overlaps[i])) {
        loads[i] = source_.curve.solve(overlaps[i], kOverlapHeld).point.load;
        continue;
      }
      const double x = std::sqrt(std::max(0.0, overlaps[i] - source_.start)) * inverse_;
      const int cell = std::min(static_cast<int>(x), cells_ - 1);
      const double t = x - cell;
      const auto& [p0, d0] = nodes_[static_cast<std::size_t>(cell)];
      const auto& [p1, d1] = nodes_[static_cast<std::size_t>(cell) + 1];
      const double rise = p1 - p0;
      loads[i] = p0 + t * (d0 + t * ((3 * rise - 2 * d0 - d1) + t * (d0 + d1 - 2 * rise)));
    }
  }

 private:
  Source source_;
  int cells_;
  double inverse_;
  std::vector<std::pair<double, double>> nodes_;
};

class ChebyshevSeries final : public LawMethod {
 public:
  ChebyshevSeries(double lambda, int terms)
      : source_(lambda), coefficients_(static_cast<std::size_t>(terms)) {
    std::vector<double> values;
    for (int k = 0; k < terms; ++k) {
      values.push_back(source_.at(0.5 * source_.longest * (1 + std::cos(M_PI * (k + 0.5) / terms))).first);
    }
    for (int j = 0; j < terms; ++j) {
      double sum = 0;
      for (int k = 0; k < terms; ++k)
        sum += values[static_cast<std::size_t>(k)] * std::cos(M_PI * j * (k + 0.5) / terms);
      coefficients_[static_cast<std::size_t>(j)] = (j == 0 ? 1.0 : 2.0) * sum / terms;
    }
  }

  void run(std::span<const double> overlaps, double* loads) override {
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      if (source_.holds_before(overlaps[i])) {
        loads[i] = source_.curve.solve(overlaps[i], kOverlapHeld).point.load;
        continue;
      }
      const double x = 2 * std::sqrt(std::max(0.0, overlaps[i] - source_.start)) / source_.longest - 1;
      double b1 = 0;
      double b2 = 0;
      for (std::size_t j = coefficients_.size(); j-- > 1;) {  // Clenshaw
        const double b = 2 * x * b1 - b2 + coefficients_[j];
        b2 = b1;
        b1 = b;
      }
      loads[i] = x * b1 - b2 + coefficients_[0];
    }
  }

 private:
  Source source_;
  std::vector<double> coefficients_;
};

}  // namespace

std::vector<LawMethodEntry> table_law_methods() {
  std::vector<LawMethodEntry> entries;
  for (const int n : {32, 128, 512, 2048}) {
    entries.push_back({"Hermite table in sqrt(Delta)", "N = " + std::to_string(n), false,
                       [n](double lambda) { return std::make_unique<HermiteTable>(lambda, n); }});
  }
  for (const int n : {8, 16, 32, 64}) {
    entries.push_back({"Chebyshev in sqrt(Delta)", "n = " + std::to_string(n), false,
                       [n](double lambda) { return std::make_unique<ChebyshevSeries>(lambda, n); }});
  }
  return entries;
}

}  // namespace telenano::studies
