#include "telenano/master/view_model/meshes.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace telenano::view_model {
namespace {

Vec3 pos(const Mesh& mesh, std::uint32_t i) {
  const auto& p = mesh.corners[i].pos;
  return {p[0], p[1], p[2]};
}

// Signed volume by the divergence theorem: right only if every triangle faces outwards and none is missing.
double volume(const Mesh& mesh) {
  double sum = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3)
    sum += pos(mesh, mesh.triangles[i])
               .dot(pos(mesh, mesh.triangles[i + 1]).cross(pos(mesh, mesh.triangles[i + 2])));
  return sum / 6;
}

TEST(Meshes, EncloseTheVolumeOfTheirSolids) {
  // Inscribed in the sphere and the cone: a little less, by the square of the angle.
  EXPECT_NEAR(volume(unit_sphere(64, 128)), 4 * std::numbers::pi / 3, 0.01);
  EXPECT_NEAR(volume(unit_cone(200)), std::numbers::pi / 3, 0.001);
}

TEST(Meshes, NormalsAreOfLengthOneAndLookOutOfTheSphere) {
  const Mesh sphere = unit_sphere(8, 12);
  for (const auto& c : sphere.corners) {
    const Vec3 n(c.normal[0], c.normal[1], c.normal[2]);
    EXPECT_NEAR(n.norm(), 1, 1e-6);
    EXPECT_NEAR(n.dot(Vec3(c.pos[0], c.pos[1], c.pos[2])), 1, 1e-6);
  }
}

// The bent lever solves EI w'''' = 0, clamped at one end, with no moment and a shear force at the other.
TEST(Meshes, LeverBendsAsAClampedBeamWithAnEndLoad) {
  const double h = 1e-3;
  const auto second = [h](double s) {
    return (lever_bend(s + h) - 2 * lever_bend(s) + lever_bend(s - h)) / (h * h);
  };
  EXPECT_EQ(lever_bend(0), 0);
  EXPECT_EQ(lever_bend(1), 1);
  EXPECT_NEAR((lever_bend(h) - lever_bend(-h)) / (2 * h), 0,
              1e-6);                // slope at the clamp; h² of the third derivative
  EXPECT_NEAR(second(1), 0, 1e-6);  // no moment at the free end
  for (double s = 0.1; s < 1; s += 0.1)
    EXPECT_NEAR(second(s), 3 * (1 - s), 1e-6);  // moment grows to the clamp
}

TEST(Meshes, LeverKeepsItsClampAndRisesAtItsTip) {
  const Mesh lever = bent_lever(100, 20, 2, 7, 10);
  double lowest_at_clamp = 1e9;
  double highest_at_clamp = -1e9;
  double highest_at_tip = -1e9;
  for (const auto& c : lever.corners) {
    if (c.pos[1] > 99.9f) {
      lowest_at_clamp = std::min<double>(lowest_at_clamp, c.pos[2]);
      highest_at_clamp = std::max<double>(highest_at_clamp, c.pos[2]);
    }
    if (c.pos[1] < 0.1f) highest_at_tip = std::max<double>(highest_at_tip, c.pos[2]);
  }
  EXPECT_NEAR(highest_at_tip, 0, 1e-6);
  EXPECT_NEAR(highest_at_clamp, -7, 1e-6);  // seen from the tip that rose by 7
  EXPECT_NEAR(lowest_at_clamp, -9, 1e-6);
}

}  // namespace
}  // namespace telenano::view_model
