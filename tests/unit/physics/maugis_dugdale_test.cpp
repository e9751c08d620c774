#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "telenano/nve_server/physics/law/warm_start.h"
#include "tests/support/md_oracle.h"

namespace telenano::physics {
namespace {

constexpr Held kOverlap{1.0, 0.0};
constexpr Held kLoad{0.0, 1.0};

/// lambda over the range of real samples, and either side of every value where the curve changes its kind:
/// 0.655 (snap-in lands in contact), 0.717 (joined law), 0.937947457 (the fold moves into contact).
std::vector<double> lambdas() {
  std::vector<double> l{0.5,       0.655,     0.656, 0.716,   0.718, 0.73676,
                        0.9379474, 0.9379475, 1.0,   4.04149, 10.0,  408.71};
  for (double x = 1e-3; x < 1.25e4; x *= 4.1) l.push_back(x);
  l.push_back(1.2e4);
  return l;
}

double ulp(double x) {
  return std::nextafter(std::fabs(x), std::numeric_limits<double>::infinity()) - std::fabs(x);
}

/// 1e-9 of the force and of the pull-off load, and what the rounding of Delta itself does to the force.
double tolerance(const oracle::MaugisDugdale::State& want, double pull_off, double delta) {
  return 1e-9 * (std::fabs(want.load) + std::fabs(pull_off)) + std::fabs(want.slope) * ulp(delta);
}

TEST(MaugisDugdale, ForceRadiusAndBranchAgreeWithFiftyDigits) {
  double worst = 0;
  double worst_warm = 0;
  for (const double lambda : lambdas()) {
    const oracle::MaugisDugdale oracle(lambda);
    const MaugisDugdale curve(lambda);
    const double pull_off = oracle.pull_off_load();
    std::vector<double> deltas;
    for (int i = 1; i <= 8; ++i)
      deltas.push_back(oracle.fold_overlap() + 0.125 * i * (1.0 - oracle.fold_overlap()));
    for (double d = 2; d < 1.1e4; d *= 3.3) deltas.push_back(d);
    deltas.push_back(1e4);
    for (double relative = 1e-3; relative > 0.5e-11; relative *= 0.1)
      deltas.push_back(oracle.above_fold(relative));
    for (const double side : {-1e-3, -1e-9, 1e-9, 1e-3}) deltas.push_back(oracle.onset_overlap() + side);
    deltas.push_back(-curve.range());
    for (const double delta : deltas) {
      // The rounded Delta closest to a fold may lie below it; there is nothing to compare within 1e-12 of it.
      if (delta < oracle.above_fold(1e-12)) continue;
      const oracle::MaugisDugdale::State want = oracle.at_overlap(delta);
      const CurveSolution got = curve.solve(delta, kOverlap);
      ASSERT_TRUE(want.stable);
      ASSERT_EQ(got.status, CurveStatus::kOk) << lambda << ' ' << delta;
      const double allowed = tolerance(want, pull_off, delta);
      EXPECT_NEAR(got.point.load, want.load, allowed) << lambda << ' ' << delta;
      EXPECT_EQ(got.point.contact, want.contact) << lambda << ' ' << delta;
      // The radius has a vertical tangent at the onset and at the fold: a ~ sqrt(x). 1e-7 of the scale u_a
      // covers it.
      EXPECT_NEAR(got.point.contact_radius, want.contact_radius, 1e-7 + 1e-9 * want.contact_radius);
      EXPECT_NEAR(got.point.overlap, delta,
                  4e-16 * (std::fabs(delta) + curve.range() + 3 * got.point.outer_radius));
      worst = std::max(worst, std::fabs(got.point.load - want.load) / allowed);
      if (!got.point.contact) continue;
      // The quick way of a loop: a good guess is accepted after one evaluation.
      const double u = got.point.parameter;
      for (const double off : {1e-9, -1e-8, 1e-6, -1e-3, 0.1}) {
        const CurveSolution warm = curve.solve(delta, kOverlap, u * (1 + off));
        ASSERT_EQ(warm.status, CurveStatus::kOk);
        EXPECT_NEAR(warm.point.load, want.load, allowed) << lambda << ' ' << delta << ' ' << off;
        worst_warm = std::max(worst_warm, std::fabs(warm.point.load - want.load) / allowed);
      }
    }
  }
  RecordProperty("worst_of_tolerance", std::to_string(worst));
  std::printf("worst force error: %.2g of the tolerance, %.2g from a warm start\n", worst, worst_warm);
}

TEST(MaugisDugdale, FoldsAgreeWithFiftyDigitsAndEndTheCurve) {
  for (const double lambda : lambdas()) {
    const oracle::MaugisDugdale oracle(lambda);
    const MaugisDugdale curve(lambda);
    const CurvePoint fold = curve.fold(kOverlap);
    // A few roundings of terms as large as Delta and 1.
    EXPECT_NEAR(fold.overlap, oracle.fold_overlap(), 2e-15 * std::max(1.0, std::fabs(oracle.fold_overlap())))
        << lambda;
    EXPECT_EQ(fold.contact, oracle.fold_in_contact()) << lambda;
    EXPECT_NEAR(curve.fold(kLoad).load, oracle.pull_off_load(), 4e-15) << lambda;
    // Within 1e-12 of the fold: branch and finiteness only.
    const CurveSolution above = curve.solve(oracle.above_fold(1e-12), kOverlap);
    EXPECT_EQ(above.status, CurveStatus::kOk) << lambda;
    EXPECT_EQ(above.point.contact, oracle.at_overlap(oracle.above_fold(1e-12)).contact) << lambda;
    EXPECT_TRUE(std::isfinite(above.point.load));
    const CurveSolution below = curve.solve(oracle.above_fold(-1e-12), kOverlap);
    EXPECT_EQ(below.status, CurveStatus::kNoState) << lambda;
    for (int k = -3; k <= 3; ++k) {
      const double delta = fold.overlap + k * ulp(fold.overlap);
      EXPECT_TRUE(std::isfinite(curve.solve(delta, kOverlap).point.load)) << lambda;
      EXPECT_NE(curve.solve(delta, kOverlap).status, CurveStatus::kNotConverged) << lambda;
    }
  }
}

TEST(MaugisDugdale, PublishedTable) {
  // Reference numbers computed elsewhere with 50 digits; half a unit of their last digit.
  struct Row {
    double lambda, pull_off, radius, overlap, p0, p1, p5, p10;
  };
  for (const Row& row :
       {Row{0.1, -1.950594892, 1.336179808, 1.292425345, -1.749351, -0.502406, 9.893073, 30.416525},
        Row{0.5, -1.718245275, 1.517383526, 1.165133729, -1.491800, -0.272585, 10.050565, 30.535605},
        Row{1, -1.600734911, 1.636090490, 1.129893891, -1.405467, -0.211010, 10.084651, 30.559663},
        Row{10, -1.501624860, 1.812624954, 1.101142087, -1.334525, -0.162079, 10.111598, 30.578908}}) {
    const MaugisDugdale curve(row.lambda);
    const CurvePoint zero = curve.solve(0, kLoad).point;
    EXPECT_NEAR(curve.fold(kLoad).load, row.pull_off, 0.51e-9);
    EXPECT_NEAR(zero.contact_radius, row.radius, 0.51e-9);
    EXPECT_NEAR(zero.overlap, row.overlap, 0.51e-9);
    EXPECT_NEAR(curve.solve(0, kOverlap).point.load, row.p0, 0.51e-6);
    EXPECT_NEAR(curve.solve(1, kOverlap).point.load, row.p1, 0.51e-6);
    EXPECT_NEAR(curve.solve(5, kOverlap).point.load, row.p5, 0.51e-6);
    EXPECT_NEAR(curve.solve(10, kOverlap).point.load, row.p10, 0.51e-6);
  }
}

TEST(MaugisDugdale, LimitsHertzDmtJkr) {
  // JKR is approached like lambda^-2; DMT only like sqrt(lambda Delta), from above (found by running lambda
  // to 1e-6: the difference is 2.25 sqrt(lambda Delta)); Hertz when adhesion is small against the load.
  const MaugisDugdale jkr(1.2e4);
  for (const double a : {0.9, 1.5, 3.0, 10.0}) {
    const double delta = a * a - 2.0 / 3.0 * std::sqrt(6 * a);
    EXPECT_NEAR(jkr.solve(delta, kOverlap).point.load, a * a * a - a * std::sqrt(6 * a),
                1e-6 * (1 + a * a * a));
  }
  for (const double lambda : {1e-3, 1e-6}) {
    for (const double delta : {0.5, 1.0, 5.0, 50.0}) {
      const double above =
          MaugisDugdale(lambda).solve(delta, kOverlap).point.load - (std::pow(delta, 1.5) - 2.0);
      EXPECT_GT(above, 0) << lambda << ' ' << delta;
      EXPECT_LT(above, 2.3 * std::sqrt(lambda * delta)) << lambda << ' ' << delta;
    }
  }
  for (const double lambda : {1e-3, 1.0, 1.2e4}) {
    EXPECT_NEAR(MaugisDugdale(lambda).solve(1e4, kOverlap).point.load / 1e6, 1.0, 4e-4);
  }
}

TEST(MaugisDugdale, EnergyAgreesWithQuadratureInFiftyDigits) {
  for (const double lambda : lambdas()) {
    const oracle::MaugisDugdale oracle(lambda);
    const MaugisDugdale curve(lambda);
    const double scale = std::fabs(curve.noncontact(curve.onset_radius()).energy);
    for (const double delta : {oracle.above_fold(1e-3), 0.5 * oracle.fold_overlap(), 1.0, 30.0, 1e4}) {
      const CurveSolution got = curve.solve(delta, kOverlap);
      const double want = oracle.energy(delta);
      // The closed form has no cancellation beyond what U itself has; 1e-13 is some 500 roundings.
      EXPECT_NEAR(got.point.energy, want, 1e-13 * std::max({std::fabs(want), scale, 1.0}))
          << lambda << ' ' << delta;
    }
  }
}

TEST(MaugisDugdale, LoopEnergy) {
  for (const double lambda : lambdas()) {
    const oracle::MaugisDugdale oracle(lambda);
    const MaugisDugdale curve(lambda);
    const double got = curve.fold(kOverlap).energy - curve.solve(-curve.range(), kOverlap).point.energy;
    EXPECT_NEAR(got, oracle.loop_energy(), 1e-14 + 1e-13 * got) << lambda;
    if (lambda <= 0.655) {
      const double closed = 17 * M_PI / 24 * std::pow(8 / (3 * M_PI), 4) * std::pow(lambda, 5);
      EXPECT_NEAR(got, closed, 1e-13 * closed) << lambda;
    }
  }
  const MaugisDugdale jkr(1e6);
  EXPECT_NEAR(jkr.fold(kOverlap).energy - jkr.solve(-jkr.range(), kOverlap).point.energy, 1.274941029, 1e-6);
}

TEST(MaugisDugdale, ContinuousAtOnset) {
  for (const double lambda : lambdas()) {
    const MaugisDugdale curve(lambda);
    const CurvePoint before = curve.noncontact(curve.onset_radius());
    const CurvePoint after = curve.contact(0);
    const double scale = 1.0 + before.outer_radius * before.outer_radius;
    EXPECT_NEAR(before.load, after.load, 1e-14) << lambda;
    EXPECT_NEAR(before.overlap, after.overlap, 1e-15 * scale) << lambda;
    EXPECT_NEAR(before.energy, after.energy, 1e-15 * (scale + std::fabs(before.energy))) << lambda;
    // Equal slopes, as a product since they are infinite where the fold is at the onset.
    EXPECT_NEAR(before.load_rate * after.overlap_rate, after.load_rate * before.overlap_rate,
                1e-14 * scale * std::fabs(before.load_rate))
        << lambda;
    EXPECT_EQ(after.contact_radius, 0);
  }
}

TEST(MaugisDugdale, RatesAgreeWithDifferences) {
  // Central differences of step h u: error (h u)^2 f'''/6 and rounding 1e-16/h; h = 1e-5 leaves about 1e-9.
  for (const double lambda : lambdas()) {
    const MaugisDugdale curve(lambda);
    for (const double u : {1e-3, 0.3, 3.0, 24.0, 26.0, 1e3, 1e3 * lambda * lambda}) {
      const double h = 1e-5 * u;
      const CurvePoint p = curve.contact(u);
      const CurvePoint up = curve.contact(u + h);
      const CurvePoint down = curve.contact(u - h);
      const double per = 1.0 / (2 * h);
      const auto near = [&](double rate, double high, double low, double size) {
        EXPECT_NEAR(rate, (high - low) * per, 1e-7 * std::fabs(rate) + 1e-10 * size / u)
            << lambda << ' ' << u;
      };
      near(p.overlap_rate, up.overlap, down.overlap, std::fabs(p.overlap) + 1);
      near(p.load_rate, up.load, down.load, std::fabs(p.load) + 1);
      near(p.contact_radius_rate, up.contact_radius, down.contact_radius, p.contact_radius);
      near(p.load * p.overlap_rate, up.energy, down.energy, std::fabs(p.energy) + 1);
      // The bends are those of the rates, which are themselves differences of larger terms.
      near(p.overlap_bend, up.overlap_rate, down.overlap_rate,
           std::fabs(p.overlap_rate) + p.contact_radius * p.contact_radius_rate);
      near(p.load_bend, up.load_rate, down.load_rate,
           std::fabs(p.load_rate) + p.contact_radius * p.contact_radius * p.contact_radius_rate);
      const CurvePoint more = MaugisDugdale(lambda * (1 + 1e-5)).contact(u);
      const CurvePoint less = MaugisDugdale(lambda * (1 - 1e-5)).contact(u);
      EXPECT_NEAR(p.overlap_by_lambda, (more.overlap - less.overlap) / 2e-5,
                  1e-7 * std::fabs(p.overlap_by_lambda) + 1e-10 * (std::fabs(p.overlap) + 1))
          << lambda << ' ' << u;
      EXPECT_NEAR(p.load_by_lambda, (more.load - less.load) / 2e-5,
                  1e-7 * std::fabs(p.load_by_lambda) + 1e-10 * (std::fabs(p.load) + 1))
          << lambda << ' ' << u;
    }
  }
}

// What is foreseen of a step in which base, compliance and radius change: its error against a cold solution
// is of second order, so that a change of half the size leaves at most a third of it (a quarter, with what is
// of third order), and of the size that the change squared explains.
TEST(MaugisDugdale, NextStateIsForeseenToSecondOrder) {
  struct Memory {
    double u = 0, lambda = 0;
    bool has_last = false;
    CurvePoint last;
  };
  for (const double lambda : {0.1, 0.73676, 4.04149, 408.71}) {
    for (const double c : {0.0, 0.3, 10.0}) {
      for (const double overlap : {0.7, 3.0, 30.0}) {
        const MaugisDugdale curve(lambda);
        const CurvePoint start = curve.solve(overlap, kOverlap).point;
        ASSERT_TRUE(start.contact);
        Memory memory;
        remember(curve, memory, start);
        for (const auto& [dz, dc, dlambda] :
             {std::array{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}, {1.0, -1.0, 0.5}}) {
          double error[2];
          for (const int half : {0, 1}) {
            const double step = half ? 0.5e-2 : 1e-2;
            const MaugisDugdale there(lambda * (1 + step * dlambda));
            const Held held{1.0, c * (1 + step * dc)};
            const double z = start.held({1.0, c}) + step * dz * (overlap + c * std::fabs(start.load));
            const double u = there.solve(z, held).point.parameter;
            error[half] = foreseen(there, memory, z, held) / u - 1;
          }
          EXPECT_LT(std::fabs(error[1]), 0.35 * std::fabs(error[0]) + 1e-12)
              << lambda << ' ' << c << ' ' << overlap << ' ' << dz << dc << dlambda;
          EXPECT_LT(std::fabs(error[0]), 3e-3) << lambda << ' ' << c << ' ' << overlap;
        }
      }
    }
  }
}

// Near a fold every method converges slowly that takes the curve for a line: from the last state, or from
// nothing, eight evaluations are enough wherever the state is.
TEST(MaugisDugdale, EightEvaluationsAreEnough) {
  int most_warm = 0, most_cold = 0;
  for (double lambda = 1e-3; lambda<1.2e4; lambda *= lambda> 0.9 && lambda < 1.1 ? 1.003 : 1.3) {
    const MaugisDugdale curve(lambda);
    for (const double c : {0.0, 1e-3, 0.1, 1.0, 100.0}) {
      const Held spring{1.0, c};
      const double end = curve.fold(spring).held(spring);
      for (double above = 1e-9; above < 1e4; above *= 5) {
        const CurveSolution cold = curve.solve(end + above, spring);
        most_cold = std::max(most_cold, cold.evaluations);
        for (const double last : {0.01, 0.3, 3.0, 100.0}) {
          const double guess = curve.solve(end + last * above, spring).point.parameter;
          const CurveSolution warm = curve.solve(end + above, spring, guess);
          most_warm = std::max(most_warm, warm.evaluations);
        }
      }
    }
  }
  EXPECT_LE(most_warm, 8);
  EXPECT_LE(most_cold, 8);
  std::printf("evaluations: at most %d warm, %d cold\n", most_warm, most_cold);
}

TEST(MaugisDugdale, AnySpringAnyStartAndNoStateBelowTheFold) {
  for (const double lambda : lambdas()) {
    const MaugisDugdale curve(lambda);
    for (const double c : {0.0, 1e-3, 0.1, 1.0, 30.0, 1e4}) {
      const Held spring{1.0, c};
      const CurvePoint fold = curve.fold(spring);
      const double end = fold.held(spring);
      const double scale = std::fabs(end) + curve.range() + c;
      EXPECT_EQ(curve.solve(end - 1e-9 * scale, spring).status, CurveStatus::kNoState);
      double before = -1e300;
      for (double above = 1e-9 * scale; above < 1e5 * (1 + c); above *= 7) {
        const double z = end + above;
        const CurveSolution cold = curve.solve(z, spring);
        ASSERT_EQ(cold.status, CurveStatus::kOk) << lambda << ' ' << c << ' ' << above;
        const CurvePoint& p = cold.point;
        EXPECT_NEAR(p.held(spring), z, 1e-14 * (std::fabs(z) + scale));
        EXPECT_GT(p.overlap_rate, 0);
        EXPECT_GT(p.held_rate(spring), 0);
        EXPECT_GT(p.overlap, before);
        before = p.overlap;
        for (const double guess : {1e-12, 1e-3, 1.0, 1e3, lambda * lambda, 1e12}) {
          const CurveSolution warm = curve.solve(z, spring, guess);
          ASSERT_EQ(warm.status, CurveStatus::kOk);
          // Just above a fold the root itself is only as sharp as the square root of the rounding of Z.
          EXPECT_NEAR(warm.point.load, p.load,
                      1e-12 * (1 + std::fabs(p.load)) +
                          4e-15 * (std::fabs(z) + scale) * std::fabs(p.load_rate / p.held_rate(spring)))
              << lambda << ' ' << c << ' ' << above << ' ' << guess;
        }
      }
    }
  }
}

}  // namespace
}  // namespace telenano::physics
