// What the slave says of its port against what the port then does.
#include "telenano/nve_server/slave/port_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano::slave {
namespace {

constexpr double kT = 1e-3;

struct Rig {
  std::shared_ptr<const scene::Scene> scene;
  NveSlave slave;
  SlaveInput input;
  SlaveOutput output;

  explicit Rig(const std::string& name)
      : scene(scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml")),
        slave(scene) {
    input.wants_model = true;
    input.tip_target_pos_w_nm = slave.limits().start_pos_w_nm;
    step();
  }
  void step() { slave.step(input, kT, output); }
  void go(double z_nm, double step_nm = 0.01) {
    double& z = input.tip_target_pos_w_nm.z();
    while (std::fabs(z - z_nm) > 1e-12) {
      z += std::fmin(std::fmax(z_nm - z, -step_nm), step_nm);
      step();
    }
  }
  double depth_nm() const {
    return output.model.normal_w.dot(output.model.point_w_nm - output.commanded_pos_w_nm);
  }
};

TEST(PortModel, NothingIsSaidUnlessAsked) {
  Rig rig("flat_silicon_oxide");
  EXPECT_NE(rig.output.model.version, 0u);
  rig.input.wants_model = false;
  rig.step();
  EXPECT_TRUE(rig.output.model.empty());
}

TEST(PortModel, TheGroundIsKnownBeforeItIsTouched) {
  for (const char* name : {"flat_silicon_oxide", "flat_polystyrene"}) {
    Rig rig(name);
    const double foretold_nm = rig.output.model.point_w_nm.z();
    EXPECT_EQ(rig.output.model.normal_w, Vec3::UnitZ());
    // Down until the contact bears no load any more but is pressed: there the foretold point must lie.
    double last_z = rig.output.commanded_pos_w_nm.z(), last_f = 0;
    while (rig.output.contact_state != link::ContactState::kContact || rig.output.force_w_nn.z() < 0) {
      last_z = rig.output.commanded_pos_w_nm.z();
      last_f = rig.output.force_w_nn.z();
      rig.go(last_z - 0.02);
      ASSERT_GT(rig.input.tip_target_pos_w_nm.z(), -20) << name;
    }
    const double f = rig.output.force_w_nn.z(), z = rig.output.commanded_pos_w_nm.z();
    const double zero_nm = z + (last_z - z) * f / (f - last_f);
    EXPECT_NEAR(foretold_nm, zero_nm, 0.02) << name;
  }
}

TEST(PortModel, InTouchItIsTheTangentOfThePort) {
  for (const char* name : {"flat_silicon_oxide", "flat_polystyrene"}) {
    Rig rig(name);
    rig.go(rig.output.model.point_w_nm.z() - 1.5);
    ASSERT_EQ(rig.output.contact_state, link::ContactState::kContact);
    const link::LocalModel model = rig.output.model;
    const double z = rig.output.commanded_pos_w_nm.z(), f = rig.output.force_w_nn.z();
    EXPECT_NEAR(model.stiffness_n_m * rig.depth_nm(), f, 1e-9 * f) << name;
    constexpr double kH = 1e-3;  // the law bends: h·F''/(2F') is below 1e-3 of the slope
    rig.go(z - kH, kH);
    const double deeper = rig.output.force_w_nn.z();
    rig.go(z + kH, kH);
    EXPECT_NEAR(model.stiffness_n_m, (deeper - rig.output.force_w_nn.z()) / (2 * kH),
                2e-3 * model.stiffness_n_m)
        << name;
    EXPECT_NE(rig.output.model.version, model.version);  // another model has another number
  }
}

TEST(PortModel, ItLetsGoAtTheAdhesionThatWasSaid) {
  for (const char* name : {"flat_silicon_oxide", "flat_polystyrene"}) {
    Rig rig(name);
    const double start_nm = rig.output.commanded_pos_w_nm.z();
    rig.go(rig.output.model.point_w_nm.z() - 1);
    const double said_nn = rig.output.model.adhesion_nn;
    double most_nn = 0;
    while (rig.output.contact_state == link::ContactState::kContact) {
      most_nn = std::fmax(most_nn, -rig.output.force_w_nn.z());
      rig.go(rig.output.commanded_pos_w_nm.z() + 0.01);
      ASSERT_LT(rig.input.tip_target_pos_w_nm.z(), start_nm + 1) << name;
    }
    EXPECT_NEAR(most_nn, said_nn, 0.01 * said_nn) << name;
  }
}

// What a person is told of the contact: between the closed forms of Hertz (no adhesion) and JKR (the most) for
// the force on the tip, with the numbers of the scene's file.
TEST(PortModel, TheContactThatIsToldIsThatOfHertzToJkr) {
  Rig rig("flat_silicon_oxide");
  EXPECT_EQ(rig.slave.contact_radius_nm(), 0);
  EXPECT_EQ(rig.slave.adhesion_nn(), rig.output.model.adhesion_nn) << "also before it touches";
  rig.go(rig.output.model.point_w_nm.z() - 2);
  ASSERT_EQ(rig.output.contact_state, link::ContactState::kContact);
  const double r_nm = 20;
  const double k_nn_nm2 = 4.0 / 3 / ((1 - 0.27 * 0.27) * (1 / 70.0 + 1 / 160.0));  // K = 4 E*/3
  const double pull_nn = 3 * kPi * 2 * std::sqrt(0.2 * 0.2) * r_nm;                // 3 π w R
  const double f_nn = rig.output.force_w_nn.z();
  const double a_nm = rig.slave.contact_radius_nm();
  EXPECT_GT(f_nn, 5);
  EXPECT_GT(a_nm, std::cbrt(r_nm * f_nn / k_nn_nm2));
  EXPECT_LT(a_nm, std::cbrt(r_nm / k_nn_nm2 *
                            (f_nn + pull_nn + std::sqrt(2 * pull_nn * f_nn + pull_nn * pull_nn))));
  EXPECT_EQ(rig.slave.adhesion_nn(), rig.output.model.adhesion_nn);
}

TEST(PortModel, ItSlipsAtTheFrictionThatWasSaid) {
  Rig rig("humid_flakes");
  rig.go(rig.output.model.point_w_nm.z() - 1);
  ASSERT_EQ(rig.output.contact_state, link::ContactState::kContact);
  double most = 0, limit = 0;
  const Vec3 before_w_nn = rig.slave.trace().tip.friction_w_nn;  // the way down a slope has left some
  const double x = rig.input.tip_target_pos_w_nm.x();
  for (int k = 1; k <= 2000; ++k) {
    rig.input.tip_target_pos_w_nm.x() = x + 1e-3 * k;
    rig.step();
    const physics::TipSolution tip = rig.slave.trace().tip;
    if (tip.friction_w_nn.norm() > most) {
      most = tip.friction_w_nn.norm();
      limit = rig.output.model.friction_nn;
    }
    if (k == 5) {
      // In series with springs that are not equal in the plane: the mean of both ways, within their spread.
      const double stuck_slope = (tip.friction_w_nn - before_w_nn).norm() / (1e-3 * k);
      EXPECT_NEAR(rig.output.model.shear_stiffness_n_m, stuck_slope, 0.35 * stuck_slope);
    }
  }
  EXPECT_NEAR(most, limit, 0.02 * limit);
}

TEST(PortModel, OnAScanTheNormalIsOneAndTheForceIsRight) {
  Rig rig("flakes");
  rig.go(rig.output.model.point_w_nm.z() - 1);
  for (int k = 0; k < 400; ++k) {
    rig.input.tip_target_pos_w_nm += Vec3(0.05, 0.03, 0);
    rig.step();
    const link::LocalModel& m = rig.output.model;
    ASSERT_NEAR(m.normal_w.norm(), 1, 1e-12);
    if (rig.output.contact_state != link::ContactState::kContact) continue;
    ASSERT_NEAR(m.stiffness_n_m * rig.depth_nm(), rig.output.force_w_nn.dot(m.normal_w), 1e-8);
  }
}

// On one potential: places all over a scan, each from above the ground down along the vertical and up again.
// The station is told the ground's place before it is touched, and the force at which the tip lets go; what
// the potential then does is the oracle. The ground is foretold from a gap of about 2 nm, where the fields
// are softer than at touch and the tip does not come down along the normal: 0.1 nm in the median, 0.5 at the
// worst tenth (found: 0.06 and 0.28). The pull-off is that of the law at the radius where the tip then is; a
// radius that changes on the way and springs that give sideways are not in it: 10 % (found: 5 and 6).
TEST(PortModel, OnAScanTheGroundAndItsAdhesionAreThePotentials) {
  Rig rig("flakes");
  ASSERT_NE(rig.scene->potential, nullptr);
  std::vector<double> place_nm, adhesion;
  for (int k = 0; k < 24; ++k) {
    const double x = 60 + std::fmod(k * 97.31, 480.0), y = 60 + std::fmod(k * 61.77, 480.0);
    const double touch = rig.scene->touch_height_nm(x, y);
    NveSlave slave(rig.scene, PortGround(*rig.scene));
    SlaveInput input;
    SlaveOutput output;
    input.wants_model = true;
    const auto to = [&](double z, double step_nm) {
      double& at = input.tip_target_pos_w_nm.z();
      while (std::fabs(at - z) > 1e-12) {
        at += std::fmin(std::fmax(z - at, -step_nm), step_nm);
        slave.step(input, kT, output);
      }
    };
    input.tip_target_pos_w_nm = slave.limits().start_pos_w_nm;
    to(slave.limits().workspace_max_w_nm.z(), 5);
    input.tip_target_pos_w_nm = Vec3(x, y, slave.limits().workspace_max_w_nm.z());
    for (int i = 0; i < 100; ++i) slave.step(input, kT, output);
    to(touch + 2.5, 5);
    ASSERT_NE(output.contact_state, link::ContactState::kContact);
    const link::LocalModel told = output.model;
    double z = 0, f = 0;
    while (output.contact_state != link::ContactState::kContact || output.force_w_nn.z() < 0) {
      z = output.commanded_pos_w_nm.z(), f = output.force_w_nn.z();
      to(z - 0.02, 0.02);
      ASSERT_GT(z, touch - 20);
    }
    const double last_z = output.commanded_pos_w_nm.z(), last_f = output.force_w_nn.z();
    const Vec3 zero(x, y, last_z + (z - last_z) * last_f / (last_f - f));
    place_nm.push_back(std::fabs(told.normal_w.dot(told.point_w_nm - zero)));
    double said_nn = 0, most_nn = 0;
    while (output.contact_state == link::ContactState::kContact) {
      if (output.force_w_nn.norm() > most_nn) {  // on slopes the whole, not its vertical part
        most_nn = output.force_w_nn.norm();
        said_nn = output.model.adhesion_nn;
      }
      to(output.commanded_pos_w_nm.z() + 0.02, 0.02);
    }
    adhesion.push_back(std::fabs(said_nn / most_nn - 1));
  }
  std::sort(place_nm.begin(), place_nm.end());
  std::sort(adhesion.begin(), adhesion.end());
  std::printf(
      "ground foretold within %.3f nm in the median, %.3f at 9 of 10; adhesion within %.1f and %.1f %%\n",
      place_nm[12], place_nm[21], 100 * adhesion[12], 100 * adhesion[21]);
  EXPECT_LT(place_nm[12], 0.1);
  EXPECT_LT(place_nm[21], 0.5);
  EXPECT_LT(adhesion[21], 0.1);
}

// No apex anywhere over a scan has an energy below the well that a station is told: looked for on the
// branch in contact, over 2.3 nm of height at each of 2500 places. And the well is that of
// the largest radius of the fields.
TEST(PortModel, TheWellIsNoShallowerThanThePotential) {
  const auto scene = Rig("flakes").scene;
  const PortGround ground(*scene);
  const auto* const fields = dynamic_cast<const physics::ScanFields*>(&scene->potential->fields());
  ASSERT_NE(fields, nullptr);
  double deepest_aj = 0, largest = 0;
  for (int i = 0; i < 50; ++i) {
    for (int j = 0; j < 50; ++j) {
      const double x = 30 + 540 * (i + 0.37) / 50, y = 30 + 540 * (j + 0.61) / 50;
      const double touch = scene->touch_height_nm(x, y);
      physics::PotentialBranch branch;
      branch.inside = true;
      physics::CurveHint hint;
      for (double z = touch - 2.0; z < touch + 0.3; z += 0.05) {
        physics::PotentialSample at;
        if (scene->potential->tip_potential().sample(Vec3(x, y, z), branch, hint, at) !=
            physics::BranchEnd::kNone)
          continue;
        deepest_aj = std::max(deepest_aj, -at.energy_aj);
        largest = std::max(largest, std::exp(at.place.log_radius));
      }
    }
  }
  std::printf("deepest seen %.4g aJ at radii to %.4g nm, told %.4g aJ at %.4g nm\n", deepest_aj, largest,
              ground.well_aj(), ground.well_radius_nm());
  EXPECT_GT(deepest_aj, 5);
  EXPECT_GE(ground.well_aj(), deepest_aj);
  EXPECT_GE(ground.well_radius_nm(), largest);
  EXPECT_NEAR(ground.well_radius_nm(), std::exp(fields->largest_log_radius()), 1e-9 * largest);
}

// What slaves of one scene share must not show: one that was made with it goes bit for bit as one that found
// it itself, and nothing that one slave does reaches the next.
TEST(PortModel, SlavesOfOneSceneShareItsGround) {
  for (const char* name : {"flat_silicon_oxide", "flat_polystyrene", "flakes", "particle"}) {
    SCOPED_TRACE(name);
    Rig rig(name);
    const auto make = nve_slaves(rig.scene);
    for (int made = 0; made < 2; ++made) {
      Rig alone(name);
      const auto slave = make();
      ASSERT_EQ(slave->limits().start_pos_w_nm, alone.slave.limits().start_pos_w_nm);
      SlaveOutput output;
      slave->step(alone.input, kT, output);  // as the rig has done
      alone.input.tip_target_pos_w_nm.z() -= 60;
      for (int k = 0; k < 400; ++k) {
        alone.input.tip_target_pos_w_nm.x() += 0.1;
        alone.step();
        slave->step(alone.input, kT, output);
        ASSERT_EQ(output.force_w_nn, alone.output.force_w_nn);
        ASSERT_EQ(output.model.point_w_nm, alone.output.model.point_w_nm);
        ASSERT_EQ(output.model.stiffness_n_m, alone.output.model.stiffness_n_m);
        ASSERT_EQ(output.model.adhesion_nn, alone.output.model.adhesion_nn);
        ASSERT_EQ(output.energy_in_aj, alone.output.energy_in_aj);
      }
      if (alone.output.model.version > 0) {
        EXPECT_GT(alone.output.model.adhesion_nn, 0);
      }
    }
  }
}

TEST(PortModel, AParticleIsNoGround) {
  Rig rig("particle");
  EXPECT_EQ(rig.output.model.version, 0u);
}

}  // namespace
}  // namespace telenano::slave
