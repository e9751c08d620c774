#include "telenano/nve_server/physics/contact/joined_law.h"

#include <gtest/gtest.h>

#include <cmath>

#include "telenano/nve_server/physics/long_range/van_der_waals.h"

namespace telenano::physics {
namespace {

TEST(VanDerWaals, MatchesDmtPullOffAtCutOffAndItsOwnPotential) {
  const VanDerWaals law = VanDerWaals::from_adhesion(0.1, 0.165);
  EXPECT_NEAR(law.force_nn(20, 0.165), -2 * M_PI * 0.1 * 20, 1e-13);
  for (const double d : {0.165, 0.3, 2.0, 50.0}) {
    // U(overlap), overlap = -d: F = -dU/d(gap)... of an energy stored: F = dU/d(overlap). Central difference,
    // error h^2.
    const double h = 1e-4 * d;
    EXPECT_NEAR(law.force_nn(20, d), (law.energy_aj(20, d - h) - law.energy_aj(20, d + h)) / (2 * h),
                2e-8 * std::fabs(law.force_nn(20, d)));
    EXPECT_NEAR(law.stiffness_n_m(20, d), (law.force_nn(20, d - h) - law.force_nn(20, d + h)) / (2 * h),
                3e-8 * std::fabs(law.stiffness_n_m(20, d)));
  }
}

TEST(OutsideLaw, SolvesItsBalanceUpToTheJump) {
  for (const double lambda : {1e-3, 0.7, 30.0, 1.2e4}) {
    const OutsideLaw law(lambda);
    for (const double c : {0.0, 1e-6, 1e-2, 1.0, 1e4}) {
      // Base position at the jump to contact: B = 1.5 y.
      const double edge = (1.0 - 1.5 * law.jump_gap(c)) / law.eta();
      for (const double distance : {1e-12, 1e-6, 1e-2, 1.0, 1e3, 1e8}) {
        const double z = edge - distance * (1.0 + std::fabs(edge));
        if (1.0 - law.eta() * z < 1.0) continue;
        ASSERT_TRUE(law.stable(z, c));
        const OutsidePoint p = law.solve(z, c);
        // Roundings of Z, and of Delta = (1 - y)/eta, which cancels for y near 1.
        EXPECT_NEAR(p.overlap + c * p.load, z, 1e-14 * (std::fabs(z) + 1.0 / law.eta() + c))
            << lambda << ' ' << c;
        EXPECT_GE(p.gap, law.jump_gap(c) * (1 - 1e-7));
        EXPECT_GE(1.0 + c * p.slope, -1e-7);
      }
      if (c > 0) {
        EXPECT_FALSE(law.stable(edge + 1e-6 * (1.0 + std::fabs(edge)), c));
      }
    }
  }
}

TEST(Handover, ForceIsContinuousAndTheGapIsThePublishedOne) {
  for (double lambda = 1e-3; lambda < 1.3e4; lambda *= 1.07) {
    const MaugisDugdale curve(lambda);
    const OutsideLaw outside(lambda);
    const Handover h = find_handover(curve, outside);
    EXPECT_NEAR(h.inside.load, outside.at_gap(h.gap).load, 1e-12) << lambda;
    EXPECT_LT(h.gap, kNoHandoverGap);
    const CurvePoint fold = curve.fold({1, 0});
    const OutsidePoint outside_fold = outside.at_gap(1.0 - outside.eta() * fold.overlap);
    EXPECT_EQ(h.reversible, outside_fold.load < fold.load) << lambda;
    EXPECT_GE(h.inside.overlap, fold.overlap);
    // Between fold and handover Maugis–Dugdale is the more attractive one wherever there is hysteresis, less
    // so in the reversible case: the handover is the first crossing from the proper side.
    for (int i = 1; i < 20; ++i) {
      const double delta = fold.overlap + 0.05 * i * (h.inside.overlap - fold.overlap);
      const double inside = curve.solve(delta, {1, 0}).point.load;
      const double out = outside.at_gap(1.0 - outside.eta() * delta).load;
      if (h.reversible) {
        EXPECT_GT(inside, out) << lambda;
      } else {
        EXPECT_LT(inside, out) << lambda;
      }
    }
    // U meets that of van der Waals where the tip goes out; going in, it is never above.
    const Parting parting = find_parting(curve, outside);
    EXPECT_EQ(parting.reversible, h.reversible);
    const double out = outside.at_gap(1.0 - outside.eta() * parting.end.overlap).energy;
    EXPECT_NEAR(parting.end.energy + parting.energy_offset, out, 1e-12 * std::fabs(out) + 1e-16) << lambda;
    const double lost = outside.at_gap(h.gap).energy - (h.inside.energy + parting.energy_offset);
    if (h.reversible) {
      EXPECT_EQ(parting.end.parameter, h.inside.parameter);
    } else {
      EXPECT_EQ(parting.end.overlap, fold.overlap);
      // The area between the laws, 0.66 where the two crossings become one, W = 1.2749 of JKR at infinity.
      EXPECT_GT(lost, 0.66) << lambda;
      EXPECT_LT(lost, 1.275) << lambda;
    }
    // Warm start gives the same crossing.
    const Handover warm = find_handover(curve, outside, 0.5 * h.inside.parameter);
    EXPECT_NEAR(warm.gap, h.gap, 1e-12);  // twice the error of the force
  }
  for (const double lambda : {0.73676, 4.04149, 408.71}) {
    const double gap_nm = 0.165 * find_handover(MaugisDugdale(lambda), OutsideLaw(lambda)).gap;
    EXPECT_GT(gap_nm, 0.185) << lambda;
    EXPECT_LT(gap_nm, 0.205) << lambda;
  }
}

/// U inside at a held overlap on its way through lambda: no step, and no step of the slope. The greatest of
/// the second differences of U, which are h^2 U'' where U is smooth and as large as U's jump (or h times
/// that of its slope) where it is not.
template <class MakeCurve>
void expect_smooth_in_lambda(double from, double to, double overlap, double bend, const MakeCurve& make) {
  constexpr double kStep = 1e-4;
  double before = 0, here = 0;
  int i = 0;
  for (double lambda = from; lambda < to; lambda += kStep, ++i) {
    const auto curve = make(lambda);
    const Parting parting = find_parting(curve, OutsideLaw(lambda));
    const double energy = curve.solve(overlap, {1, 0}).point.energy + parting.energy_offset;
    if (i > 1) {
      // A slope that broke by 0.1 would show as 1e-5.
      ASSERT_NEAR(energy - here, here - before, bend * kStep * kStep) << lambda << ' ' << parting.reversible;
    }
    before = here;
    here = energy;
  }
}

TEST(Parting, EnergyInsideIsSmoothInLambdaWhereTheHandoverTurnsOneWay) {
  const auto maugis = [](double lambda) { return MaugisDugdale(lambda); };
  for (const double overlap : {-0.5, 0.0, 1.0, 10.0}) {
    expect_smooth_in_lambda(0.6, 1.1, overlap, 60, maugis);  // U'' is some 2/lambda^3
  }
  EXPECT_TRUE(find_parting(maugis(0.6), OutsideLaw(0.6)).reversible);
  EXPECT_FALSE(find_parting(maugis(0.85), OutsideLaw(0.85)).reversible);
  const auto jkr = [](double lambda) {
    return AdhesiveCurve(lambda, closed_form_coefficients(ContactLaw::kJkr, lambda), true);
  };
  EXPECT_TRUE(jkr(0.2).saturated());
  EXPECT_FALSE(jkr(0.25).saturated());
  for (const double overlap : {0.0, 1.0, 10.0}) expect_smooth_in_lambda(0.24, 0.6, overlap, 600, jkr);
}

// JKR between saturation and 0.40: the outer one of two crossings, in and out, with no step of the force and
// nothing lost.
TEST(Handover, OfANeckedLawIsUsedBothWaysWhereItCrossesTwice) {
  for (const double lambda : {0.24, 0.3, 0.35, 0.45, 0.8}) {
    const AdhesiveCurve curve(lambda, closed_form_coefficients(ContactLaw::kJkr, lambda), true);
    const OutsideLaw outside(lambda);
    ASSERT_FALSE(curve.saturated());
    const CurvePoint fold = curve.fold({1, 0});
    const bool twice = outside.at_gap(outside.gap_of(fold.overlap)).load < fold.load;
    EXPECT_EQ(twice, lambda < 0.4);
    const Handover h = find_handover(curve, outside);
    EXPECT_EQ(h.reversible, twice) << lambda;
    EXPECT_NEAR(h.inside.load, outside.at_gap(outside.gap_of(h.inside.overlap)).load, 1e-12) << lambda;
    // Only at the outer one of two crossings does the law attract more on the inner side.
    const double beside = 1e-3 * (h.inside.overlap - fold.overlap);
    const double within = curve.solve(h.inside.overlap + beside, {1, 0}).point.load;
    const double van_der_waals = outside.at_gap(outside.gap_of(h.inside.overlap + beside)).load;
    EXPECT_EQ(within < van_der_waals, twice) << lambda;
    const Parting parting = find_parting(curve, outside);
    EXPECT_EQ(parting.reversible, twice);
    EXPECT_EQ(parting.end.overlap, twice ? h.inside.overlap : fold.overlap) << lambda;
  }
}

}  // namespace
}  // namespace telenano::physics
