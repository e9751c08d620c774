#include "tests/studies/coupling/coupling_study.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::studies {
namespace {

CouplingSetup setup_of(CouplingMethod method, double damping_ratio, int iterations = 1) {
  CouplingSetup s;
  s.method = method;
  s.iterations = iterations;
  s.damping_n_s_m = damping_ratio * s.stiffness_n_m * s.dt_s;
  return s;
}

// Closed form of the relaxation on a linear contact after a step of the end: e(t) = e∞ (1 − e^{−t/τ}), τ =
// b/(k_c + K), e∞ = K X/(k_c + K).
TEST(CouplingStudy, ReferenceIsTheClosedFormOnALine) {
  const CouplingSetup s = setup_of(CouplingMethod::kImplicit, 2.0);
  const double k = 50, tau = s.damping_n_s_m / (s.stiffness_n_m + k);
  std::vector<double> end = {0, -7};
  end.resize(60, -7);
  // The end moves evenly within the first sample: the answer to a ramp of speed v there.
  const auto force = coupling_reference(s, linear_law(k), end, 100);
  const double ratio = k / (s.stiffness_n_m + k), v = -7 / s.dt_s;
  const double e1 = ratio * v * (s.dt_s - tau * (1 - std::exp(-s.dt_s / tau)));
  double worst = 0;
  for (std::size_t i = 1; i < end.size(); ++i) {
    const double e = ratio * -7 + (e1 - ratio * -7) * std::exp(-static_cast<double>(i - 1) * s.dt_s / tau);
    worst = std::max(worst, std::abs(force[i] - k * (e + 7)));
  }
  // Runge–Kutta at h/τ = 0.0175: (h/τ)⁴/120 of 350 nN.
  EXPECT_LT(worst, 1e-6);
}

// The methods on a line, from their own recursions' fixed factor: e₁ − e∞ = factor · (e₀ − e∞).
TEST(CouplingStudy, MethodsShrinkByTheirFactorOnALine) {
  const double k = 50, k_c = 20, b_dt = 40;  // b/dt
  const auto factor_seen = [&](CouplingMethod method) {
    const CouplingSetup s = setup_of(method, 2.0);
    std::vector<double> end = {0, -7, -7, -7};
    const auto f = coupling_history(s, linear_law(k), end);
    const double rest = static_force_nn(s, linear_law(k), -7);
    return (f[3] - rest) / (f[2] - rest);
  };
  EXPECT_NEAR(factor_seen(CouplingMethod::kExplicit), 1 - (k_c + k) / b_dt, 1e-12);
  EXPECT_NEAR(factor_seen(CouplingMethod::kSemiImplicit), (b_dt - k) / (b_dt + k_c), 1e-12);
  EXPECT_NEAR(factor_seen(CouplingMethod::kImplicit), b_dt / (b_dt + k_c + k), 1e-12);
  EXPECT_NEAR(static_force_nn(setup_of(CouplingMethod::kImplicit, 2), linear_law(k), -7),
              7 / (1 / 20.0 + 1 / 50.0), 1e-10);
}

// Stability from runs against theory, at 5 % on either side of the limit.
TEST(CouplingStudy, StabilityEndsWhereTheorySays) {
  for (const double damping_ratio : {0.6, 1.0, 10.0, 100.0}) {
    const CouplingSetup e = setup_of(CouplingMethod::kExplicit, damping_ratio);
    const double b_dt = e.damping_n_s_m / e.dt_s;
    for (const auto& law : {linear_law, wall_law}) {
      const double explicit_limit = 2 * b_dt - e.stiffness_n_m;
      EXPECT_TRUE(is_stable(e, law(0.95 * explicit_limit), 10)) << damping_ratio;
      EXPECT_FALSE(is_stable(e, law(1.05 * explicit_limit + 1), 10)) << damping_ratio;
      const CouplingSetup s = setup_of(CouplingMethod::kSemiImplicit, damping_ratio);
      const double semi_limit = s.stiffness_n_m + 2 * b_dt;
      EXPECT_TRUE(is_stable(s, law(0.95 * semi_limit), 10)) << damping_ratio;
      EXPECT_FALSE(is_stable(s, law(1.05 * semi_limit), 10)) << damping_ratio;
    }
  }
  const CouplingSetup undamped = setup_of(CouplingMethod::kSemiImplicit, 0);
  EXPECT_TRUE(is_stable(undamped, wall_law(19), 10));
  EXPECT_FALSE(is_stable(undamped, wall_law(21), 10));
  for (const double damping_ratio : {0.0, 0.1, 10.0}) {
    for (double k = 0.1; k < 1e6; k *= 10) {
      EXPECT_TRUE(is_stable(setup_of(CouplingMethod::kImplicit, damping_ratio), linear_law(k), 10)) << k;
      EXPECT_TRUE(is_stable(setup_of(CouplingMethod::kImplicit, damping_ratio, 8), wall_law(k), 10)) << k;
    }
  }
}

// All first order in dt, and the implicit balance with enough iterations meets the law to rounding.
TEST(CouplingStudy, ErrorsFallWithTheStepAndWithIterations) {
  const auto error = [](CouplingMethod method, double dt) {
    CouplingSetup s;
    s.method = method;
    s.iterations = 8;
    s.damping_n_s_m = 0.2;
    s.dt_s = dt;
    std::vector<double> end;
    const int n = static_cast<int>(std::lround(0.05 / dt));
    for (int i = 0; i <= n; ++i) end.push_back(1 - 6 * std::sin(M_PI * i / n));
    const auto law = hertz_law(5, 20);
    const auto f = coupling_history(s, law, end), exact = coupling_reference(s, law, end, 20);
    double worst = 0;
    for (std::size_t i = 0; i < f.size(); ++i) worst = std::max(worst, std::abs(f[i] - exact[i]));
    return worst;
  };
  for (const auto method :
       {CouplingMethod::kExplicit, CouplingMethod::kSemiImplicit, CouplingMethod::kImplicit}) {
    EXPECT_NEAR(error(method, 1e-4) / error(method, 5e-5), 2, 0.15);  // first order
  }
  // Residual after n steps of Newton's method on a stiff Hertz contact: falls to rounding of some 100 nN.
  CouplingSetup s = setup_of(CouplingMethod::kImplicit, 1.0, 20);
  const auto law = hertz_law(70, 20);
  std::vector<double> end = {1, -8};
  const double e = -coupling_history(s, law, end)[1] / (s.stiffness_n_m + s.damping_n_s_m / s.dt_s);
  EXPECT_NEAR(law.at(e + 8).force_nn, coupling_history(s, law, end)[1], 1e-10 * 160);
  s.iterations = 1;
  EXPECT_GT(std::abs(coupling_history(s, law, end)[1] - law.at(e + 8).force_nn), 1.0);
}

TEST(CouplingStudy, LawsAreContinuousWithTheSlopeTheyState) {
  for (const auto& law : {wall_law(7), hertz_law(70, 20), dmt_law(70, 20, 0.4)}) {
    EXPECT_NEAR(law.at(1e-12).force_nn, law.at(-1e-12).force_nn, 1e-6) << law.name;
    for (const double delta : {-3.0, -0.2, -0.01, 0.01, 0.3, 4.0}) {
      const double h = 1e-6;
      const double slope = (law.at(delta + h).force_nn - law.at(delta - h).force_nn) / (2 * h);
      // Central difference: h² F''' /6 and 1e-16·F/h.
      EXPECT_NEAR(law.at(delta).stiffness_n_m, slope, 1e-6 * (1 + std::abs(slope))) << law.name << delta;
    }
  }
}

TEST(CouplingStudy, TableSaysWhereEachMethodEnds) {
  const CouplingLaw laws[] = {hertz_law(70, 20), dmt_law(70, 20, 0.4)};
  const auto rows = coupling_table(2, laws);
  EXPECT_EQ(rows.size(), (4u * 5 + 3) * (11 + 2));
  const auto commas = [](const std::string& s) { return std::count(s.begin(), s.end(), ','); };
  for (const CouplingRow& row : rows) {
    EXPECT_EQ(commas(coupling_csv(row)), commas(coupling_csv_header()));
    if (row.law != "wall") continue;
    const double limit = row.setup.method == CouplingMethod::kExplicit       ? 2 * row.damping_ratio - 1
                         : row.setup.method == CouplingMethod::kSemiImplicit ? 2 * row.damping_ratio + 1
                                                                             : INFINITY;
    // At 1 % of the limit itself a run cannot tell.
    if (std::abs(row.stiffness_ratio - limit) < 0.01 * limit) continue;
    EXPECT_EQ(row.stable, row.stiffness_ratio < limit) << coupling_csv(row);
  }
}

TEST(CouplingStudy, RefusesASetupWithoutSense) {
  const double end[] = {0, 1};
  for (int i = 0; i < 5; ++i) {
    CouplingSetup s = setup_of(CouplingMethod::kImplicit, 1);
    if (i == 0) s.method = CouplingMethod::kExplicit, s.damping_n_s_m = 0;
    if (i == 1) s.dt_s = 0;
    if (i == 2) s.stiffness_n_m = -1;
    if (i == 3) s.damping_n_s_m = NAN;
    if (i == 4) s.iterations = 0;
    EXPECT_THROW(coupling_history(s, wall_law(1), end), UserError) << i;
  }
}

}  // namespace
}  // namespace telenano::studies
