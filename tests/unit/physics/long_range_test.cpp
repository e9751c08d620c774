#include "telenano/nve_server/physics/long_range/long_range.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/multiprecision/cpp_dec_float.hpp>
#include <cmath>
#include <functional>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/contact_paths.h"

namespace telenano::physics {
namespace {

using testing::material_of;
using testing::silicon_on;
using testing::stored_aj;

using Real = boost::multiprecision::cpp_dec_float_50;

constexpr double kRadius = 20;
constexpr double kCutOff = 0.165;
constexpr double kHamaker = 0.1;

// Gregory's energy of sphere and plane as published, in 50 digits.
Real gregory(double radius, const Real& d, double wavelength) {
  const Real x = Real("5.32") * d / wavelength;
  return -Real(kHamaker) * radius / (6 * d) * (1 - x * log(1 + 1 / x));
}

// Central difference in 50 digits: 1e-24 of truncation, 1e-38 of rounding.
Real derivative(const std::function<Real(Real)>& f, const Real& x) {
  const Real h = x * Real("1e-12");
  return (f(x + h) - f(x - h)) / (2 * h);
}

// int over t from 0 to `height` of density(t), which varies on the scale of d + t: t = d (e^u - 1), composite
// Gauss–Legendre of three points on 1500 intervals, error below 1e-14 for the integrands here; long double.
long double over_profile(const std::function<long double(long double)>& density, long double d,
                         long double from, long double to) {
  constexpr long double kNode = 0.774596669241483377035853079956L;
  const long double low = std::log((d + from) / d), high = std::log((d + to) / d);
  constexpr int kParts = 1500;
  const long double half = (high - low) / (2 * kParts);
  long double sum = 0;
  for (int i = 0; i < kParts; ++i) {
    const long double centre = low + (2 * i + 1) * half;
    for (const auto& [node, weight] : {std::pair{-kNode, 5.0L / 9}, {0.0L, 8.0L / 9}, {kNode, 5.0L / 9}}) {
      const long double z = d * std::exp(centre + node * half);
      sum += weight * half * z * density(z - d);
    }
  }
  return sum;
}

TipShape shape(double angle_deg, double height) {
  return {std::sin(angle_deg * M_PI / 180), std::cos(angle_deg * M_PI / 180), height};
}

TEST(Retardation, IsGregorysEnergyAndItsDerivatives) {
  const VanDerWaals plain{kHamaker};
  for (const double wavelength : {20.0, 100.0, 1000.0}) {
    const TipVanDerWaals law(kHamaker, wavelength, {});
    for (const double d : {0.165, 0.5, 3.0, 30.0, 1e3, 1e5}) {
      const auto energy = [&](const Real& x) { return gregory(kRadius, x, wavelength); };
      const auto force = [&](const Real& x) { return Real(-derivative(energy, x)); };
      const LongRangePoint p = law.correction(d, kRadius);
      // Ulps, of the sum of the law and its correction, which cancel far away.
      const double tolerance = 1e-15;
      EXPECT_NEAR(plain.energy_aj(kRadius, d) + law.correction_energy_aj(d, kRadius),
                  static_cast<double>(energy(d)), 4 * tolerance * std::fabs(plain.energy_aj(kRadius, d)));
      EXPECT_NEAR(plain.force_nn(kRadius, d) + p.force_nn, static_cast<double>(force(d)),
                  tolerance * std::fabs(plain.force_nn(kRadius, d)));
      EXPECT_NEAR(plain.stiffness_n_m(kRadius, d) + p.stiffness_n_m,
                  static_cast<double>(-derivative(force, d)),
                  tolerance * std::fabs(plain.stiffness_n_m(kRadius, d)));
    }
  }
}

TEST(Cone, VanDerWaalsIsThePressureOverTheProfile) {
  const VanDerWaals plain{kHamaker};
  for (const double wavelength : {0.0, 100.0}) {
    const double b = wavelength > 0 ? 5.32 / wavelength : 0;
    for (const double angle : {5.0, 20.0, 45.0, 70.0}) {
      for (const double height : {0.5, 15.0, 500.0, 15000.0}) {
        const TipVanDerWaals law(kHamaker, wavelength, shape(angle, height));
        for (const double d : {0.165, 1.0, 20.0, 2000.0}) {
          const double sine = std::sin(angle * M_PI / 180), cosine = std::cos(angle * M_PI / 180);
          const double tangent = kRadius * (1 - sine);
          // Radius of the tip at t above the apex, and its slope: sphere, then the tangent.
          const auto ring = [&](long double t) {  // A'(t) = 2 pi rho drho/dt
            if (t < tangent) return 2 * M_PIl * (kRadius - t);
            const long double rho = kRadius * cosine + (t - tangent) * sine / cosine;
            return 2 * M_PIl * rho * sine / cosine;
          };
          // -d/dz of the energy of half spaces, H/(12 pi z^2 (1 + b z)).
          const auto pressure = [&](long double z) {
            return kHamaker / (12 * M_PIl) * (2 / z + b / (1 + b * z)) / (z * z * (1 + b * z));
          };
          const auto area_energy = [&](long double z) {
            return kHamaker / (12 * M_PIl) / (z * z * (1 + b * z));
          };
          const double joint = std::min(tangent, height);
          const auto integral = [&](const auto& f) {
            const auto g = [&](long double t) { return ring(t) * f(d + t); };
            return over_profile(g, d, 0, joint) + (height > joint ? over_profile(g, d, joint, height) : 0);
          };
          const double force = static_cast<double>(-integral(pressure));
          const double energy = static_cast<double>(-integral(area_energy));
          const LongRangePoint p = law.correction(d, kRadius);
          const TipVanDerWaals::Correction of_gap = law.correction(law.gap(d), kRadius);
          const double scale = std::fabs(plain.force_nn(kRadius, d)) + std::fabs(force);
          EXPECT_NEAR(plain.force_nn(kRadius, d) + p.force_nn, force, 3e-14 * scale)
              << wavelength << ' ' << angle << ' ' << height << ' ' << d;
          // Far from a short tip X(d) - X(d + h) cancels by d/h.
          EXPECT_NEAR(plain.energy_aj(kRadius, d) + law.correction_energy_aj(d, kRadius), energy,
                      3e-14 * (1 + d / height) * (scale * d + std::fabs(energy)));
          // The same by way of what no radius enters.
          EXPECT_NEAR(plain.force_nn(kRadius, d) + of_gap.force_nn, force, 3e-14 * scale)
              << wavelength << ' ' << angle << ' ' << height << ' ' << d;
          EXPECT_NEAR(plain.energy_aj(kRadius, d) + of_gap.energy_aj, energy,
                      3e-14 * (1 + d / height) * (scale * d + std::fabs(energy)));
          // Stiffness: central difference of the force, h^2.
          const double h = 1e-4 * d;
          EXPECT_NEAR(
              p.stiffness_n_m,
              (law.correction(d - h, kRadius).force_nn - law.correction(d + h, kRadius).force_nn) / (2 * h),
              1e-7 * scale / d);
        }
      }
    }
  }
}

TEST(Cone, ElectrostaticIsTheFieldPressureOverTheProfile) {
  constexpr double kBias = 3;
  const double k = M_PI * 8.8541878128e-3 * kBias * kBias;
  for (const double angle : {2.0, 15.0, 40.0, 75.0}) {
    for (const double height : {0.5, 15.0, 500.0, 15000.0}) {
      const Electrostatic law(kBias, shape(angle, height));
      const double sine = std::sin(angle * M_PI / 180), tan = std::tan(angle * M_PI / 180);
      const double tangent = kRadius * (1 - sine);
      const double joint = std::min(tangent, height);
      for (const double d : {0.165, 1.0, 20.0, 2000.0, 1e6}) {
        // Sphere: pi eps0 V^2 R/z^2 a height (Hudlet's arcs). Cone: eps0 E^2/2 over rings 2 pi rho tan theta,
        // E = V/(rho ln tan(theta/2)) of a cone through the same element that stands on the plane, rho there
        // z tan theta.
        const auto sphere = [&](long double t) { return k * kRadius / ((d + t) * (d + t)); };
        const auto cone = [&](long double t) {
          const long double rho = kRadius * std::cos(angle * M_PI / 180) + (t - tangent) * tan;
          const long double field = kBias / ((d + t) * tan * std::log(std::tan(angle * M_PI / 360)));
          return 0.5L * 8.8541878128e-3L * field * field * 2 * M_PIl * rho * tan;
        };
        long double force = -over_profile(sphere, d, 0, joint);
        if (height > joint) force -= over_profile(cone, d, joint, height);
        const LongRangePoint p = law.at(d, kRadius);
        // The quadrature's t = z - d loses d/height of long double's digits.
        EXPECT_NEAR(p.force_nn, static_cast<double>(force),
                    (3e-14 + 1e-18 * d / height) * std::fabs(static_cast<double>(force)))
            << angle << ' ' << height << ' ' << d;
        const double h = 1e-4 * d;
        EXPECT_NEAR(p.force_nn, (law.energy_aj(d - h, kRadius) - law.energy_aj(d + h, kRadius)) / (2 * h),
                    1e-7 * std::fabs(p.force_nn));
        EXPECT_NEAR(p.stiffness_n_m,
                    (law.at(d - h, kRadius).force_nn - law.at(d + h, kRadius).force_nn) / (2 * h),
                    1e-7 * std::fabs(p.stiffness_n_m));
      }
    }
  }
}

TEST(Electrostatic, SphereAloneIsTheClosedForm) {
  const Electrostatic law(2, {});
  for (const double d : {0.165, 5.0, 400.0}) {
    EXPECT_NEAR(law.at(d, kRadius).force_nn,
                -M_PI * 8.8541878128e-3 * 4 * kRadius * kRadius / (d * (d + kRadius)), 1e-15 * 400);
  }
  // The exact sphere–plane force, by image charges to any order: the model is within 5 % at D = R/100 and of
  // the right limit near by, pi eps0 V^2 R/D.
  EXPECT_NEAR(law.at(1e-6, kRadius).force_nn * 1e-6, -M_PI * 8.8541878128e-3 * 4 * kRadius, 1e-6);
}

TEST(LongRange, JumpToContact) {
  const VanDerWaals plain{kHamaker};
  EXPECT_NEAR(jump_to_contact_gap_nm(plain, 0.1, kRadius), std::cbrt(kHamaker * kRadius / 0.3), 1e-14);
  const LongRange none(LongRangeParameters{}, kHamaker, kCutOff);
  EXPECT_NEAR(jump_to_contact_gap_nm(plain, none, kCutOff, 0.1, kRadius), std::cbrt(kHamaker * kRadius / 0.3),
              1e-14);
  EXPECT_EQ(jump_to_contact_gap_nm(plain, none, kCutOff, 1e6, kRadius), 0);
  // Bias alone, D << R: pi eps0 V^2 R/D^2 = k but for D/R: its exact slope is (2 D + R)/(D + R) R/(...).
  LongRangeParameters p;
  p.tip_bias_v = 5;
  const LongRange bias(p, 0, kCutOff);
  const double d = jump_to_contact_gap_nm(VanDerWaals{}, bias, kCutOff, 1, kRadius);
  EXPECT_NEAR(M_PI * 8.8541878128e-3 * 25 * kRadius * kRadius * (2 * d + kRadius) /
                  (d * d * (d + kRadius) * (d + kRadius)),
              1, 1e-12);
}

LongRangeParameters everything() {
  LongRangeParameters p;
  p.retardation_nm = 100;
  p.cone_half_angle_deg = 15;
  p.cone_height_nm = 5000;
  p.tip_bias_v = 1;
  p.capillary.humidity_percent = 50;
  p.capillary.film_nm = 0.5;
  return p;
}

TEST(LongRange, IsContinuousAtTouchAndConservative) {
  const LongRange law(everything(), kHamaker, kCutOff);
  const BridgeState bridge = law.capillary().formed(kRadius);
  for (const double delta : {-1.2, -0.3, -0.01, 0.0, 0.4}) {
    const double h = 1e-6;
    const auto force = [&](double x) { return law.evaluate(x, kRadius, bridge).force_nn; };
    EXPECT_NEAR(
        force(delta),
        (law.energy_aj(delta + h, kRadius, bridge) - law.energy_aj(delta - h, kRadius, bridge)) / (2 * h),
        2e-5 * std::fabs(force(delta)));
    if (delta < 0) {
      EXPECT_NEAR(law.evaluate(delta, kRadius, bridge).stiffness_n_m,
                  (force(delta + h) - force(delta - h)) / (2 * h), 1e-5 * std::fabs(force(delta)) / 0.165);
    } else {
      EXPECT_EQ(law.evaluate(delta, kRadius, bridge).stiffness_n_m, 0);
      EXPECT_NEAR(force(delta), force(-1e-14), 1e-10 * std::fabs(force(0)));
    }
  }
}

// The sum at touch, however it is made, for any radius and with everything that there is.
TEST(LongRange, AtTouchIsForceAndEnergyAtOverlapZero) {
  for (const double bias : {0.0, 2.0}) {
    for (const double wavelength : {0.0, 100.0}) {
      LongRangeParameters p;
      p.retardation_nm = wavelength;
      p.cone_half_angle_deg = 18;
      p.cone_height_nm = 10000;
      p.tip_bias_v = bias;
      p.capillary.humidity_percent = 50;
      const LongRange far(p, kHamaker, kCutOff);
      for (const double radius : {0.3, 5.0, 20.0, 1000.0}) {
        for (const BridgeState& bridge : {BridgeState{}, far.capillary().formed(radius)}) {
          const LongRange::Touch touch = far.at_touch(radius, bridge);
          const double size = kHamaker * radius / (6 * kCutOff * kCutOff);
          EXPECT_NEAR(touch.force_nn, far.evaluate(0, radius, bridge).force_nn, 1e-14 * size);
          EXPECT_NEAR(touch.energy_aj, far.energy_aj(0, radius, bridge),
                      1e-14 * (size * kCutOff + std::fabs(touch.energy_aj)));
        }
      }
    }
  }
}

TEST(LongRange, VanishingTermsChangeNothing) {
  // A bias of 1e-9 V takes the long way through other code; the answer must be that of the plain law.
  for (const double lambda : {1e-3, 0.3, 0.7, 0.73676, 0.9, 4.0, 400.0, 1e4}) {
    for (const bool vdw : {false, true}) {
      TipSampleParameters p = material_of(lambda, vdw);
      const TipSampleLaw plain(p);
      p.long_range.tip_bias_v = 1e-9;
      const TipSampleLaw with(p);
      const ContactScales s = plain.scales(kRadius);
      for (const double soft : {0.0, 0.1, 1.0, 30.0}) {
        const double c = soft * s.overlap_nm / s.force_nn;
        const double energy = s.energy_aj * (1 + 1 / lambda);
        TipSampleState a, b;
        unsigned random = 1;
        for (int i = 0; i < 400; ++i) {
          random = random * 1664525u + 1013904223u;
          const double part = random / 4294967296.0;
          const double span = 3 * 0.165 + (3 + 3 * soft) * s.overlap_nm;
          const double base = (i % 3 == 0 ? 20 : 1) * span * (1.4 * part - 1);
          const double radius = i % 50 < 25 ? kRadius : kRadius * (1 + 0.1 * part);
          const Equilibrium e = plain.advance(base, c, radius, a);
          const Equilibrium f = with.advance(base, c, radius, b);
          ASSERT_EQ(f.status, SolveStatus::kOk) << lambda << ' ' << vdw << ' ' << soft << ' ' << base;
          ASSERT_EQ(e.branch, f.branch) << lambda << ' ' << vdw << ' ' << soft << ' ' << base;
          // 1e-18 V^2 of bias, and twice the plain law's own 1e-10 near folds.
          EXPECT_NEAR(e.force_nn, f.force_nn, 2e-9 * (s.force_nn + std::fabs(e.force_nn)));
          EXPECT_NEAR(e.overlap_nm, f.overlap_nm, 1e-8 * (s.overlap_nm + std::fabs(e.overlap_nm)));
          EXPECT_NEAR(e.potential_aj, f.potential_aj, 1e-8 * (energy + std::fabs(e.potential_aj)));
          if (i % 50 < 25 && i % 50 > 0) {
            EXPECT_EQ(e.jumps, f.jumps) << lambda << ' ' << vdw << ' ' << soft << ' ' << base;
            EXPECT_NEAR(e.dissipated_aj, f.dissipated_aj, 1e-8 * energy)
                << lambda << ' ' << vdw << ' ' << soft << ' ' << base;
          }
        }
      }
    }
  }
}

// Brute force: the tip creeps along the net force on the plain rigid law, to which the long-range forces are
// added here from their formulas as published, with the bridge's memory kept here: with a bridge the plain
// law is another one, of the work of adhesion under the liquid, and a bridge forms where the energy falls by
// it.
class Creeper {
 public:
  Creeper(const TipSampleLaw& dry, const TipSampleLaw& wet, double bias, double f0, double reach, double film,
          double start)
      : dry_(dry), wet_(wet), bias_(bias), f0_(f0), reach_(reach), film_(film), tip_(start) {
    now_ = dry_.advance(start, 0, kRadius, state_);
  }
  double tip() const { return tip_; }
  double force() const {
    const double d = kCutOff + std::max(-tip_, 0.0);
    const double gap = std::max(-tip_, 0.0);
    double f =
        now_.force_nn - M_PI * 8.8541878128e-3 * bias_ * bias_ * kRadius * kRadius / (d * (d + kRadius));
    if (bridge_) f -= f0_ * (1 - gap / reach_);
    return f;
  }
  void move(double step) {
    const double from = tip_;
    tip_ += step;
    now_ = (bridge_ ? wet_ : dry_).advance(tip_, 0, kRadius, state_);
    const bool inside = now_.branch == Branch::kContact || now_.branch == Branch::kNonContact;
    const bool meets = inside ? from < 0 && tip_ >= 0 : -tip_ <= film_;
    if (reach_ > 0 && !bridge_ && step > 0 && meets) {
      const double left = reach_ - std::max(-tip_, 0.0);
      TipSampleState wetted;
      const Equilibrium after = wet_.advance(tip_, 0, kRadius, wetted);
      if (after.potential_aj - f0_ * left * left / (2 * reach_) < now_.potential_aj) {
        bridge_ = true;
        state_ = wetted;
        now_ = after;
      }
    }
    if (bridge_ && -tip_ >= reach_) {
      bridge_ = false;
      state_ = {};
      if (inside) dry_.advance(1, 0, kRadius, state_);
      now_ = dry_.advance(tip_, 0, kRadius, state_);
    }
  }

 private:
  const TipSampleLaw &dry_, &wet_;
  double bias_, f0_, reach_, film_, tip_;
  TipSampleState state_;
  Equilibrium now_;
  bool bridge_ = false;
};

TEST(LongRange, FollowsAnOverdampedTip) {
  for (const double lambda : {0.1, 0.73676, 4.0}) {
    for (const bool vdw : {false, true}) {
      for (const double bias : {0.0, 0.5, 3.0}) {
        for (const double humidity : {0.0, 60.0}) {
          for (const double film : {0.0, 0.6}) {
            if (bias == 0 && humidity == 0) continue;
            if (humidity == 0 && film > 0) continue;
            TipSampleParameters p = material_of(lambda, vdw);
            const TipSampleLaw plain(p);
            // 60 degrees on both: c = 1/2, and gamma of w = 0.1 N/m goes to the liquid.
            TipSampleParameters under_liquid = p;
            under_liquid.work_of_adhesion_n_m -= 0.0728;
            const TipSampleLaw wet(under_liquid);
            p.long_range.tip_bias_v = bias;
            p.long_range.capillary.humidity_percent = humidity;
            p.long_range.capillary.contact_angle_tip_deg = 60;
            p.long_range.capillary.contact_angle_sample_deg = 60;
            p.long_range.capillary.film_nm = film;
            const TipSampleLaw law(p);
            const double f0 = humidity > 0 ? 2 * M_PI * kRadius * 0.0728 : 0;
            const double reach = humidity > 0 ? law.long_range().capillary().kelvin_radius_nm() : 0;
            const ContactScales s = law.scales(kRadius);
            for (const double stiffness : {3.0, 40.0, 1000.0}) {
              const double c = 1 / stiffness;
              const double attraction =
                  2.2 * s.force_nn + f0 + M_PI * 8.85e-3 * bias * bias * kRadius / kCutOff;
              const double low = -(3 + c * attraction), high = 0.5 + c * attraction;
              constexpr int kSteps = 400;
              const double h = (high - low) * 2e-5;
              Creeper creep(plain, wet, bias, f0, reach, film, low);
              TipSampleState state;
              double spring_work = 0, dissipated = 0, last_force = 0, last_base = low, crept_work = 0,
                     last_crept = 0, biggest = 0;
              Equilibrium e;
              for (int k = 0; k <= 2 * kSteps; ++k) {
                const double base = low + (high - low) / kSteps * (k <= kSteps ? k : 2 * kSteps - k);
                const double first = (base - creep.tip()) / c - creep.force();
                const double direction = first > 0 ? 1 : -1;
                while (((base - creep.tip()) / c - creep.force()) * direction > 0) creep.move(direction * h);
                e = law.advance(base, c, kRadius, state);
                ASSERT_EQ(e.status, SolveStatus::kOk);
                ASSERT_GE(e.dissipated_aj, 0);
                dissipated += e.dissipated_aj;
                const double crept_force = (base - creep.tip()) / c;
                spring_work += 0.5 * (e.force_nn + last_force) * (base - last_base);
                crept_work += 0.5 * (crept_force + last_crept) * (base - last_base);
                last_force = e.force_nn;
                last_crept = crept_force;
                last_base = base;
                biggest = std::max(biggest, std::fabs(e.force_nn));
                // Close to a jump the two may be on either side of it: a step of the base aside tells.
                const double step = (high - low) / kSteps;
                TipSampleState aside = state;
                const double other =
                    law.advance(base + (k < kSteps ? step : -step), c, kRadius, aside).overlap_nm;
                const double lower = std::min(e.overlap_nm, other) - 2 * step;
                const double upper = std::max(e.overlap_nm, other) + 2 * step;
                ASSERT_TRUE(creep.tip() >= lower && creep.tip() <= upper)
                    << "lambda " << lambda << " vdw " << vdw << " bias " << bias << " RH " << humidity
                    << " film " << film << " k " << stiffness << " base " << base << " crept " << creep.tip()
                    << " law " << e.overlap_nm << " branch " << static_cast<int>(e.branch) << " bridge "
                    << e.bridge;
              }
              // A closed loop: the work is what was dissipated. The trapezium rule sees a jump within one
              // step, of which there are a few each way.
              const double coarse = 6 * biggest * (high - low) / kSteps;
              EXPECT_NEAR(spring_work, dissipated, coarse);
              EXPECT_NEAR(crept_work, dissipated, coarse);
              EXPECT_FALSE(e.bridge);
            }
          }
        }
      }
    }
  }
}

TEST(LongRange, RejectsWhatIsNoTip) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto rejects = [](auto change, bool vdw = true) {
    TipSampleParameters p = silicon_on(2, 0.066, 0.4, vdw);
    p.long_range = everything();
    change(p.long_range);
    EXPECT_THROW(TipSampleLaw{p}, UserError);
  };
  for (const double bad : {-1.0, kNan}) rejects([=](auto& p) { p.retardation_nm = bad; });
  for (const double bad : {0.0, 0.5, 76.0, kNan}) rejects([=](auto& p) { p.cone_half_angle_deg = bad; });
  for (const double bad : {0.0, -1.0, kNan}) rejects([=](auto& p) { p.cone_height_nm = bad; });
  rejects([=](auto& p) { p.tip_bias_v = kNan; });
  rejects([](auto&) {}, false);  // retardation of nothing
}

TEST(LongRange, TakesNothingFromTheHeap) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
  TipSampleParameters p = silicon_on(2, 0.066, 0.4, true);
  p.long_range = everything();
  const TipSampleLaw law(p);
  const support::AllocGuard guard;
  TipSampleState state;
  for (int i = 0; i < 1000; ++i) law.advance(i % 7 - 4.0, 0.02, 10 + i % 3, state);
  EXPECT_EQ(guard.allocations(), 0u);
}

}  // namespace
}  // namespace telenano::physics
