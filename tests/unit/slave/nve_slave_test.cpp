#include "telenano/nve_server/slave/nve_slave.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"

namespace telenano::slave {
namespace {

std::shared_ptr<const scene::Scene> deployed(const char* name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

// The same scene with other numbers, for tests only.
std::shared_ptr<const scene::Scene> changed(const char* name,
                                            const std::function<void(scene::Scene&)>& change) {
  auto scene = std::make_shared<scene::Scene>(*deployed(name));
  change(*scene);
  return scene;
}

SlaveOutput go(NveSlave& slave, const Vec3& target, double dt_s = 1e-3) {
  SlaveInput input;
  input.tip_target_pos_w_nm = target;
  SlaveOutput output;
  slave.step(input, dt_s, output);
  return output;
}

TEST(NveSlave, TellsItsLimits) {
  const NveSlave slave(deployed("flat_silicon_oxide"));
  EXPECT_EQ(slave.limits().start_pos_w_nm, Vec3(0, 0, 20));
  EXPECT_NEAR(slave.limits().surface_z_w_nm, 0, 1e-9);
  EXPECT_NEAR(slave.limits().coupling_stiffness_n_m, 1 / (1 / 20.0 + 1 / 40.0), 1e-12);
  EXPECT_EQ(slave.limits().force_max_nn, 500);
}

TEST(NveSlave, CouplingCantileverAndContactBalance) {
  NveSlave slave(deployed("flat_silicon_oxide"));
  SlaveOutput out;
  for (double z = 20; z >= -5; z -= 0.05) {
    out = go(slave, Vec3(0, 0, z));
    EXPECT_EQ(out.fault_bits, 0u);
    // apex = commanded end + F/k_c + F/k_z, deflection = F/k_z: closed form, to rounding.
    EXPECT_NEAR(out.tip_pos_w_nm.z(), z + out.force_w_nn.z() * (1 / 20.0 + 1 / 40.0), 1e-11);
    EXPECT_NEAR(out.deflection_nm, out.force_w_nn.z() / 40, 1e-12);
  }
  EXPECT_EQ(out.contact_state, link::ContactState::kContact);
  EXPECT_GT(out.force_w_nn.z(), 50);
}

// Account of energy against an independent integral: work of the commanded end = −∫F·dx by the trapezium rule.
// In a jump the end does not move, but the rule sees the force change over one step: error up to ΔF·step/2 a
// jump = 60 nN × 1e-3 nm.
TEST(NveSlave, ChargesTheWorkOfTheCommandedEndOnAFlat) {
  for (const char* name : {"flat_silicon_oxide", "flat_polystyrene", "flat_pdms"}) {
    NveSlave slave(deployed(name));
    go(slave, Vec3(0, 0, 10));
    SlaveOutput before = go(slave, Vec3(0, 0, 10));
    const double counted_at_start = before.energy_in_aj - before.energy_out_aj;
    double work = 0, z = 10;
    const int steps = 13000;
    for (int i = 1; i <= 2 * steps; ++i) {
      const double next = 10 - 1e-3 * (i <= steps ? i : 2 * steps - i);
      const SlaveOutput out = go(slave, Vec3(0, 0, next));
      ASSERT_EQ(out.fault_bits, 0u) << name << " " << next;
      work -= 0.5 * (out.force_w_nn + before.force_w_nn).z() * (next - z);
      ASSERT_NEAR(out.energy_in_aj - out.energy_out_aj - counted_at_start, work, 0.1) << name << " " << next;
      ASSERT_GE(out.energy_in_aj, before.energy_in_aj);
      ASSERT_GE(out.energy_out_aj, before.energy_out_aj);
      z = next;
      before = out;
    }
    EXPECT_GT(work, 0.0) << name;  // snap-in and pull-off lose energy
  }
}

// Whatever the path, the account is stored energy plus losses, and losses never shrink: no path draws energy
// from the scene.
TEST(NveSlave, NoPathDrawsEnergy) {
  for (const char* name : {"flat_silicon_oxide", "flakes"}) {
    NveSlave slave(deployed(name));
    const double stored_at_start = slave.trace().stored_aj;
    const Vec3 start = slave.limits().start_pos_w_nm;
    std::mt19937 random(11);
    std::uniform_real_distribution<double> unit(-1, 1);
    Vec3 target = start;
    double dissipated = 0;
    for (int i = 0; i < 4000; ++i) {
      target += Vec3(2 * unit(random), 2 * unit(random), 3 * unit(random));
      target.z() = std::min(std::max(target.z(), slave.limits().surface_z_w_nm - 8), start.z());
      const SlaveOutput out = go(slave, target);
      const double counted = out.energy_in_aj - out.energy_out_aj;
      // Rounding of the sums: 1e-16 × some 1e5 aJ each.
      ASSERT_NEAR(counted, slave.trace().stored_aj - stored_at_start + slave.trace().dissipated_aj,
                  1e-8 * out.energy_in_aj + 1e-9);
      ASSERT_GE(slave.trace().dissipated_aj, dissipated);
      dissipated = slave.trace().dissipated_aj;
    }
    EXPECT_GT(dissipated, 0);
  }
}

// Damper alone, far from the surface: nothing to hold against, so it takes nothing. In contact: backward
// Euler's loss.
TEST(NveSlave, DamperOfTheCouplingLosesEnergy) {
  const auto damped = changed("flat_silicon_oxide", [](scene::Scene& s) { s.coupling.damping_n_s_m = 0.05; });
  NveSlave slave(damped);
  double loss = 0;
  Vec3 extension = slave.trace().coupling_extension_w_nm;
  for (int i = 0; i < 3000; ++i) {
    const double z = 1.0 - 3 * std::sin(i * 0.01) - (i < 200 ? 0.0 : 2.0);
    go(slave, Vec3(0, 0, z));
    const Vec3 now = slave.trace().coupling_extension_w_nm;
    loss += 0.05 * (now - extension).squaredNorm() / 1e-3;
    extension = now;
    // Force on the end: spring plus damper = −contact force.
    ASSERT_LE(loss, slave.trace().dissipated_aj * (1 + 1e-12) + 1e-9);
  }
  EXPECT_GT(loss, 1.0);
}

TEST(NveSlave, StaysInItsWorkspace) {
  NveSlave slave(deployed("flat_silicon_oxide"));
  SlaveOutput out;
  for (int i = 0; i < 100; ++i) out = go(slave, Vec3(1e5, -1e5, 1e5));
  EXPECT_TRUE(out.fault_bits & link::kFaultWorkspace);
  EXPECT_LT((out.tip_pos_w_nm - Vec3(500, -500, 100)).norm(), 1e-4);  // van der Waals at 100 nm bends 1e-5 nm
}

TEST(NveSlave, HoldsTheTipBackAtTheForceLimitAndLetsItFollowSideways) {
  for (const char* name : {"flat_silicon_oxide", "flakes"}) {
    const auto limited = changed(name, [](scene::Scene& s) { s.limits.force_max_nn = 100; });
    NveSlave slave(limited);
    const Vec3 start = slave.limits().start_pos_w_nm;
    const double deep = slave.limits().surface_z_w_nm - 40;
    for (double z = start.z(); z > deep; z -= 0.5) {
      const SlaveOutput out = go(slave, Vec3(start.x(), start.y(), z));
      ASSERT_LE(out.force_w_nn.norm(), 100.0 + 1e-9) << name << " " << z;
    }
    SlaveOutput out = go(slave, Vec3(start.x(), start.y(), deep));
    EXPECT_TRUE(out.fault_bits & link::kFaultForceLimit) << name;
    // A radius that changes along the ground has a force across the normal, and the whole is more than its
    // normal part.
    const physics::TipSolution held = slave.trace().tip;
    EXPECT_GT(std::max(held.normal_force_nn, held.force_w_nn.norm()), 99.0) << name;
    for (int i = 1; i <= 20; ++i) {
      out = go(slave, Vec3(start.x() + i, start.y(), deep));
      ASSERT_LE(out.force_w_nn.norm(), 100.0 + 1e-9) << name;
    }
    EXPECT_NEAR(out.tip_pos_w_nm.x(), start.x() + 20, 6.0) << name;  // up to 100 nN sideways over 20 N/m
    for (double z = deep; z < start.z(); z += 0.5) out = go(slave, Vec3(start.x() + 20, start.y(), z));
    EXPECT_EQ(out.fault_bits, 0u) << name;
  }
}

TEST(NveSlave, FollowsNoFasterThanItsSpeedLimit) {
  NveSlave slave(deployed("flat_silicon_oxide"));
  SlaveOutput out = go(slave, Vec3(400, 0, 20));
  EXPECT_EQ(out.fault_bits, static_cast<std::uint32_t>(link::kFaultStepLimit));
  EXPECT_NEAR(out.tip_pos_w_nm.x(), 100, 1e-9);  // 100 µm/s for 1 ms
  for (int i = 0; i < 3; ++i) out = go(slave, Vec3(400, 0, 20));
  EXPECT_NEAR(out.tip_pos_w_nm.x(), 400, 1e-9);
  EXPECT_EQ(go(slave, Vec3(400, 0, 20)).fault_bits, 0u);
}

TEST(NveSlave, NonFiniteInputHoldsWithoutForce) {
  NveSlave slave(deployed("flat_silicon_oxide"));
  for (double z = 20; z >= -2; z -= 0.5) go(slave, Vec3(0, 0, z));
  const SlaveOutput before = go(slave, Vec3(0, 0, -2));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Vec3& bad : {Vec3(nan, 0, 0), Vec3(0, 0, INFINITY)}) {
    const SlaveOutput out = go(slave, bad);
    EXPECT_EQ(out.fault_bits, static_cast<std::uint32_t>(link::kFaultNonFinite));
    EXPECT_EQ(out.force_w_nn, Vec3(0, 0, 0));
    EXPECT_EQ(out.tip_pos_w_nm, before.tip_pos_w_nm);
    EXPECT_EQ(out.energy_in_aj, before.energy_in_aj);
  }
  EXPECT_EQ(go(slave, Vec3(0, 0, -2), nan).fault_bits, static_cast<std::uint32_t>(link::kFaultNonFinite));
  const SlaveOutput after = go(slave, Vec3(0, 0, -2));
  EXPECT_NEAR(after.force_w_nn.z(), before.force_w_nn.z(), 1e-6);
}

TEST(NveSlave, HoldsAndRetractsAndComesBackWithoutAJump) {
  NveSlave slave(deployed("flat_silicon_oxide"));
  for (double z = 20; z >= -2; z -= 0.5) go(slave, Vec3(0, 0, z));
  SlaveInput input;
  SlaveOutput out;
  input.follow = false;
  input.tip_target_pos_w_nm = Vec3(50, 50, 50);
  slave.step(input, 1e-3, out);
  EXPECT_EQ(slave.trace().commanded_end_w_nm, Vec3(0, 0, -2));
  input.retract = true;
  double z = -2;
  for (int i = 0; i < 110; ++i) {
    slave.step(input, 1e-3, out);
    EXPECT_TRUE(out.fault_bits & link::kFaultRetracted);
    EXPECT_LE(slave.trace().commanded_end_w_nm.z() - z, 1.0 + 1e-9);  // 1 µm/s for 1 ms
    z = slave.trace().commanded_end_w_nm.z();
  }
  EXPECT_NEAR(z, 100, 1e-9);
  EXPECT_NEAR(out.force_w_nn.norm(), 0, 1e-2);
  input.retract = false;
  input.follow = true;
  const Vec3 at = slave.trace().commanded_end_w_nm;
  slave.step(input, 1e-4, out);
  EXPECT_LE((slave.trace().commanded_end_w_nm - at).norm(), 10.0 + 1e-9);  // 100 µm/s for 0.1 ms
}

TEST(NveSlave, SurvivesLeapsOfAMicrometre) {
  const auto fast = changed("flakes", [](scene::Scene& s) { s.limits.speed_max_nm_s = 1e7; });
  NveSlave slave(fast);
  std::mt19937 random(12);
  std::uniform_real_distribution<double> place(30, 570), height(-20, 60);
  int no_balance = 0;
  for (int i = 0; i < 300; ++i) {
    const SlaveOutput out = go(slave, Vec3(place(random), place(random), height(random)));
    ASSERT_TRUE(is_finite(out.force_w_nn) && is_finite(out.tip_pos_w_nm));
    // Never through the surface: the sphere's lowest point stays within its overlap of it.
    ASSERT_GT(out.tip_pos_w_nm.z(), fast->surface->lowest_nm() - 3.0);
    ASSERT_LE(out.force_w_nn.norm(), fast->limits.force_max_nn + 1e-6);
    if (out.fault_bits & link::kFaultNoEquilibrium) ++no_balance;
  }
  EXPECT_LT(no_balance, 30);
}

// The three tasks at 1 µm/s over the whole scan: a balance at every step.
TEST(NveSlave, FindsABalanceAllOverTheScan) {
  NveSlave slave(deployed("flakes"));
  for (const double height : {15.0, 6.0, 1.0}) {
    for (double y = 60; y < 560; y += 100) {
      for (double x = 40; x <= 560; x += 1) {
        const SlaveOutput out = go(slave, Vec3(x, y, height));
        ASSERT_FALSE(out.fault_bits & link::kFaultNoEquilibrium) << x << " " << y << " " << height;
      }
    }
  }
}

TEST(NveSlave, StepTakesNothingFromTheHeap) {
  for (const char* name : {"flat_silicon_oxide", "flakes"}) {
    NveSlave slave(deployed(name));
    const Vec3 start = slave.limits().start_pos_w_nm;
    go(slave, start);
    const support::AllocGuard guard;
    for (int i = 0; i < 3000; ++i) go(slave, start - Vec3(0, 0, 0.01 * i));
    go(slave, Vec3(NAN, 0, 0));
    EXPECT_EQ(guard.allocations(), 0u) << name;
  }
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
}

TEST(NveSlave, SameCommandsSameBits) {
  const auto scene = deployed("flakes");
  NveSlave a(scene), b(scene);
  const Vec3 start = scene->start_apex_w_nm;
  for (int i = 0; i < 3000; ++i) {
    const Vec3 target = start + Vec3(0.05 * i, 0.02 * i, -0.01 * i);
    const SlaveOutput x = go(a, target), y = go(b, target);
    ASSERT_EQ(x.force_w_nn, y.force_w_nn);
    ASSERT_EQ(x.energy_in_aj, y.energy_in_aj);
  }
}

}  // namespace
}  // namespace telenano::slave
