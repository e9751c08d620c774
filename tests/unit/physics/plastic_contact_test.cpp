#include "telenano/nve_server/physics/law/plastic_contact.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/contact/flow_family.h"
#include "tests/support/alloc_guard.h"

// Oracles: Thornton's closed forms where adhesion is negligible; an independent integration of the flow rule;
// work against energy.
namespace telenano::physics {
namespace {

constexpr double kModulus = 60.0;  // K, GPa
constexpr double kHardness = 2.0;
constexpr double kRadius = 20.0;

TipSampleLaw law_of(double adhesion_n_m, double modulus = kModulus, bool van_der_waals = false) {
  TipSampleParameters p;
  p.contact_modulus_gpa = modulus;
  p.work_of_adhesion_n_m = adhesion_n_m;
  p.van_der_waals = van_der_waals;
  return TipSampleLaw(p);
}

// w so small that its pull-off is 1e-8 nN or so.
PlasticContact hertz() {
  return PlasticContact(law_of(1e-10), kHardness);
}

// A place on a surface, pressed as the surface would be.
struct Place {
  double base_nm(double z) const { return z - depth; }
  Equilibrium to(const PlasticContact& contact, double z, double compliance) {
    const PlasticStep step = contact.advance(base_nm(z), compliance, radius, origin, state);
    if (step.flow.depth_nm > 0) {
      depth += step.flow.depth_nm;
      radius = step.flow.radius_nm;
      rim = step.flow.contact_radius_nm;
    }
    flow_dissipated += step.flow.dissipated_aj;
    dissipated += step.equilibrium.dissipated_aj;
    stored = step.equilibrium.potential_aj +
             0.5 * compliance * step.equilibrium.force_nn * step.equilibrium.force_nn;
    return step.equilibrium;
  }
  double origin = kRadius;
  double radius = kRadius;
  double depth = 0;
  double rim = 0;
  double dissipated = 0;
  double flow_dissipated = 0;
  double stored = 0;
  TipSampleState state;
};

struct Thornton {
  double strain = kPi * kHardness / kModulus;
  double first = strain * kRadius;
  double overlap_first = first * first / kRadius;
  double force_first = kPi * kHardness * first * first;
  double load(double overlap) const {
    return overlap <= overlap_first ? kModulus * std::sqrt(kRadius) * overlap * std::sqrt(overlap)
                                    : force_first + kPi * kHardness * kRadius * (overlap - overlap_first);
  }
};

TEST(PlasticContact, LoadsAlongThorntonsLine) {
  const PlasticContact contact = hertz();
  const Thornton oracle;
  Place place;
  for (double z = 0.01; z < 5.0; z += 0.05) {
    // 1e-6: what adhesion of 1e-10 N/m still does.
    EXPECT_NEAR(place.to(contact, z, 0.0).force_nn, oracle.load(z), 1e-6 * (1.0 + oracle.load(z))) << z;
  }
}

TEST(PlasticContact, TellsTheOverlapWithTheSurfaceAsItWas) {
  TipSampleState state;
  const PlasticStep step = hertz().advance(3.0, 0.01, kRadius, kRadius, state);
  EXPECT_GT(step.flow.depth_nm, 0.1);
  EXPECT_NEAR(step.equilibrium.overlap_nm, 3.0 - 0.01 * step.equilibrium.force_nn,
              1e-9);  // the spring's line
}

TEST(PlasticContact, UnloadsAsHertzOnTheFlattenedRadiusToTheResidualDepth) {
  const PlasticContact contact = hertz();
  const Thornton oracle;
  Place place;
  const double deepest = 3.0;
  place.to(contact, deepest, 0.0);
  const double a = std::sqrt(kRadius * deepest);
  const double residual = a * a / kRadius - oracle.strain * a;
  EXPECT_NEAR(place.depth, residual, 1e-7);
  EXPECT_NEAR(place.radius, a / oracle.strain, 1e-6);
  EXPECT_NEAR(place.rim, a, 1e-7);
  for (double z = deepest - 0.01; z > residual; z -= 0.04) {
    const double expected = kModulus * std::sqrt(a / oracle.strain) * std::pow(z - residual, 1.5);
    EXPECT_NEAR(place.to(contact, z, 0.0).force_nn, expected, 1e-6 * (1.0 + expected)) << z;
  }
  EXPECT_NEAR(place.to(contact, residual - 0.01, 0.0).force_nn, 0.0, 1e-6);
  EXPECT_NEAR(place.depth, residual, 1e-7);
}

TEST(PlasticContact, LosesWhatThorntonsLoadAndUnloadEnclose) {
  const PlasticContact contact = hertz();
  const Thornton oracle;
  const double deepest = 3.0;
  const double a = std::sqrt(kRadius * deepest);
  // Elastic to first yield, the line, less the elastic energy 2/5 K √R_p (a²/R_p)^(5/2).
  const double rest = deepest - oracle.overlap_first;
  const double in = 0.4 * kModulus * std::sqrt(kRadius) * std::pow(oracle.overlap_first, 2.5) +
                    oracle.force_first * rest + 0.5 * kPi * kHardness * kRadius * rest * rest;
  const double radius = a / oracle.strain;
  const double back = 0.4 * kModulus * std::sqrt(radius) * std::pow(a * a / radius, 2.5);
  for (const int steps : {1, 7, 300}) {
    Place place;
    for (int i = 1; i <= steps; ++i) place.to(contact, deepest * i / steps, 0.0);
    EXPECT_NEAR(place.flow_dissipated, in - back, 1e-6 * in) << steps;
    place.to(contact, -1.0, 0.0);
    EXPECT_NEAR(place.dissipated, in - back, 1e-6 * in) << steps;
  }
}

// dD/da* = F (2a*/R − 1.2 ε), the derivation in the header.
TEST(PlasticContact, DissipationRateIsThatOfHertz) {
  const PlasticContact contact = hertz();
  const Thornton oracle;
  Place place;
  place.to(contact, 1.5, 0.0);
  for (double z = 1.5; z < 4.0; z += 0.3) {
    const double before = place.flow_dissipated;
    const double a0 = place.rim;
    place.to(contact, z + 1e-3, 0.0);
    const double a = 0.5 * (a0 + place.rim);
    const double expected = kPi * kHardness * a * a * (2.0 * a / kRadius - 1.2 * oracle.strain);
    if (place.rim > a0) {
      EXPECT_GT(place.flow_dissipated, before);
    }
    const double step = place.rim - a0;
    if (step < 0.01) {
      EXPECT_NEAR((place.flow_dissipated - before) / step, expected, 1e-4 * expected);
    }
    place.to(contact, z + 0.3, 0.0);
  }
}

TEST(PlasticContact, OneStepIsAsGoodAsMany) {
  for (const double adhesion : {1e-10, 0.05, 0.4}) {
    for (const double compliance : {0.0, 0.02, 1.0}) {
      const PlasticContact contact(law_of(adhesion, kModulus, true), kHardness);
      Place one, many;
      const double z = 2.0 + 400.0 * compliance;
      const Equilibrium at_once = one.to(contact, z, compliance);
      Equilibrium stepped;
      for (int i = 0; i <= 500; ++i) stepped = many.to(contact, -5.0 + (z + 5.0) * i / 500, compliance);
      ASSERT_EQ(at_once.status, SolveStatus::kOk);
      EXPECT_GT(one.depth, 0.1);
      // a* to 1e-9 is the yield rule's slack.
      EXPECT_NEAR(at_once.force_nn, stepped.force_nn, 1e-7 * (1.0 + stepped.force_nn))
          << adhesion << ' ' << compliance;
      EXPECT_NEAR(one.depth, many.depth, 1e-7 * many.depth) << adhesion << ' ' << compliance;
      EXPECT_NEAR(one.radius, many.radius, 1e-7 * many.radius) << adhesion << ' ' << compliance;
    }
  }
}

// The flow rule taken by itself, step by small step, with nothing but the elastic law: lower the surface and
// raise R_eff by dδ_p/da* and dR_p/da* until the force no longer exceeds πHa*² − 2πwR.
TEST(PlasticContact, FollowsTheFlowRuleIntegratedByItself) {
  const double adhesion = 0.2, compliance = 0.01;
  const TipSampleLaw law = law_of(adhesion, kModulus, true);
  const PlasticContact contact(law, kHardness);
  const double strain = kPi * kHardness / kModulus;
  TipSampleState state;
  double a = strain * kRadius, depth = 0;
  double force = 0;
  const double da = 1e-4;
  const double z_end = 4.0;
  for (double z = -1.0; z < z_end + 1e-9; z += 0.01) {
    while (true) {
      const Equilibrium eq = law.advance(z - depth, compliance, a / strain, state);
      force = eq.force_nn;
      if (!(force > std::max(0.0, kPi * (kHardness * a * a - 2 * adhesion * kRadius)))) break;
      const double middle = a + 0.5 * da;
      depth += (2 * middle / kRadius - strain) * da;
      a += da;
    }
  }
  Place place;
  const Equilibrium eq = place.to(contact, z_end, compliance);
  // The rule by itself overshoots by up to da: 1e-4 of 8 nm, twice that in area.
  EXPECT_NEAR(place.rim, a, 2 * da);
  EXPECT_NEAR(place.depth, depth, 2e-4);
  EXPECT_NEAR(eq.force_nn, force, 1e-4 * force);
}

// Fully plastic under adhesion alone (Maugis and Pollock): πHa₀² = 2πwR, whatever the elastic law makes of
// the flattened place; the depth from a₀ by the closed form. Polystyrene and PMMA under a silicon tip.
TEST(PlasticContact, AdhesionAloneSinksALittle) {
  struct Sample {
    double modulus, adhesion, hardness;
  };
  for (const Sample& s : {Sample{3.13, 0.2298, 0.2}, Sample{4.543, 0.1789, 0.25}}) {
    const PlasticContact contact(law_of(s.adhesion, s.modulus, true), s.hardness);
    const double strain = kPi * s.hardness / s.modulus;
    const double a = std::sqrt(2 * s.adhesion * kRadius / s.hardness);
    const double expected = a * a / kRadius - strain * a;
    EXPECT_NEAR(contact.zero_load_depth_nm(kRadius), expected, 1e-12);
    EXPECT_LT(expected, 1.0);
    Place place;
    const double compliance = 1e4;  // nearly load control: 1e-4 nN a nm
    for (double load = -2.0; load <= 1e-3; load += 1e-3) place.to(contact, compliance * load, compliance);
    // A load of 1e-3 nN is 1e-4 of 2πwR, and so is its share of a₀².
    EXPECT_NEAR(place.depth, expected, 1e-3 * expected);
    // 1000 times up and down without load it sinks no further.
    for (int i = 0; i < 1000; ++i) place.to(contact, compliance * (i % 2 == 0 ? -2.0 : 0.0), compliance);
    EXPECT_NEAR(place.depth, expected, 1e-3 * expected);
  }
  // Silicon oxide: elastic without load.
  EXPECT_EQ(PlasticContact(law_of(0.4, 68.0), 9.0).zero_load_depth_nm(kRadius), 0.0);
  // Hertz's contact has no adhesion that could.
  TipSampleParameters p;
  p.contact_modulus_gpa = 3.0;
  p.work_of_adhesion_n_m = 0.2;
  p.van_der_waals = false;
  p.model = ContactLaw::kHertz;
  EXPECT_EQ(PlasticContact(TipSampleLaw(p), 0.2).zero_load_depth_nm(kRadius), 0.0);
}

// The derivation in the header, by finite differences of the law's own potential on both sides of JKR and
// DMT.
TEST(PlasticContact, DissipationOfAStickySampleIsPositiveAndThatOfTheClosedForm) {
  for (const double modulus : {3.13, 30.0, 300.0}) {
    const double hardness = 0.06 * modulus, adhesion = 0.2;
    TipSampleParameters p;
    p.contact_modulus_gpa = modulus;
    p.work_of_adhesion_n_m = adhesion;
    p.van_der_waals = false;
    p.model = ContactLaw::kJkr;
    const PlasticContact contact{TipSampleLaw(p), hardness};
    const double strain = kPi * hardness / modulus;
    Place place;
    double last = place.rim;
    for (double z = -1.0; z < 6.0; z += 1e-3) {
      const double before = place.flow_dissipated;
      const Equilibrium eq = place.to(contact, z, 0.0);
      ASSERT_GE(place.flow_dissipated, before);
      if (last > strain * kRadius && place.rim > last && place.rim < 1.01 * last) {
        const double a = 0.5 * (last + place.rim);
        const double f = std::max(0.0, 1 - 2 * adhesion * kRadius / (hardness * a * a));
        const double y = eq.contact_radius_nm / place.rim;
        const double x = a / (strain * kRadius);
        const double expected =
            strain * strain * modulus * a * a * (f * (2 * x - 1 - y * y / 3) + 2.0 / 15.0 * std::pow(y, 5));
        // y of the step's end stands for its middle: the step's length, 1e-3 nm of some 0.3.
        EXPECT_NEAR((place.flow_dissipated - before) / (place.rim - last), expected, 6e-3 * expected)
            << modulus << ' ' << z;
      }
      last = place.rim;
    }
    EXPECT_GT(place.flow_dissipated, 0.0);
  }
}

TEST(PlasticContact, AdhesionAloneYieldsOnlyWhilePressed) {
  // Soft, sticky: at zero load K a/(πR) is well above H, under a pull nothing flows.
  const PlasticContact contact(law_of(0.5, 20.0), 0.3);
  Place place;
  for (double z = -2.0; z < 1.0; z += 0.01) {
    const Equilibrium eq = place.to(contact, z, 0.0);
    if (place.depth > 0) {
      const double area = kPi * eq.contact_radius_nm * eq.contact_radius_nm;
      EXPECT_LT(eq.force_nn / area, 0.3);  // less than hardness: adhesion helped
      break;
    }
    EXPECT_LE(eq.force_nn, 1e-6);
  }
  EXPECT_GT(place.depth, 0.0);
}

TEST(PlasticContact, WorkIsStoredOrLostOverAClosedLoop) {
  for (const double adhesion : {1e-6, 0.05, 0.5}) {
    for (const double compliance : {0.0, 0.05}) {
      const PlasticContact contact(law_of(adhesion, kModulus, true), kHardness);
      Place place;
      double work = 0, scale = 0;
      double last = place.to(contact, -3.0, compliance).force_nn, z = -3.0;
      double lost = place.dissipated, stored = place.stored;
      const auto go = [&](double target, double step) {
        const int n = static_cast<int>(std::abs(target - z) / step);
        const double from = z;
        for (int i = 1; i <= n; ++i) {
          const double next = from + (target - from) * i / n;
          const double jumped_before = place.dissipated - place.flow_dissipated;
          const double stored_before = place.stored, lost_before = place.dissipated;
          const auto there = place.to(contact, next, compliance);
          const double force = there.force_nn;
          // A rigid base loses nothing at the pull-off, where the potentials meet (joined_law.h).
          const bool jumped = there.jumps > 0 || place.dissipated - place.flow_dissipated > jumped_before;
          work += jumped ? place.stored - stored_before + place.dissipated - lost_before
                         : 0.5 * (force + last) * (next - z);
          scale += std::abs(force * (next - z));
          last = force;
          z = next;
        }
      };
      go(0.5, 2e-4);
      go(4.0 + compliance * 1000, 1e-3);
      go(2.0, 1e-3);
      go(6.0 + compliance * 1000, 1e-3);
      go(-3.0, 5e-4);
      // The trapezium's own error, step² of curvature, dominates: greatest next to a jump. 4e-6 is three
      // times what it is there.
      EXPECT_NEAR(work, place.stored - stored + place.dissipated - lost, 4e-6 * scale)
          << adhesion << ' ' << compliance;
      EXPECT_GT(place.flow_dissipated, 0.0);
    }
  }
}

TEST(PlasticContact, ReloadsElasticallyWithoutDrift) {
  const PlasticContact contact(law_of(0.1, kModulus, true), kHardness);
  Place place;
  const double compliance = 0.02;
  const double force = place.to(contact, 5.0, compliance).force_nn;
  const double depth = place.depth, radius = place.radius, lost = place.flow_dissipated;
  for (int i = 0; i < 10000; ++i) {
    place.to(contact, i % 2 == 0 ? 1.0 : 4.9, compliance);
    EXPECT_NEAR(place.to(contact, 5.0, compliance).force_nn, force, 1e-7 * force);
  }
  EXPECT_EQ(place.depth, depth);
  EXPECT_EQ(place.radius, radius);
  EXPECT_EQ(place.flow_dissipated, lost);
}

TEST(PlasticContact, FlattensARidgeSharperThanTheOrigin) {
  const PlasticContact contact = hertz();
  Place ridge;
  ridge.radius = 0.4 * kRadius;
  const double strain = kPi * kHardness / kModulus;
  ridge.to(contact, 0.9 * 0.4 * kRadius * strain * strain, 0.0);  // a²/R_eff just below yield there
  EXPECT_EQ(ridge.depth, 0.0);
  ridge.to(contact, 3.0 * 0.4 * kRadius * strain * strain, 0.0);
  // dδ_p/da* = ε and δ = δ_p + εa*: from a₀ = ε R₀ on, δ − δ₀ = 2ε (a* − a₀).
  const double first = strain * 0.4 * kRadius;
  const double a = first + (3.0 - 1.0) * first * strain / (2 * strain);
  EXPECT_NEAR(ridge.rim, a, 1e-6);
  EXPECT_NEAR(ridge.depth, strain * (a - first), 1e-7);
}

TEST(PlasticContact, RefusesBadInputAndKeepsTheState) {
  const TipSampleLaw law = law_of(0.1);
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::infinity(), std::nan("")}) {
    EXPECT_THROW(PlasticContact(law, bad), UserError);
  }
  const PlasticContact contact(law, 1.0);
  TipSampleState state;
  contact.advance(0.1, 0.0, kRadius, kRadius, state);
  const double overlap = state.overlap_nm;
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), -1.0}) {
    const PlasticStep step = contact.advance(0.5, 0.0, kRadius, bad, state);
    EXPECT_EQ(step.equilibrium.status, SolveStatus::kNonFinite);
    EXPECT_EQ(step.equilibrium.force_nn, 0.0);
    EXPECT_EQ(contact.advance(0.5, 0.0, bad, kRadius, state).equilibrium.status, SolveStatus::kNonFinite);
  }
  EXPECT_EQ(state.overlap_nm, overlap);
}

// FlowFamily one by one is the oracle: that of a family is its plastic contact, above.
TEST(FlowFamily, OfTwoPlacesHasTheBitsOfEach) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> unit(0, 1);
  int stayed = 0, reached_last = 0, first = 0;
  for (int i = 0; i < 20000; ++i) {
    const double strain = 0.01 + 0.5 * unit(random), last = 1 + 30 * unit(random);
    double origin[2], from[2], depth[2], after[2];
    for (int k = 0; k < 2; ++k) {
      origin[k] = 1 + 100 * unit(random);
      from[k] = (unit(random) < 0.1 ? 1.0 : 2 * unit(random)) * strain * origin[k];
      depth[k] = unit(random) < 0.1 ? 0.0 : std::exp2(12 * unit(random) - 10);
    }
    _mm_storeu_pd(after, elastic_after_two_nm(strain, _mm_loadu_pd(origin), last, _mm_loadu_pd(from),
                                              _mm_loadu_pd(depth)));
    for (int k = 0; k < 2; ++k) {
      const FlowFamily family(strain, origin[k], last);
      const double a = family.after_nm(from[k], depth[k]), want = family.elastic_nm(a);
      ASSERT_EQ(std::bit_cast<std::uint64_t>(after[k]), std::bit_cast<std::uint64_t>(want));
      first += from[k] < family.first_nm;
      stayed += a <= family.first_nm;
      reached_last += want == last;
    }
  }
  EXPECT_GT(std::min({first, stayed, reached_last}), 1000) << "each way is taken";
}

}  // namespace
}  // namespace telenano::physics
