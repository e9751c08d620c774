#include "telenano/nve_server/physics/contact/maugis_table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/contact_paths.h"
#include "tests/support/md_oracle.h"

namespace telenano::physics {
namespace {

constexpr Held kOverlap{1.0, 0.0};

TipSampleParameters table_of(double lambda, bool van_der_waals) {
  TipSampleParameters p = testing::material_of(lambda, van_der_waals);
  p.method = MaugisMethod::kTable;
  return p;
}

TEST(MaugisTable, ForceRadiusEnergyAgreeWithFiftyDigits) {
  double worst = 0;
  double worst_radius = 0;
  for (const double lambda : {1e-3, 0.5, 0.937, 0.938, 1.2e4}) {
    const oracle::MaugisDugdale oracle(lambda);
    const MaugisTable table(lambda);
    const double pull_off = std::fabs(oracle.pull_off_load());
    for (const double above : {1e-11, 3.1e-7, 1.9e-3, 0.043, 0.23, 0.71, 2.9, 31.0, 9.1e3}) {
      const double delta = std::max(oracle.onset_overlap(), oracle.fold_overlap()) + above;
      const oracle::MaugisDugdale::State want = oracle.at_overlap(delta);
      const CurveSolution got = table.solve(delta, kOverlap);
      ASSERT_EQ(got.status, CurveStatus::kOk);
      // What one rounding of delta does to the force, besides.
      const double ulp = std::min(std::fabs(want.slope) * 4e-16 * (1 + std::fabs(delta)),
                                  3 * std::sqrt(4e-16 * (1 + std::fabs(delta))));
      const double error =
          std::max(0.0, std::fabs(got.point.load - want.load) - ulp) / (std::fabs(want.load) + pull_off);
      worst = std::max(worst, error);
      EXPECT_LE(error, 1e-8) << lambda << ' ' << above;
      if (want.contact && above > 1e-8) {
        const double off =
            std::fabs(got.point.contact_radius - want.contact_radius) / (1 + want.contact_radius);
        worst_radius = std::max(worst_radius, off);
        EXPECT_LE(off, 1e-6) << lambda << ' ' << above;
      }
    }
    for (const double above : {0.3, 60.0}) {
      const double delta = std::max(oracle.onset_overlap(), oracle.fold_overlap()) + above;
      // The integral of a force that is within 1e-8.
      const double want = oracle.energy(delta);
      EXPECT_NEAR(table.solve(delta, kOverlap).point.energy, want,
                  1e-8 * (std::fabs(want) + 1 + above + 1 / lambda))
          << lambda << ' ' << above;
    }
  }
  std::printf("worst error of force %.2g, of contact radius %.2g\n", worst, worst_radius);
}

// The quick way to the force gives the bits of the slow one: at the start, in the first segment, at borders,
// in cells, beyond the table's end, without contact, below the end of the curve, and for nonsense.
TEST(MaugisTable, ForceAloneIsTheForceOfTheState) {
  for (const double lambda : {1e-3, 0.7, 0.95, 4.0, 1.2e4}) {
    const MaugisTable table(lambda);
    const auto check = [&](double delta) {
      EXPECT_EQ(table.load_at(delta), table.solve(delta, kOverlap).point.load) << lambda << ' ' << delta;
    };
    for (const double t :
         {0.0, 1e-9, 0x1p-17, 0x1.fffffffffffffp-17, 0x1p-16, 0x1.08p-16, 0x1.0ffffffffffffp-3, 0x1.1p-3,
          0.77, 1.0, 31.4, 0x1.fffffffffffffp9, 0x1p10, 3e3}) {
      check(table.start_overlap() + t * t);
    }
    for (double delta = -0.999 * table.range(); delta < 30; delta += 0.0137 * (1 + table.range()))
      check(delta);
    check(-1.001 * table.range() - 10);
    EXPECT_TRUE(std::isnan(table.load_at(std::nan(""))) || table.load_at(std::nan("")) <= 0);
  }
}

// Every segment border: the table on both sides of it is one function, and so is its derivative.
TEST(MaugisTable, ContinuousAndConsistentAcrossSegments) {
  for (const double lambda : {0.1, 0.95, 4.0, 1e4}) {
    const MaugisTable table(lambda);
    for (int e = -15; e < 9; ++e) {
      for (const double fraction : {1.0, 1.03125, 1.5, 1.96875}) {
        const double t = std::ldexp(fraction, e);
        const CurvePoint left = table.contact(std::nextafter(t, 0.0));
        const CurvePoint right = table.contact(t);
        const double size = 2 + std::fabs(right.load);
        EXPECT_NEAR(left.load, right.load, 1e-14 * size) << lambda << ' ' << t;
        EXPECT_NEAR(left.load_rate, right.load_rate, 1e-9 * (1 + std::fabs(right.load_rate)))
            << lambda << ' ' << t;
        EXPECT_NEAR(left.energy, right.energy, 1e-13 * (1 + 1 / lambda + std::fabs(right.energy)));
        // U' = P Delta', P' as stated: central differences, (h/t)^2 = 6e-6 times a small number of the value.
        const double h = t / 400;
        const double mid = t * (1 + 1.0 / 128);
        const CurvePoint m = table.contact(mid);
        const CurvePoint up = table.contact(mid + h);
        const CurvePoint down = table.contact(mid - h);
        EXPECT_NEAR((up.load - down.load) / (2 * h), m.load_rate,
                    1e-5 * (m.load_rate + size) + 1e-13 * size / h);
        EXPECT_NEAR((up.energy - down.energy) / (2 * h), m.load * m.overlap_rate,
                    3e-5 * size * m.overlap_rate + 1e-15 * (1 + 1 / lambda + std::fabs(m.energy)) / h);
      }
    }
  }
}

// Under any spring: what it finds is in balance, on the stable side, and the direct method finds the same.
TEST(MaugisTable, SpringsAgreeWithTheDirectMethod) {
  for (const double lambda : {1e-3, 0.1, 0.7, 0.9, 0.94, 1.5, 30.0, 1e4}) {
    const MaugisTable table(lambda);
    const MaugisDugdale& direct = table.exact();
    for (const double soft : {1e-3, 0.1, 1.0, 20.0, 1e3}) {
      const Held held{1.0, soft};
      const CurvePoint fold = direct.fold(held);
      const double z = fold.held(held);
      EXPECT_NEAR(table.fold(held).held(held), z, 1e-7 * (1 + soft)) << lambda << ' ' << soft;
      EXPECT_EQ(table.solve(z - 1e-6 * (1 + soft + std::fabs(z)), held).status, CurveStatus::kNoState);
      for (const double above : {1e-3, 0.1, 1.0, 10.0, 1e4, 1e9}) {
        const CurveSolution want = direct.solve(z + above, held);
        for (const double guess : {0.0, 1e-3, 0.7, 40.0}) {
          const CurveSolution got = table.solve(z + above, held, guess);
          ASSERT_EQ(got.status, CurveStatus::kOk) << lambda << ' ' << soft << ' ' << above << ' ' << guess;
          EXPECT_NEAR(got.point.held(held), z + above,
                      1e-14 * (1 + std::fabs(z) + above + soft * (2 + std::fabs(got.point.load))));
          // 1e-8 of force moves the balance by 1e-8 soft/(dZ/dDelta), which beside the fold is some 1e3.
          EXPECT_NEAR(got.point.load, want.point.load, 1e-6 * (2 + std::fabs(want.point.load)))
              << lambda << ' ' << soft << ' ' << above << ' ' << guess;
        }
      }
    }
  }
}

// A loop through the law by table: no energy made, the accounts agree with the work of the force.
TEST(MaugisTable, LoopNeverYieldsEnergy) {
  for (const double lambda : {1e-3, 0.1, 0.5, 0.74, 0.93, 0.94, 2.0, 50.0, 1.2e4}) {
    for (const bool vdw : {true, false}) {
      const TipSampleLaw law(table_of(lambda, vdw), 20);
      const ContactScales s = law.scales(20);
      for (const double soft : {0.0, 1.0}) {
        const double c = soft * s.overlap_nm / s.force_nn;
        const double far = -1.65 - (30 + 10 * soft) * s.overlap_nm;
        const double deep = 2 * s.overlap_nm;
        TipSampleState state;
        const double start = testing::stored_aj(law.advance(far, c, 20, state), c);
        const testing::WorkIntegral work(law, c, 20);
        double loop = work.run(far, deep, state, 1e-11 * s.energy_aj);
        const Equilibrium in = law.advance(deep, c, 20, state);
        loop += work.run(deep, far, state, 1e-11 * s.energy_aj);
        const Equilibrium out = law.advance(far, c, 20, state);
        const double scale = s.energy_aj * (1 + 2 / lambda);
        EXPECT_GE(loop, -1e-8 * scale) << lambda << ' ' << vdw << ' ' << soft;
        EXPECT_NEAR(loop, in.dissipated_aj + out.dissipated_aj, 1e-8 * scale)
            << lambda << ' ' << vdw << ' ' << soft;
        EXPECT_NEAR(testing::stored_aj(out, c), start, 1e-12 * scale);
      }
    }
  }
}

// A table is of one radius. At another one the direct method answers, and back at its own the table: both
// warm starts survive the change of parameter.
TEST(MaugisTable, NeverStale) {
  const TipSampleLaw table(table_of(0.8, true), 20);
  const TipSampleLaw direct(testing::material_of(0.8, true));
  const double unit = direct.scales(20).overlap_nm;
  TipSampleState both, other;
  for (int i = 0; i < 400; ++i) {
    const double radius = i % 4 < 2 ? 20.0 : 20.0 + 1e-9 * i + (i % 3);
    const double base = unit * (1.5 + 2.5 * std::sin(0.1 * i));
    const Equilibrium a = table.advance(base, 0.02, radius, both);
    const Equilibrium b = direct.advance(base, 0.02, radius, other);
    ASSERT_EQ(a.branch, b.branch) << i;
    // Between table and direct 1e-8; a table used at a radius 5 % off would be out by a per cent.
    ASSERT_NEAR(a.force_nn, b.force_nn, 1e-7 * direct.scales(20).force_nn) << i;
    ASSERT_NEAR(a.contact_radius_nm, b.contact_radius_nm, 1e-5 * direct.scales(20).length_nm) << i;
  }
}

// The law does use it: at its radius the force is the table's, to the bit, which is not the direct one's.
TEST(MaugisTable, IsWhatTheLawUsesAtItsRadius) {
  const TipSampleLaw law(table_of(0.8, true), 20);
  const TipSampleLaw direct(testing::material_of(0.8, true));
  const ContactScales s = law.scales(20);
  const MaugisTable table(s.lambda);
  int unlike = 0;
  for (const double overlap : {0.3, 0.77, 1.9, 4.3, 8.1}) {
    const double base = overlap * s.overlap_nm;
    const CurvePoint want = table.solve(base / s.overlap_nm, kOverlap).point;
    TipSampleState state, other;
    const Equilibrium got = law.advance(base, 0, 20, state);
    EXPECT_EQ(got.force_nn, want.load * s.force_nn);
    EXPECT_EQ(got.contact_radius_nm, want.contact_radius * s.length_nm);
    EXPECT_EQ(got.stiffness_n_m, want.load_rate / want.overlap_rate * (s.force_nn / s.overlap_nm));
    unlike += got.force_nn != direct.advance(base, 0, 20, other).force_nn;
    TipSampleState elsewhere, elsewhere_direct;
    EXPECT_EQ(law.advance(base, 0, 21, elsewhere).force_nn,
              direct.advance(base, 0, 21, elsewhere_direct).force_nn);
  }
  EXPECT_GT(unlike, 0);
}

TEST(MaugisTable, RefusesWhatMakesNoSense) {
  EXPECT_THROW(TipSampleLaw(table_of(0.8, true)), UserError);
  EXPECT_THROW(TipSampleLaw(table_of(0.8, true), -1), UserError);
  EXPECT_THROW(TipSampleLaw(table_of(1e7, true), 20), UserError);
  TipSampleParameters p = table_of(0.8, true);
  p.model = ContactLaw::kJkr;
  EXPECT_THROW(TipSampleLaw(p, 20), UserError);
}

}  // namespace
}  // namespace telenano::physics
