// Plane and ball by one potential, as a scene's key asks for them, against Hertz' closed form.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::scene {
namespace {

std::string text_of(const std::string& shape) {
  return "name = \"shape\"\n[sample]\nyoungs_modulus_gpa = 70.0\npoisson_ratio = 0.27\n"
         "surface_energy_j_m2 = 0.2\n[surface]\nforce = \"potential\"\n" +
         shape +
         R"([forces]
van_der_waals = false
[contact]
law = "hertz"
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 40.0
[probe.tip]
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 200.0
half_width_nm = 60.0
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 10.0
)";
}

/// Hertz and a spring k, pressed by `reach` along one line: k (reach − δ) = (4/3) E* √R δ^(3/2), by
/// bisection.
double hertz_force(double reach_nm, double k, double radius_nm) {
  const double modulus = 1.0 / ((1 - 0.27 * 0.27) / 70.0 + (1 - 0.27 * 0.27) / 160.0);
  const auto law = [&](double d) { return 4.0 / 3 * modulus * std::sqrt(radius_nm) * std::pow(d, 1.5); };
  double low = 0, high = reach_nm;
  for (int i = 0; i < 80; ++i) {
    const double middle = 0.5 * (low + high);
    (law(middle) < k * (reach_nm - middle) ? low : high) = middle;
  }
  return law(0.5 * (low + high));
}

// The same spring in all directions, so that all acts along the normal. The balance is within 1e-9 nm: times
// 40 N/m and the contact's 300 some 1e-7 nN.
constexpr double kSpring = 5.0;
constexpr double kWithin = 1e-6;

TEST(PotentialShapes, APlaneIsHertzAlongItsNormal) {
  const auto scene = parse_scene(text_of("kind = \"plane\"\nslope_x = 0.6\nslope_y = -0.3\n"), "plane.toml");
  ASSERT_NE(scene->potential, nullptr);
  const Vec3 normal = Vec3(-0.6, 0.3, 1.0).normalized();
  // The apex at which a sphere of 20 nm touches: its centre lies 20 nm off the plane.
  const Vec3 centre = Vec3(7, -4, 0.6 * 7 + 0.3 * 4) + 20.0 * normal;
  const Vec3 touch = centre - Vec3(0, 0, 20);
  physics::PotentialState state;
  for (double reach = -2.0; reach < 6.0; reach += 0.05) {
    const Vec3 end = touch - reach * normal;
    const physics::TipSolution s =
        scene->potential->advance(end, physics::Compliance::Identity() / kSpring, state);
    ASSERT_EQ(s.status, physics::SolveStatus::kOk);
    const double force = reach > 0 ? hertz_force(reach, kSpring, 20.0) : 0.0;
    EXPECT_LE((s.force_w_nn - force * normal).norm(), kWithin) << reach;
    EXPECT_NEAR(s.radius_nm, 20.0, 1e-12);
  }
}

TEST(PotentialShapes, ABallIsHertzTowardsItsMiddle) {
  const auto scene =
      parse_scene(text_of("kind = \"sphere\"\nradius_nm = 30.0\nheight_nm = 30.0\nx_nm = 3.0\ny_nm = 1.0\n"),
                  "ball.toml");
  ASSERT_NE(scene->potential, nullptr);
  // 30 nm high is a half-ball: its middle lies in the plate. 25° off its top the plate is 25 nm farther away.
  const double angle = 25.0 * 3.14159265358979 / 180;
  const Vec3 normal(std::sin(angle), 0, std::cos(angle));
  const Vec3 touch = Vec3(3, 1, 0) + 50.0 * normal - Vec3(0, 0, 20);
  physics::PotentialState state;
  for (double reach = -2.0; reach < 6.0; reach += 0.05) {
    const Vec3 end = touch - reach * normal;
    const physics::TipSolution s =
        scene->potential->advance(end, physics::Compliance::Identity() / kSpring, state);
    ASSERT_EQ(s.status, physics::SolveStatus::kOk);
    const double force = reach > 0 ? hertz_force(reach, kSpring, 20.0 * 30.0 / 50.0) : 0.0;
    EXPECT_LE((s.force_w_nn - force * normal).norm(), kWithin) << reach;
  }
}

}  // namespace
}  // namespace telenano::scene
