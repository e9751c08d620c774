#include "telenano/nve_server/physics/potential/branch_potential.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

TipSampleParameters material(double modulus_gpa, double work_n_m) {
  TipSampleParameters p;
  p.contact_modulus_gpa = modulus_gpa;
  p.work_of_adhesion_n_m = work_n_m;
  return p;
}
TipSampleParameters
silicon_oxide() {  // λ = 0.74 at 20 nm: radii on both sides of 0.717 and of the onset's 0.938
  return material(70.0, 0.4);
}
TipSampleParameters polystyrene() {  // λ = 4
  return material(3.1, 0.23);
}
TipSampleParameters hard() {  // λ = 0.1
  return material(700.0, 0.1);
}

/// What the law itself says with the overlap held.
Equilibrium law_at(const TipSampleLaw& law, double overlap, double radius, bool inside) {
  TipSampleState state;
  if (inside) {
    law.advance(0.5 * radius, 0.0, radius, state);
  } else {
    law.advance(-100.0, 0.0, radius, state);
  }
  return law.advance(overlap, 0.0, radius, state);
}

struct Place {
  double overlap;
  double log_radius;
  bool inside;
};

/// Places of both branches, away from folds: Δ at least 0.02 from where the stable segment ends.
std::vector<Place> places(const BranchPotential& w, int count) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  std::vector<Place> out;
  while (static_cast<int>(out.size()) < count) {
    const double rho = std::log(20.0) + 3.0 * (any(random) - 0.4);
    const BranchPotential::Borders b = w.borders(rho);
    const double unit = w.law().scales(std::exp(rho)).overlap_nm;
    if (any(random) < 0.6) {
      const double deep = any(random);
      out.push_back({b.leave_nm + 0.02 * unit + 10.0 * unit * deep * deep, rho, true});
    } else {
      out.push_back({b.enter_nm - 1e-3 - std::pow(10.0, 4.0 * any(random) - 2.0), rho, false});
    }
  }
  return out;
}

PotentialJet jet_at(const BranchPotential& w, const Place& p) {
  PotentialJet jet;
  if (!p.inside) {
    w.outside(p.overlap, p.log_radius, jet);
    return jet;
  }
  CurveHint hint;
  ContactSize size;
  EXPECT_TRUE(w.inside(p.overlap, p.log_radius, hint, jet, size))
      << "overlap " << p.overlap << " ln R " << p.log_radius;
  return jet;
}

class BranchPotentialOf : public ::testing::TestWithParam<std::pair<std::string, TipSampleParameters>> {
 protected:
  TipSampleLaw law{GetParam().second, 20.0};
  BranchPotential w{law, 20.0};
  /// Force and energy that all tolerances are shares of.
  double force() const { return law.scales(20.0).force_nn; }
  double energy() const { return law.scales(20.0).energy_aj; }
};

TEST_P(BranchPotentialOf, HasTheLawsForceStiffnessAndEnergy) {
  for (const Place& p : places(w, 2000)) {
    const double radius = std::exp(p.log_radius);
    const Equilibrium exact = law_at(law, p.overlap, radius, p.inside);
    const bool inside = exact.branch == Branch::kContact || exact.branch == Branch::kNonContact;
    ASSERT_EQ(inside, p.inside) << p.overlap << " nm, R " << radius;
    const PotentialJet jet = jet_at(w, p);
    const double scale = 1.0 + std::fabs(exact.force_nn) / force();
    EXPECT_NEAR(jet.force_nn, exact.force_nn, 1e-6 * force() * scale) << p.overlap << " nm, R " << radius;
    EXPECT_NEAR(jet.energy_aj, exact.potential_aj,
                1e-6 * energy() * (1.0 + std::fabs(exact.potential_aj) / energy()))
        << p.overlap << " nm, R " << radius << " inside " << p.inside;
    EXPECT_NEAR(jet.stiffness_n_m, exact.stiffness_n_m,
                2e-4 * (std::fabs(exact.stiffness_n_m) + force() / law.scales(20.0).overlap_nm))
        << p.overlap << " nm, R " << radius << " inside " << p.inside;
  }
}

// The force is the law's, the sum Gauss's: no derivative or energy of ours is in it.
TEST_P(BranchPotentialOf, EnergyIsTheIntegralOfTheLawsForce) {
  constexpr std::array<double, 4> kNode = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                                           0.9602898564975363};
  constexpr std::array<double, 4> kWeight = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                                             0.1012285362903763};
  for (const double radius : {8.0, 18.0, 19.5, 45.0, 200.0}) {
    const double rho = std::log(radius);
    const BranchPotential::Borders b = w.borders(rho);
    const double unit = law.scales(radius).overlap_nm;
    double from = b.leave_nm + 0.05 * unit;
    const double start = jet_at(w, {from, rho, true}).energy_aj;
    double integral = 0;
    for (int i = 0; i < 400; ++i) {
      const double to = from + 0.01 * unit;
      for (std::size_t k = 0; k < 4; ++k) {
        for (const double side : {-1.0, 1.0}) {
          const double at = 0.5 * (from + to) + side * kNode[k] * 0.5 * (to - from);
          integral += kWeight[k] * 0.5 * (to - from) * law_at(law, at, radius, true).force_nn;
        }
      }
      from = to;
    }
    EXPECT_NEAR(jet_at(w, {from, rho, true}).energy_aj - start, integral, 1e-6 * law.scales(radius).energy_aj)
        << radius;
  }
}

// Central differences over 1e-4 of ρ: their own error is some 1e-8 of the energy, that of the law's energy
// over the step 1e-9.
TEST_P(BranchPotentialOf, RadiusForceIsThatOfTheLawsEnergy) {
  constexpr double kStep = 1e-4;
  for (const Place& p : places(w, 500)) {
    if (p.inside != (law_at(law, p.overlap, std::exp(p.log_radius + kStep), p.inside).branch >=
                     Branch::kNonContact) ||
        p.inside != (law_at(law, p.overlap, std::exp(p.log_radius - kStep), p.inside).branch >=
                     Branch::kNonContact)) {
      continue;
    }
    const double up = law_at(law, p.overlap, std::exp(p.log_radius + kStep), p.inside).potential_aj;
    const double down = law_at(law, p.overlap, std::exp(p.log_radius - kStep), p.inside).potential_aj;
    const PotentialJet jet = jet_at(w, p);
    EXPECT_NEAR(jet.by_radius_aj, (up - down) / (2.0 * kStep),
                1e-6 * energy() * (1.0 + std::fabs(jet.energy_aj) / energy()))
        << p.overlap << " nm, R " << std::exp(p.log_radius) << " inside " << p.inside;
  }
}

// All second derivatives against differences of the first, mixed ones both ways.
TEST_P(BranchPotentialOf, SecondDerivativesAreThoseOfTheFirst) {
  constexpr double kStep = 1e-5;
  for (const Place& p : places(w, 500)) {
    if (p.inside && p.overlap < w.borders(p.log_radius).leave_nm + 0.05 * law.scales(20.0).overlap_nm)
      continue;
    const auto at = [&](double deeper, double wider) {
      return jet_at(w, {p.overlap + deeper, p.log_radius + wider, p.inside});
    };
    const PotentialJet jet = jet_at(w, p);
    const PotentialJet deeper = at(kStep, 0), higher = at(-kStep, 0), wider = at(0, kStep),
                       narrower = at(0, -kStep);
    const double force_scale = force() + std::fabs(jet.force_nn) + std::fabs(jet.stiffness_n_m) * 0.1;
    const double energy_scale = energy() + std::fabs(jet.energy_aj) + force_scale * 0.1;
    const double half = 1.0 / (2.0 * kStep);
    SCOPED_TRACE(std::to_string(p.overlap) + " nm, R " + std::to_string(std::exp(p.log_radius)) +
                 (p.inside ? " inside" : " outside"));
    EXPECT_NEAR(jet.force_nn, (deeper.energy_aj - higher.energy_aj) * half, 1e-5 * force_scale);
    EXPECT_NEAR(jet.stiffness_n_m, (deeper.force_nn - higher.force_nn) * half, 1e-3 * force_scale);
    EXPECT_NEAR(jet.mixed_nn, (wider.force_nn - narrower.force_nn) * half, 1e-3 * force_scale);
    EXPECT_NEAR(jet.mixed_nn, (deeper.by_radius_aj - higher.by_radius_aj) * half, 1e-3 * force_scale);
    EXPECT_NEAR(jet.by_radius_twice_aj, (wider.by_radius_aj - narrower.by_radius_aj) * half,
                1e-3 * energy_scale);
  }
}

// On both sides of λ = 0.717, where one border becomes two.
TEST_P(BranchPotentialOf, BordersAreThoseOfTheLaw) {
  for (double rho = std::log(2.0); rho < std::log(2000.0); rho += 0.0371) {
    const BranchPotential::Borders b = w.borders(rho);
    const double unit = energy() * std::exp((4.0 / 3.0) * (rho - std::log(20.0)));
    const double newton = force() * std::exp(rho - std::log(20.0));
    PotentialJet out;
    w.outside(b.enter_nm, rho, out);
    const PotentialJet in = jet_at(w, {b.enter_nm, rho, true});
    // The border's own 1e-9 nm, near the fold on a force that goes like a square root.
    EXPECT_NEAR(in.force_nn, out.force_nn, 1e-6 * newton + 1e-9 * std::fabs(in.stiffness_n_m))
        << std::exp(rho);
    if (b.reversible) {
      EXPECT_EQ(b.enter_nm, b.leave_nm);
      EXPECT_NEAR(in.energy_aj, out.energy_aj, 1e-8 * unit) << std::exp(rho);
      EXPECT_NEAR(in.by_radius_aj, out.by_radius_aj, 1e-6 * (unit + std::fabs(out.energy_aj)))
          << std::exp(rho);
    } else {
      EXPECT_LT(b.leave_nm, b.enter_nm);
      EXPECT_LT(in.energy_aj, out.energy_aj) << std::exp(rho);  // going in loses, never gains
      w.outside(b.leave_nm, rho, out);
      EXPECT_NEAR(jet_at(w, {b.leave_nm + 1e-8, rho, true}).energy_aj, out.energy_aj, 1e-6 * unit)
          << std::exp(rho);
    }
  }
}

TEST_P(BranchPotentialOf, ContactRadiusIsTheLaws) {
  constexpr double kStep = 1e-5;
  for (const Place& p : places(w, 500)) {
    if (!p.inside) continue;
    const auto size = [&](double overlap, double rho) {
      CurveHint hint;
      PotentialJet jet;
      ContactSize s;
      EXPECT_TRUE(w.inside(overlap, rho, hint, jet, s));
      return s;
    };
    const ContactSize s = size(p.overlap, p.log_radius);
    const double radius = std::exp(p.log_radius);
    const double a = law_at(law, p.overlap, radius, true).contact_radius_nm;
    const double square = std::pow(law.scales(radius).length_nm, 2) + a * a;
    EXPECT_NEAR(s.square_nm2, a * a, 1e-6 * square);
    if (s.square_nm2 < 1e-2 * square) continue;  // its rates bend where contact begins
    EXPECT_NEAR(s.by_overlap_nm,
                (size(p.overlap + kStep, p.log_radius).square_nm2 -
                 size(p.overlap - kStep, p.log_radius).square_nm2) /
                    (2 * kStep),
                1e-3 * square / law.scales(radius).overlap_nm);
    EXPECT_NEAR(s.by_log_radius_nm2,
                (size(p.overlap, p.log_radius + kStep).square_nm2 -
                 size(p.overlap, p.log_radius - kStep).square_nm2) /
                    (2 * kStep),
                1e-3 * square);
  }
}

TipSampleParameters with_far(TipSampleParameters p) {
  p.long_range.retardation_nm = 100.0;
  p.long_range.cone_half_angle_deg = 20.0;
  p.long_range.cone_height_nm = 10000.0;
  return p;
}
TipSampleParameters of(ContactLaw model, bool van_der_waals) {
  TipSampleParameters p = silicon_oxide();
  p.model = model;
  p.van_der_waals = van_der_waals;
  return p;
}

INSTANTIATE_TEST_SUITE_P(Laws, BranchPotentialOf,
                         ::testing::Values(std::pair{"oxide", silicon_oxide()},
                                           std::pair{"polystyrene", polystyrene()}, std::pair{"hard", hard()},
                                           std::pair{"far", with_far(silicon_oxide())},
                                           std::pair{"dmt", of(ContactLaw::kDmt, true)},
                                           std::pair{"jkr", of(ContactLaw::kJkr, true)},
                                           std::pair{"schwarz", of(ContactLaw::kSchwarz, true)},
                                           std::pair{"cos", of(ContactLaw::kCarpickOgletreeSalmeron, true)},
                                           std::pair{"pt", of(ContactLaw::kPietrementTroyon, true)}),
                         [](const auto& of_law) { return of_law.param.first; });

TEST(BranchPotential, BiasIsOfItsOwnAndHeldFromTouchOn) {
  TipSampleParameters p = silicon_oxide();
  p.long_range.tip_bias_v = 3.0;
  const TipSampleLaw law(p, 20.0);
  const BranchPotential w(law, 20.0);
  ASSERT_TRUE(w.has_bias());
  LongRangeParameters only;
  only.tip_bias_v = 3.0;
  const LongRange exact(only, 0.0, p.equilibrium_distance_nm);
  for (const double radius : {3.0, 20.0, 300.0}) {
    const double touch = -exact.evaluate(0.0, radius, {}).force_nn;
    for (const double overlap : {-1000.0, -30.0, -1.0, -0.1, -1e-3, 0.5, 3.0}) {
      PotentialJet jet;
      w.add_bias(overlap, std::log(radius), jet);
      const double size = std::fabs(exact.evaluate(overlap, radius, {}).force_nn);
      EXPECT_NEAR(jet.force_nn, exact.evaluate(overlap, radius, {}).force_nn, 1e-6 * size + 1e-9 * touch)
          << overlap;
      EXPECT_NEAR(jet.energy_aj, exact.energy_aj(overlap, radius, {}),
                  1e-6 * std::fabs(exact.energy_aj(overlap, radius, {})))
          << overlap;
    }
  }
}

TEST(BranchPotential, WithoutVanDerWaalsNothingIsOutside) {
  TipSampleParameters p = silicon_oxide();
  p.van_der_waals = false;
  const TipSampleLaw law(p, 20.0);
  const BranchPotential w(law, 20.0);
  PotentialJet out;
  w.outside(-0.5, std::log(20.0), out);
  EXPECT_EQ(out.energy_aj, 0.0);
  EXPECT_EQ(out.force_nn, 0.0);
  const BranchPotential::Borders b = w.borders(std::log(20.0));
  const double range = MaugisDugdale(law.lambda(20.0)).range() * law.scales(20.0).overlap_nm;
  EXPECT_NEAR(b.enter_nm, -range, 1e-9);
  EXPECT_LT(b.leave_nm, b.enter_nm);
}

// The wet branches are those of a dry law with the wet medium's work of adhesion (Young's equation, by hand).
TEST(BranchPotential, WetBranchesAreThoseOfTheWettedContact) {
  TipSampleParameters p = with_far(silicon_oxide());
  p.long_range.capillary.humidity_percent = 50;
  p.long_range.capillary.contact_angle_tip_deg = 20;
  p.long_range.capillary.contact_angle_sample_deg = 60;
  const BranchPotential humid(TipSampleLaw(p), 20.0);
  TipSampleParameters q = with_far(silicon_oxide());
  q.work_of_adhesion_n_m -= 0.0728 * (std::cos(20 * 3.14159265358979 / 180) + 0.5);
  const BranchPotential wetted(TipSampleLaw(q), 20.0);
  const BranchPotential dry(TipSampleLaw(with_far(silicon_oxide())), 20.0);
  ASSERT_NE(humid.wet(), nullptr);
  EXPECT_EQ(dry.wet(), nullptr);
  for (const double radius : {3.0, 20.0, 150.0}) {
    for (const double overlap : {-3.0, -0.3, 0.05, 1.0}) {
      for (const bool inside : {false, true}) {
        if (inside != (overlap > 0.0)) continue;
        const Place at{overlap, std::log(radius), inside};
        const PotentialJet jet = jet_at(*humid.wet(), at), same = jet_at(wetted, at);
        EXPECT_NEAR(jet.energy_aj, same.energy_aj, 1e-9 * (1 + std::fabs(same.energy_aj)));
        EXPECT_NEAR(jet.force_nn, same.force_nn, 1e-8 * (1 + std::fabs(same.force_nn)));
        EXPECT_NEAR(jet_at(humid, at).energy_aj, jet_at(dry, at).energy_aj, 1e-12 * radius);
      }
    }
  }
  const double touch = humid.touch_energy_aj(std::log(20.0));
  EXPECT_NEAR(touch, jet_at(dry, {0.0, std::log(20.0), true}).energy_aj, 1e-6 * std::fabs(touch));
}

TEST(BranchPotential, RefusesWhatItDoesNotHave) {
  EXPECT_THROW(BranchPotential(TipSampleLaw(silicon_oxide()), 0.0), UserError);
}

}  // namespace
}  // namespace telenano::physics
