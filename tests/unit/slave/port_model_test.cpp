// What the slave says of its port against what the port then does.
#include "nve_server/slave/port_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "nve_server/slave/nve_slave.h"
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
