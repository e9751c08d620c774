#include "telenano/nve_server/physics/particle/particle_bristle.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/shortest_turn.h"

namespace telenano::physics {
namespace {

// The bristle alone: the envelope's gradient and Hessian are its force and stiffness, and nothing is gained.
TEST(ParticleBristle, ForceIsTheGradientOfTheEnvelope) {
  const Bristle bristle{30.0, 6.0};
  for (const Vec3& s : {Vec3(0.1, 0.05, 0), Vec3(0.3, -0.4, 0.1), Vec3(-3, 1, 2)}) {
    const BristleResponse at = respond(bristle, s);
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kH = 1e-5;
      const BristleResponse up = respond(bristle, s + kH * Vec3::Unit(axis));
      const BristleResponse down = respond(bristle, s - kH * Vec3::Unit(axis));
      // Central differences: h² times the third derivative, some 100.
      EXPECT_NEAR((up.envelope - down.envelope) / (2 * kH), at.force[axis], 1e-7);
      EXPECT_LT(((up.force - down.force) / (2 * kH) - at.tangent().col(axis)).norm(), 1e-6);
    }
    EXPECT_LE(at.force.norm(), 6.0 * (1 + 1e-15));
    EXPECT_NEAR(at.stored, 0.5 * 30 * at.deflection.squaredNorm(), 1e-12);
    EXPECT_NEAR(at.envelope, at.stored + at.dissipated, 1e-12);
  }
}

TEST(ParticleBristle, ChangingItsStiffnessYieldsNoEnergy) {
  const Vec3 s(0.1, 0.2, -0.05);
  for (const double k : {0.0, 1.0, 9.0, 10.0, 11.0, 1000.0}) {
    const Vec3 after = carried_over(s, 10.0, k);
    EXPECT_LE(0.5 * k * after.squaredNorm(), 0.5 * 10 * s.squaredNorm() * (1 + 1e-15)) << k;
  }
}

TEST(ParticleBristle, TurnsWithThePlaneOfContact) {
  const Vec3 from = Vec3(0.1, -0.2, 1).normalized(), to = Vec3(-0.3, 0.4, 0.8).normalized();
  const Vec3 s = from.cross(Vec3(1, 2, 3));
  const Vec3 turned = transported(s, from, to);
  const Vec3 expected = support::shortest_turn(from, to) * s;
  EXPECT_LT((turned - expected).norm(), 1e-14);
  EXPECT_LT(std::abs(turned.dot(to)), 1e-14);
}

}  // namespace
}  // namespace telenano::physics
