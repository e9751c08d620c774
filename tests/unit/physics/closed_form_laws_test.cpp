#include "telenano/nve_server/physics/contact/closed_form_laws.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/multiprecision/cpp_dec_float.hpp>
#include <cmath>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/contact/adhesive_curve.h"
#include "telenano/nve_server/physics/contact/hertzian_curve.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/contact_paths.h"
#include "tests/support/md_oracle.h"

namespace telenano::physics {
namespace {

using Real = boost::multiprecision::cpp_dec_float_50;

constexpr Held kOverlap{1.0, 0.0};
constexpr Held kLoad{0.0, 1.0};
constexpr ContactLaw kAdhesive[] = {ContactLaw::kJkr, ContactLaw::kSchwarz,
                                    ContactLaw::kCarpickOgletreeSalmeron, ContactLaw::kPietrementTroyon};

AdhesiveCurve curve_of(ContactLaw model, double lambda, bool vdw = false) {
  return {lambda, closed_form_coefficients(model, lambda), vdw};
}

double to_double(const Real& x) {
  return x.convert_to<double>();
}

struct Published {
  Real overlap, load;
};

// Each law as its paper writes it, in 50 digits, at a contact radius A; nothing of the family's coefficients.
Published schwarz(const Real& a, const Real& tau) {
  const Real root = sqrt(6 * a);
  return {a * a - Real(2) / 3 * tau * root, a * a * a - tau * a * root - 2 * (1 - tau * tau)};
}

struct Fits {
  Real alpha, load_c, a0;
};

Fits pietrement_troyon_fits(double lambda) {
  const Real a = (1 - exp(-Real(lambda) / Real("0.924"))) / Real("1.02");
  return {a, -(Real("0.267") * a * a - Real("0.767") * a + 2),
          Real("-0.451") * pow(a, 4) + Real("1.417") * pow(a, 3) - Real("1.365") * a * a + Real("0.950") * a +
              Real("1.264")};
}

Fits cos_fits(double lambda) {
  const Real l(lambda);
  const Real x = Real("4.04") * pow(l, Real("1.4"));
  const Real y = Real("2.28") * pow(l, Real("1.3"));
  return {(1 - exp(-l / Real("0.924"))) / Real("1.02"), Real("-1.75") + (x - 1) / (x + 1) / 4,
          Real("1.54") + Real("0.279") * (y - 1) / (y + 1)};
}

// Radius and overlap over the load, x = sqrt(1 - L/L_c) >= 0, as published.
struct RadiusAndOverlap {
  Real radius, overlap;
};
RadiusAndOverlap at_load(const Fits& f, const Real& load) {
  const Real a = f.alpha;
  const Real g = (a + sqrt(1 - load / f.load_c)) / (1 + a);
  const Real s = Real("-2.160") * pow(a, Real("0.019")) + Real("2.7531") * pow(a, Real("0.064")) +
                 Real("0.073") * pow(a, Real("1.919"));
  const Real beta =
      Real("0.516") * pow(a, 4) - Real("0.683") * pow(a, 3) + Real("0.235") * a * a + Real("0.429") * a;
  return {f.a0 * pow(g, Real(2) / 3), f.a0 * f.a0 * (pow(g, Real(4) / 3) - s * pow(g, 2 * beta / 3))};
}

TEST(ClosedFormLaws, HertzAndDmtAreTheirFormulas) {
  for (const double pull_off : {0.0, 2.0}) {
    const HertzianCurve curve(1.0, pull_off);
    for (const double overlap : {0.0, 1e-12, 1e-3, 0.7, 5.0, 1e4}) {
      const CurvePoint p = curve.solve(overlap, kOverlap).point;
      const Real d(overlap);
      EXPECT_NEAR(p.load, to_double(d * sqrt(d) - pull_off), 1e-15 * (pull_off + std::pow(overlap, 1.5)));
      EXPECT_NEAR(p.energy, to_double(Real(2) / 5 * d * d * sqrt(d) - pull_off * d),
                  1e-15 * (1 + std::pow(overlap, 2.5)));
      EXPECT_EQ(p.contact_radius, std::sqrt(overlap));
    }
    for (const double soft : {1e-6, 0.3, 1.0, 1e6}) {
      for (const double overlap : {0.0, 1e-9, 0.1, 3.0, 1e3}) {
        const double z = to_double(Real(overlap) + soft * (Real(overlap) * sqrt(Real(overlap)) - pull_off));
        const CurveSolution s = curve.solve(z, {1.0, soft});
        ASSERT_EQ(s.status, CurveStatus::kOk) << soft << ' ' << overlap;
        // z carries one rounding of the spring's own part, soft * pull_off.
        EXPECT_NEAR(s.point.overlap, overlap, 1e-15 * (overlap + soft * pull_off)) << soft;
      }
      EXPECT_EQ(curve.solve(-soft * pull_off - 1e-3, {1.0, soft}).status, CurveStatus::kNoState);
    }
  }
}

TEST(ClosedFormLaws, JkrAndSchwarzAreTheirFormulas) {
  for (const double lambda : {1e-3, 0.1, 1.0, 30.0}) {
    const Real x = Real("4.04") * pow(Real(lambda), Real("1.4"));
    const Real tau = sqrt(x / (1 + x));
    for (const double b : {0.9, 1.1, 1.4, 3.0, 10.0}) {
      const Real a = Real(b) * b;
      const CurvePoint s = curve_of(ContactLaw::kSchwarz, lambda).contact(b);
      const Published want = schwarz(a, tau);
      // Rounding of the terms, of which A^3 and A^2 are the greatest.
      EXPECT_NEAR(s.load, to_double(want.load), 3e-15 * (2 + std::pow(b, 6)));
      EXPECT_NEAR(s.overlap, to_double(want.overlap), 3e-15 * (2 + std::pow(b, 4)));
      const CurvePoint j = curve_of(ContactLaw::kJkr, lambda).contact(b);
      const Published jkr = schwarz(a, 1);
      EXPECT_NEAR(j.load, to_double(jkr.load), 3e-15 * (2 + std::pow(b, 6)));
      EXPECT_NEAR(j.overlap, to_double(jkr.overlap), 3e-15 * (2 + std::pow(b, 4)));
    }
    // Pull-off -(2 - tau^2/2) under load control.
    EXPECT_NEAR(curve_of(ContactLaw::kSchwarz, lambda).fold(kLoad).load, to_double(-2 + tau * tau / 2),
                4e-15);
  }
  const AdhesiveCurve jkr = curve_of(ContactLaw::kJkr, 1.0);
  EXPECT_NEAR(jkr.fold(kLoad).load, -1.5, 1e-15);
  EXPECT_NEAR(jkr.fold(kOverlap).load, -5.0 / 6.0, 1e-15);
  EXPECT_NEAR(jkr.solve(0.0, kOverlap).point.load, -4.0 / 3.0, 1e-14);
}

TEST(ClosedFormLaws, CosAndPietrementTroyonAreTheirFormulas) {
  for (const double lambda : {0.05, 0.1, 0.5, 1.0, 4.0, 50.0}) {
    for (const ContactLaw model : {ContactLaw::kCarpickOgletreeSalmeron, ContactLaw::kPietrementTroyon}) {
      const bool cos = model == ContactLaw::kCarpickOgletreeSalmeron;
      const Fits fits = cos ? cos_fits(lambda) : pietrement_troyon_fits(lambda);
      const AdhesiveCurve curve = curve_of(model, lambda);
      EXPECT_NEAR(curve.fold(kLoad).load, to_double(fits.load_c), 1e-14);
      for (const double load : {-1.0, 0.0, 1.0, 20.0, 1e4}) {
        const CurveSolution s = curve.solve(load, kLoad);
        ASSERT_EQ(s.status, CurveStatus::kOk);
        const RadiusAndOverlap want = at_load(fits, load);
        // det_exp and det_log are within some ulp, and the fits cancel by one digit.
        EXPECT_NEAR(s.point.contact_radius, to_double(want.radius), 2e-14 * to_double(want.radius)) << lambda;
        EXPECT_NEAR(s.point.overlap, to_double(want.overlap), 1e-13 * to_double(want.radius * want.radius))
            << lambda;
      }
    }
  }
}

// int P dDelta by Simpson's rule over ln B, where every power of B is smooth.
TEST(ClosedFormLaws, EnergyIsTheIntegralOfTheLoad) {
  for (const ContactLaw model : kAdhesive) {
    for (const double lambda : {1e-3, 0.1, 1.0, 100.0}) {
      const AdhesiveCurve curve = curve_of(model, lambda);
      constexpr double kStart = 0.01;
      for (const double b : {0.5, 1.3, 2.5}) {
        constexpr int kPanels = 4000;
        const double step = std::log(b / kStart) / kPanels;
        double sum = 0;
        for (int i = 0; i <= kPanels; ++i) {
          const CurvePoint p = curve.contact(kStart * std::exp(i * step));
          sum += (i == 0 || i == kPanels ? 1 : i % 2 == 0 ? 2 : 4) * p.load * p.overlap_rate * p.parameter;
        }
        sum *= step / 3.0;
        // Simpson: h^4/180 (h = 1.4e-3) of the fourth derivative, 10^4 times the integrand at most (B^10).
        EXPECT_NEAR(curve.contact(b).energy - curve.contact(kStart).energy, sum, 1e-9 * (1 + std::fabs(sum)))
            << contact_law_name(model) << ' ' << lambda << ' ' << b;
      }
    }
  }
}

TEST(ClosedFormLaws, FoldEndsTheStableStates) {
  for (const ContactLaw model : kAdhesive) {
    for (const double lambda : {1e-3, 0.01, 0.1, 0.7, 3.0, 1e4}) {
      const AdhesiveCurve curve = curve_of(model, lambda);
      for (const double soft : {0.0, 0.05, 1.0, 40.0}) {
        const Held held{1.0, soft};
        const CurvePoint fold = curve.fold(held);
        const double z = fold.held(held);
        // Least Z of all states right of the fold of Delta, by a scan that knows no derivative.
        double least = 1e300;
        const double from = curve.overlap_fold();
        const double panel = (1.2 * std::max(curve.load_fold(), from) - from) / 20000;
        for (int i = 0; i <= 20000; ++i) least = std::min(least, curve.contact(from + panel * i).held(held));
        EXPECT_LE(z, least + 1e-14 * (1 + soft));
        EXPECT_NEAR(z, least, 1e-7 * (1 + soft)) << contact_law_name(model) << ' ' << lambda << ' ' << soft;
        EXPECT_EQ(curve.solve(z - 1e-9 * (1 + soft), held).status, CurveStatus::kNoState);
        for (const double above : {1e-9, 1e-3, 1.0, 1e3, 1e8}) {
          double answers[3];
          int n = 0;
          for (const double guess : {0.0, 0.3, 50.0}) {
            const CurveSolution s = curve.solve(z + above, held, guess);
            ASSERT_EQ(s.status, CurveStatus::kOk) << contact_law_name(model) << ' ' << lambda << ' ' << above;
            EXPECT_NEAR(s.point.held(held), z + above, 1e-13 * (1 + above + soft * 2 + std::fabs(z)));
            EXPECT_LE(s.evaluations, 40);
            answers[n++] = s.point.load;
          }
          // Near a fold Z says little of B: sqrt(1e-16/1e-9) of it is 3e-4 of the distance, some 1e-8.
          EXPECT_NEAR(answers[0], answers[1], 1e-6 * (1 + std::fabs(answers[0])));
          EXPECT_NEAR(answers[0], answers[2], 1e-6 * (1 + std::fabs(answers[0])));
        }
      }
    }
  }
}

// How far each law is from Maugis–Dugdale: the table in closed_form_laws.h.
TEST(ClosedFormLaws, ModelErrorAgainstFiftyDigits) {
  constexpr double kLambda[] = {0.01, 0.1, 0.5, 1.0, 3.0, 10.0};
  constexpr ContactLaw kAll[] = {ContactLaw::kHertz,
                                 ContactLaw::kDmt,
                                 ContactLaw::kJkr,
                                 ContactLaw::kSchwarz,
                                 ContactLaw::kCarpickOgletreeSalmeron,
                                 ContactLaw::kPietrementTroyon};
  double worst[6][6] = {};
  double pull_off[6][6] = {};
  for (int j = 0; j < 6; ++j) {
    const oracle::MaugisDugdale exact(kLambda[j]);
    std::vector<double> overlaps, loads;
    for (const double d : {-0.5, -0.3, -0.1, 0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0}) {
      const oracle::MaugisDugdale::State state = exact.at_overlap(d);
      if (!state.contact) continue;
      overlaps.push_back(d);
      loads.push_back(state.load);
    }
    const double exact_pull_off = -exact.pull_off_load();
    for (int i = 0; i < 6; ++i) {
      const ContactLaw model = kAll[i];
      const bool plain = model == ContactLaw::kHertz || model == ContactLaw::kDmt;
      const double l = model == ContactLaw::kDmt ? 2.0 : 0.0;
      for (std::size_t k = 0; k < overlaps.size(); ++k) {
        const CurveSolution s = plain ? HertzianCurve(kLambda[j], l).solve(overlaps[k], kOverlap)
                                      : curve_of(model, kLambda[j]).solve(overlaps[k], kOverlap);
        if (s.status != CurveStatus::kOk) continue;
        worst[i][j] =
            std::max(worst[i][j], std::fabs(s.point.load - loads[k]) / std::max(1.0, std::fabs(loads[k])));
      }
      pull_off[i][j] = (plain ? l : -curve_of(model, kLambda[j]).fold(kLoad).load) / exact_pull_off - 1;
    }
  }
  // As stated in the header, in per cent; half a unit of its last digit.
  constexpr double kWorst[6][6] = {{180, 150, 132, 125, 121, 120},     {24.4, 55.1, 76.7, 82.2, 85.8, 86.5},
                                   {63.6, 34.1, 12.9, 6.6, 1.2, 0.12}, {23.8, 42.1, 23.0, 12.0, 3.4, 0.7},
                                   {3.2, 19.4, 9.8, 11.8, 4.1, 1.7},   {8.5, 7.5, 2.1, 1.0, 0.4, 0.2}};
  constexpr double kPullOff[6][6] = {
      {-100, -100, -100, -100, -100, -100},     {0.1, 2.5, 16.4, 24.9, 31.9, 33.2},
      {-24.9, -23.1, -12.7, -6.3, -1.1, -0.11}, {-0.1, -1.0, -1.2, -0.1, 0.6, 0.2},
      {-0.1, -1.0, -1.2, -0.1, 0.6, 0.2},       {-0.3, -1.3, 0.7, 0.9, -0.2, 0.2}};
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      EXPECT_NEAR(100 * worst[i][j], kWorst[i][j], i == 0 ? 0.6 : 0.06) << i << ' ' << kLambda[j];
      EXPECT_NEAR(100 * pull_off[i][j], kPullOff[i][j], 0.06) << i << ' ' << kLambda[j];
    }
  }
}

TEST(ClosedFormLaws, RefusesWhatMakesNoSense) {
  TipSampleParameters p = testing::material_of(0.5, true);
  p.model = ContactLaw::kHertz;
  EXPECT_THROW(TipSampleLaw{p}, UserError);
  p.van_der_waals = false;
  EXPECT_NO_THROW(TipSampleLaw{p});
}

// F = K sqrt(R) delta^1.5: the work of adhesion only made the units.
TEST(ClosedFormLaws, HertzInNanometresAndNanonewtons) {
  TipSampleParameters p = testing::silicon_on(70, 0.2, 0.27, false);
  p.model = ContactLaw::kHertz;
  TipSampleState state;
  const Equilibrium e = TipSampleLaw(p).advance(1.0, 0.0, 20.0, state);
  EXPECT_NEAR(e.force_nn, p.contact_modulus_gpa * std::sqrt(20.0), 1e-12 * e.force_nn);
  EXPECT_NEAR(e.potential_aj, 0.4 * p.contact_modulus_gpa * std::sqrt(20.0), 1e-12 * e.force_nn);
  EXPECT_NEAR(e.contact_radius_nm, std::sqrt(20.0), 1e-13 * e.contact_radius_nm);
  EXPECT_EQ(e.jumps, 0);
  EXPECT_EQ(e.dissipated_aj, 0);
}

TEST(ClosedFormLaws, NamesGoThereAndBack) {
  for (int i = 0; i < 7; ++i) {
    const auto model = static_cast<ContactLaw>(i);
    EXPECT_EQ(contact_law_from_name(contact_law_name(model)), model);
  }
  EXPECT_EQ(contact_law_from_name("cos"), ContactLaw::kCarpickOgletreeSalmeron);
  EXPECT_EQ(contact_law_from_name("maugis-dugdale"), ContactLaw::kMaugisDugdale);
  EXPECT_FALSE(contact_law_from_name("JKR"));
  EXPECT_FALSE(contact_law_from_name(""));
  EXPECT_EQ(maugis_method_from_name("table"), MaugisMethod::kTable);
  EXPECT_EQ(maugis_method_from_name("direct"), MaugisMethod::kDirect);
  EXPECT_FALSE(maugis_method_from_name("tables"));
}

}  // namespace
}  // namespace telenano::physics
