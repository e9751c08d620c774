#include "telenano/nve_server/physics/probe/probe.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

// A silicon lever for contact mode: 450 × 50 × 2 µm, 10 µm tip, k = 0.19 N/m.
BeamParameters contact_lever() {
  return {169.0, 0.22, 50e3, 2e3, 450e3, 10e3};
}

Probe probe_of(const BeamParameters& beam, double tilt_deg = 0, ProbePoints points = ProbePoints::kPlusY) {
  ProbeParameters parameters;
  parameters.beam = beam;
  parameters.tilt_deg = tilt_deg;
  parameters.points = points;
  return Probe(parameters);
}

struct FreeEnd {
  Vec3 apex_nm = Vec3::Zero();
  Vec3 turn_rad = Vec3::Zero();
};

// The same lever as a rod in space, by numbers: the inner moment M(s) = (r_apex − r(s)) × F from statics
// turns the section by κ = M_x/(EI_x), M_y/(GJ), M_z/(EI_z) about the rod's own axes, turns add up, and u' =
// turn × t. Integrated in W by the midpoint rule over `n` sections. Knows nothing of stiffnesses or of frame
// T's C.
FreeEnd bend(const BeamParameters& b, double tilt_deg, double way, const Vec3& force, int n = 4000) {
  const double tilt = tilt_deg * M_PI / 180;
  const Vec3 along(0, way * std::cos(tilt), -std::sin(tilt));
  const Vec3 across(way, 0, 0);
  const Vec3 up = across.cross(along);
  const double t3b = b.thickness_nm * b.thickness_nm * b.thickness_nm * b.width_nm;
  const double b3t = b.width_nm * b.width_nm * b.width_nm * b.thickness_nm;
  const double bending = b.youngs_modulus_gpa * t3b / 12;
  const double sideways = b.youngs_modulus_gpa * b3t / 12;
  const double torsion = b.youngs_modulus_gpa / (2 * (1 + b.poisson_ratio)) * t3b / 3;
  const Vec3 apex = along * b.length_nm - up * b.tip_height_nm;
  const double ds = b.length_nm / n;
  Vec3 turn = Vec3::Zero(), moved = Vec3::Zero();
  for (int i = 0; i < n; ++i) {
    const Vec3 here = along * ((i + 0.5) * ds);
    const Vec3 moment = (apex - here).cross(force);
    const Vec3 rate = across * (across.dot(moment) / bending) + along * (along.dot(moment) / torsion) +
                      up * (up.dot(moment) / sideways);
    const Vec3 before = turn;
    turn += rate * ds;
    moved += (0.5 * (before + turn)).cross(along) * ds;
  }
  return {moved + turn.cross(-up * b.tip_height_nm), turn};
}

TEST(Probe, MovesLikeARodThatIsBentAndTwistedByNumbers) {
  for (const double tilt_deg : {0.0, 11.0, 40.0}) {
    for (const double way : {1.0, -1.0}) {
      const Probe probe =
          probe_of(contact_lever(), tilt_deg, way > 0 ? ProbePoints::kPlusY : ProbePoints::kMinusY);
      for (const Vec3& force : {Vec3(3, 0, 0), Vec3(0, 3, 0), Vec3(0, 0, 3), Vec3(1, -2, 4)}) {
        const FreeEnd end = bend(contact_lever(), tilt_deg, way, force);
        const Vec3 moved = probe.compliance_nm_nn() * force;
        // The midpoint rule's error at 4000 sections, 1/(12·4000²) of a cubic's leading coefficient: 1e-8.
        EXPECT_LT((moved - end.apex_nm).norm(), 3e-7 * end.apex_nm.norm())
            << tilt_deg << " " << way << " " << force.transpose();
      }
    }
  }
}

TEST(Probe, IsTheClosedFormOfTheSourceWithoutTilt) {
  const BeamParameters b = contact_lever();
  const double k = 169.0 * 50e3 * 8e9 / (4 * 450e3 * 450e3 * 450e3);
  const double g = 169.0 / (2 * 1.22);
  const Compliance c = probe_of(b).compliance_nm_nn();
  // Relative 1e-14: a dozen roundings.
  EXPECT_NEAR(probe_of(b).stiffness_n_m(), k, 1e-14 * k);
  EXPECT_NEAR(c(2, 2) * k, 1, 1e-14);
  EXPECT_NEAR(1 / c(1, 1), 450e3 * 450e3 * k / (3 * 10e3 * 10e3), 1e-11);
  EXPECT_NEAR(c(1, 2) * k, 3 * 10e3 / (2 * 450e3), 1e-14);
  EXPECT_NEAR(probe_of(b, 0, ProbePoints::kMinusY).compliance_nm_nn()(1, 2) * k, -3 * 10e3 / (2 * 450e3),
              1e-14);
  const double torsion = g * 50e3 * 8e9 / (3 * 450e3 * 1e8);
  const double sideways = 169.0 * 125e12 * 2e3 / (4 * 450e3 * 450e3 * 450e3);
  EXPECT_NEAR(c(0, 0), 1 / torsion + 1 / sideways, 1e-13 * c(0, 0));
  EXPECT_EQ(c(0, 1), 0);
  EXPECT_EQ(c(0, 2), 0);
  const double det = c(1, 1) * c(2, 2) - c(1, 2) * c(2, 1);
  EXPECT_NEAR(det * k * k, 0.75 * std::pow(10e3 / 450e3, 2), 1e-15);
}

// Heim, Kappl & Butt's effective stiffness, extended to a tip of height h.
TEST(Probe, TiltChangesTheNormalStiffness) {
  const BeamParameters b = contact_lever();
  const double h_over_l = b.tip_height_nm / b.length_nm, alpha = 11 * M_PI / 180, t = std::tan(alpha);
  for (const auto points : {ProbePoints::kPlusY, ProbePoints::kMinusY}) {
    const Probe probe = probe_of(b, 11, points);
    const double expected = std::cos(alpha) * std::cos(alpha) *
                            (1 - 3 * h_over_l * t + 3 * h_over_l * h_over_l * t * t) / probe.stiffness_n_m();
    EXPECT_NEAR(probe.compliance_nm_nn()(2, 2), expected, 1e-14 * expected);
  }
  BeamParameters without_tip = b;
  without_tip.tip_height_nm = 0;
  EXPECT_NEAR(1 / probe_of(without_tip, 11).compliance_nm_nn()(2, 2),
              probe_of(b).stiffness_n_m() / (std::cos(alpha) * std::cos(alpha)), 1e-13);
}

// Work of slowly loading by numbers is ½ FᵀCF: the law of Clapeyron, from the moments in the rod, not from C.
TEST(Probe, StoresHalfForceTimesCompliance) {
  const BeamParameters b = contact_lever();
  const Vec3 force(1, -2, 4);
  const Probe probe = probe_of(b, 11);
  const double tilt = 11 * M_PI / 180;
  const Vec3 along(0, std::cos(tilt), -std::sin(tilt)), across(1, 0, 0), up = across.cross(along);
  const Vec3 apex = along * b.length_nm - up * b.tip_height_nm;
  const double t3b = 8e9 * b.width_nm, b3t = 125e12 * b.thickness_nm;
  double energy = 0;
  const int n = 4000;
  for (int i = 0; i < n; ++i) {
    const Vec3 moment = (apex - along * ((i + 0.5) * b.length_nm / n)).cross(force);
    energy += 0.5 * b.length_nm / n *
              (std::pow(across.dot(moment), 2) / (169.0 * t3b / 12) +
               std::pow(up.dot(moment), 2) / (169.0 * b3t / 12) +
               std::pow(along.dot(moment), 2) / (169.0 / 2.44 * t3b / 3));
  }
  // Midpoint rule, as above.
  EXPECT_NEAR(0.5 * force.dot(probe.compliance_nm_nn() * force), energy, 3e-7 * energy);
}

TEST(Probe, OpticalLeverReadsSlopeAndTwistOfTheFreeEnd) {
  const BeamParameters b = contact_lever();
  for (const double tilt_deg : {0.0, 11.0}) {
    for (const double way : {1.0, -1.0}) {
      const Probe probe = probe_of(b, tilt_deg, way > 0 ? ProbePoints::kPlusY : ProbePoints::kMinusY);
      const double tilt = tilt_deg * M_PI / 180;
      const Vec3 along(0, way * std::cos(tilt), -std::sin(tilt)), across(way, 0, 0);
      for (const Vec3& force : {Vec3(3, 0, 0), Vec3(0, 3, 0), Vec3(0, 0, 3), Vec3(1, -2, 4)}) {
        const FreeEnd end = bend(b, tilt_deg, way, force);
        const double slope = across.dot(end.turn_rad);
        // Midpoint rule, as above, on some 20 nm and 1e-4 rad.
        EXPECT_NEAR(probe.optical_deflection_nm(force), slope * 2 * b.length_nm / 3, 1e-5);
        EXPECT_NEAR(probe.optical_twist_rad(force), along.dot(end.turn_rad), 1e-11);
      }
    }
  }
}

TEST(Probe, GivenStiffnessesAreADiagonalOfTheTiltedFrame) {
  ProbeParameters parameters;
  parameters.stiffness_n_m = 0.4;
  const Probe normal_only(parameters);
  EXPECT_EQ(normal_only.compliance_nm_nn(), Compliance(Vec3(0, 0, 2.5).asDiagonal()));
  EXPECT_EQ(normal_only.optical_deflection_nm(Vec3(7, 8, 2)), 5.0);
  EXPECT_EQ(normal_only.optical_twist_rad(Vec3(7, 8, 2)), 0.0);
  parameters.lateral_stiffness_n_m = 50;
  parameters.longitudinal_stiffness_n_m = 200;
  EXPECT_EQ(Probe(parameters).compliance_nm_nn(), Compliance(Vec3(0.02, 0.005, 2.5).asDiagonal()));
  parameters.tilt_deg = 30;
  const Compliance c = Probe(parameters).compliance_nm_nn();
  // cos² 30° = 3/4, sin² 30° = 1/4.
  EXPECT_NEAR(c(2, 2), 0.75 * 2.5 + 0.25 * 0.005, 1e-15);
  EXPECT_NEAR(c(1, 1), 0.25 * 2.5 + 0.75 * 0.005, 1e-15);
  EXPECT_NEAR(c(1, 2), std::sqrt(3.0) / 4 * (2.5 - 0.005), 1e-15);
  EXPECT_NEAR(c(0, 0), 0.02, 1e-15);
  EXPECT_EQ(Probe().compliance_nm_nn(), Compliance(Compliance::Zero()));
}

// Over levers of 0.01 to 1000 N/m, with and without mode: symmetric, positive definite; what the mode leaves
// is positive semidefinite, and both together are the whole.
TEST(Probe, CompliesInEveryDirectionAtTheExtremes) {
  int softest = 0, hardest = 0;
  for (const double thickness_nm : {200.0, 800.0, 4e3, 8e3}) {
    for (const double length_nm : {30e3, 125e3, 450e3}) {
      for (const double height_nm : {100.0, 10e3, 20e3}) {
        for (const double tilt_deg : {0.0, 11.0, 45.0}) {
          ProbeParameters parameters;
          parameters.beam = BeamParameters{169.0, 0.22, 28e3, thickness_nm, length_nm, height_nm};
          parameters.tilt_deg = tilt_deg;
          parameters.points = ProbePoints::kMinusY;
          parameters.mode = ModeParameters{3e5, 400};
          const Probe probe(parameters);
          if (probe.stiffness_n_m() < 0.01) ++softest;
          if (probe.stiffness_n_m() > 1000) ++hardest;
          const Compliance& c = probe.compliance_nm_nn();
          const Compliance& rest = probe.rest_compliance_nm_nn();
          EXPECT_EQ(c, c.transpose());
          // In units of 1/k. The smallest is about 3h²/(4L²k), 4e-8 here; rounding is 1e-16.
          const auto spectrum = [&](const Compliance& m) {
            return Vec3(Eigen::SelfAdjointEigenSolver<Mat3>(m * probe.stiffness_n_m()).eigenvalues());
          };
          EXPECT_GT(spectrum(c)[0], 1e-9) << thickness_nm << " " << length_nm << " " << height_nm;
          EXPECT_GT(spectrum(rest)[0], -1e-14);
          EXPECT_GT(spectrum(rest)[1], 1e-9);
          const Vec3& u = probe.mode_shape_w();
          EXPECT_LT((rest + u * u.transpose() / probe.stiffness_n_m() - c).norm(), 1e-14 * c.norm());
          EXPECT_NEAR(u.dot(probe.normal_w()), 1, 1e-14);
        }
      }
    }
  }
  EXPECT_GT(softest, 0);
  EXPECT_GT(hardest, 0);
}

std::string complaint(const std::function<void(ProbeParameters&)>& change) {
  ProbeParameters parameters;
  parameters.beam = contact_lever();
  change(parameters);
  try {
    const Probe probe(parameters);
  } catch (const UserError& error) {
    return error.what();
  }
  return "";
}

TEST(Probe, RefusesWhatIsNoProbeWithOneLine) {
  using P = ProbeParameters;
  EXPECT_EQ(complaint([](P&) {}), "");
  EXPECT_EQ(complaint([](P& p) { p.beam.reset(); }),
            "probe: expected exactly one of rigid, a stiffness and a beam");
  EXPECT_EQ(complaint([](P& p) { p.rigid = true; }),
            "probe: expected exactly one of rigid, a stiffness and a beam");
  EXPECT_EQ(complaint([](P& p) { p.lateral_stiffness_n_m = 3; }),
            "probe: lateral and longitudinal stiffness go with a given stiffness only");
  EXPECT_EQ(complaint([](P& p) { p.tilt_deg = 60; }), "probe: tilt must be 0 to 45 degrees, not 60");
  EXPECT_EQ(complaint([](P& p) { p.tilt_deg = NAN; }), "probe: tilt must be 0 to 45 degrees, not nan");
  EXPECT_EQ(complaint([](P& p) { p.beam->width_nm = -1; }),
            "probe: width of the beam must be positive and finite (nm), not -1");
  EXPECT_EQ(complaint([](P& p) { p.beam->poisson_ratio = 0.6; }),
            "probe: Poisson's ratio of the beam must be above -1 and at most 0.5, not 0.6");
  EXPECT_EQ(complaint([](P& p) { p.beam->tip_height_nm = INFINITY; }),
            "probe: tip height must be finite and not negative (nm), not inf");
  EXPECT_EQ(complaint([](P& p) { p.beam->thickness_nm = 60e3; }),
            "probe: thickness of the beam must be at most its width (nm), not 60000");
  EXPECT_EQ(complaint([](P& p) { p.beam->youngs_modulus_gpa = 0; }),
            "probe: Young's modulus of the beam must be positive and finite (GPa), not 0");
  EXPECT_EQ(complaint([](P& p) { p.beam->length_nm = 40e3; }),
            "probe: width of the beam must be at most its length (nm), not 50000");
  EXPECT_EQ(complaint([](P& p) {
              p.beam.reset();
              p.stiffness_n_m = 0;
            }),
            "probe: stiffness must be positive and finite (N/m), not 0");
  EXPECT_EQ(complaint([](P& p) {
              p.beam.reset();
              p.stiffness_n_m = 1;
              p.longitudinal_stiffness_n_m = NAN;
            }),
            "probe: longitudinal stiffness must be positive and finite (N/m), not nan");
  EXPECT_EQ(complaint([](P& p) {
              p.beam.reset();
              p.rigid = true;
              p.mode = ModeParameters{1e4, 10};
            }),
            "probe: a rigid probe has no mode");
  EXPECT_EQ(complaint([](P& p) {
              p.mode = ModeParameters{0, 10};
            }),
            "probe mode: frequency must be positive and finite (Hz), not 0");
  EXPECT_EQ(complaint([](P& p) {
              p.mode = ModeParameters{1e4, 0.5};
            }),
            "probe mode: quality must be 0.6 to 1e6, not 0.5");
}

}  // namespace
}  // namespace telenano::physics
