#include <cmath>

#include "telenano/nve_server/physics/contact/maugis_dugdale.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/studies/precision/law_methods.h"

namespace telenano::studies {
namespace {

using physics::ContactLaw;
using physics::CurvePoint;
using physics::Held;
using physics::MaugisDugdale;
using physics::MaugisMethod;

constexpr Held kOverlapHeld{1.0, 0.0};

/// What the loop calls: branches, energy, stiffness and units included.
class WholeLaw final : public LawMethod {
 public:
  WholeLaw(double lambda, ContactLaw model, MaugisMethod method)
      : law_(parameters(lambda, model, method), kRadius), scales_(law_.scales(kRadius)) {}

  void run(std::span<const double> overlaps, double* loads) override {
    physics::TipSampleState state;
    // From deep contact, so that the branch inside is the one that is followed down to the fold.
    law_.advance(5 * scales_.overlap_nm, 0.0, kRadius, state);
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      const auto e = law_.advance(overlaps[i] * scales_.overlap_nm, 0.0, kRadius, state);
      loads[i] = e.status == physics::SolveStatus::kOk ? e.force_nn / scales_.force_nn : NAN;
    }
  }

 private:
  static constexpr double kRadius = 20;

  // w = 0.1 N/m and the modulus that gives lambda: lambda = (2/pi) (sigma0/w) u_delta.
  static physics::TipSampleParameters parameters(double lambda, ContactLaw model, MaugisMethod method) {
    physics::TipSampleParameters p;
    p.work_of_adhesion_n_m = 0.1;
    p.van_der_waals = false;
    p.model = model;
    p.method = method;
    const double u_delta = lambda * M_PI / 2 * p.equilibrium_distance_nm * 9 * std::sqrt(3.0) / 16;
    p.contact_modulus_gpa = M_PI * 0.1 * std::sqrt(kRadius / (u_delta * u_delta * u_delta));
    return p;
  }

  physics::TipSampleLaw law_;
  physics::ContactScales scales_;
};

LawMethodEntry whole_law(std::string family, std::string setting, ContactLaw model,
                         MaugisMethod method = MaugisMethod::kDirect) {
  const bool is_default = model == ContactLaw::kMaugisDugdale && method == MaugisMethod::kDirect;
  return {std::move(family), std::move(setting), is_default,
          [=](double lambda) { return std::make_unique<WholeLaw>(lambda, model, method); },
          model == ContactLaw::kMaugisDugdale};
}

/// The curve's own solver; `warm` starts from the last point's parameter.
class CurveSolve final : public LawMethod {
 public:
  CurveSolve(double lambda, bool warm) : curve_(lambda), warm_(warm) {}

  void run(std::span<const double> overlaps, double* loads) override {
    double guess = 0;
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      const physics::CurveSolution s = curve_.solve(overlaps[i], kOverlapHeld, guess);
      loads[i] = s.status == physics::CurveStatus::kOk ? s.point.load : NAN;
      if (warm_) guess = s.point.contact ? s.point.parameter : 0;
    }
  }

 private:
  MaugisDugdale curve_;
  bool warm_;
};

/// The product's parameter u = cot^2 theta, cut off after n steps of Newton.
class NewtonInU final : public LawMethod {
 public:
  NewtonInU(double lambda, int steps) : curve_(lambda), steps_(steps) {}

  void run(std::span<const double> overlaps, double* loads) override {
    double u = curve_.solve(overlaps[0], kOverlapHeld).point.parameter;
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      const double overlap = overlaps[i];
      if (overlap < curve_.onset_overlap() && curve_.q() < curve_.onset_radius()) {
        loads[i] = curve_.solve(overlap, kOverlapHeld).point.load;
        u = 0;
        continue;
      }
      CurvePoint p = curve_.contact(u);
      for (int k = 1; k < steps_; ++k) {
        u = std::max(0.0, u + (overlap - p.overlap) / p.overlap_rate);
        p = curve_.contact(u);
      }
      p.shift((overlap - p.overlap) / p.overlap_rate);
      u = std::max(0.0, p.parameter);
      loads[i] = p.load;
    }
  }

 private:
  MaugisDugdale curve_;
  int steps_;
};

}  // namespace

std::vector<LawMethodEntry> product_law_methods() {
  std::vector<LawMethodEntry> entries;
  entries.push_back(whole_law("MD direct, the loop's call", "warm, to rounding", ContactLaw::kMaugisDugdale));
  entries.push_back(whole_law("MD table, the loop's call", "32 cells an octave", ContactLaw::kMaugisDugdale,
                              MaugisMethod::kTable));
  const std::string others = "other laws, the loop's call";
  entries.push_back(whole_law(others, "Hertz", ContactLaw::kHertz));
  entries.push_back(whole_law(others, "DMT", ContactLaw::kDmt));
  entries.push_back(whole_law(others, "JKR", ContactLaw::kJkr));
  entries.push_back(whole_law(others, "COS", ContactLaw::kCarpickOgletreeSalmeron));
  entries.push_back(whole_law(others, "Piétrement–Troyon", ContactLaw::kPietrementTroyon));
  entries.push_back(whole_law(others, "Schwarz", ContactLaw::kSchwarz));
  entries.push_back({"MD curve alone, warm", "to rounding", false,
                     [](double l) { return std::make_unique<CurveSolve>(l, true); }});
  entries.push_back({"MD curve alone, cold", "to rounding", false,
                     [](double l) { return std::make_unique<CurveSolve>(l, false); }});
  for (const int n : {1, 2, 3, 4}) {
    entries.push_back({"Newton on u, n steps, warm", "n = " + std::to_string(n), false,
                       [n](double l) { return std::make_unique<NewtonInU>(l, n); }});
  }
  return entries;
}

std::vector<LawMethodEntry> law_methods() {
  std::vector<LawMethodEntry> all;
  for (auto* kind : {product_law_methods, iterative_law_methods, table_law_methods, closed_law_methods}) {
    for (LawMethodEntry& entry : kind()) all.push_back(std::move(entry));
  }
  return all;
}

}  // namespace telenano::studies
