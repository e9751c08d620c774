// What every slave must do, whatever is behind its port: the virtual environment, an AFM behind its
// controller (simulated, in virtual time), a wall that can be computed by hand.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <string>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/virtual_afm_slave.h"
#include "tests/support/wall_slave.h"

namespace telenano::slave {
namespace {

constexpr double kT = 1e-3;

struct Kind {
  std::string name;
  std::function<std::unique_ptr<Slave>()> make;
  double force_slack_nn;  ///< over the limit: noise and slow bending of a lever that is read now and then
  double
      energy_slack_aj;  ///< that a closed path may seem to yield: the account's own bound, where it has one
  double settle_s;      ///< for a move of a few nanometres
};

const support::VirtualAfm& ready_afm() {
  static const support::VirtualAfm kReady =
      support::approached(afm::AfmConfig{}, afm_sim::SimConfig{}, afm_sim::default_scene());
  return kReady;
}

Kind nve() {
  const auto scene = scene::load_scene(TELENANO_SOURCE_DIR "/deploy/scenes/flat_silicon_oxide.toml");
  return {"nve", [scene] { return std::make_unique<NveSlave>(scene); }, 1e-6, 1e-6, 0.01};
}
Kind wall() {
  return {"wall", [] { return std::make_unique<support::WallSlave>(support::WallSlaveConfig{}); }, 1e-9, 1e-9,
          0.01};
}
Kind afm_kind() {
  return {"afm", [] { return std::make_unique<support::VirtualAfmSlave>(ready_afm()); }, 15, 60, 0.5};
}

class SlaveContract : public ::testing::TestWithParam<Kind (*)()> {
 protected:
  SlaveContract() : kind(GetParam()()), slave(kind.make()) {
    input.tip_target_pos_w_nm = slave->limits().start_pos_w_nm;
    step();
  }
  void step(double dt_s = kT) {
    const SlaveOutput last = output;
    slave->step(input, dt_s, output);
    check(last);
  }
  void run(double seconds) {
    for (int i = static_cast<int>(seconds / kT); i > 0; --i) step();
  }
  void check(const SlaveOutput& last) {
    const SlaveLimits& limits = slave->limits();
    ASSERT_TRUE(is_finite(output.force_w_nn) && is_finite(output.tip_pos_w_nm) &&
                is_finite(output.commanded_pos_w_nm) && std::isfinite(output.deflection_nm));
    ASSERT_TRUE(link::is_finite(output.model));
    ASSERT_GE(output.energy_in_aj, last.energy_in_aj);
    ASSERT_GE(output.energy_out_aj, last.energy_out_aj);
    ASSERT_GE(output.measurement_age_ns, 0);
    ASSERT_LE(output.force_w_nn.norm(), limits.force_max_nn * (1 + 1e-3) + kind.force_slack_nn);
    for (int i = 0; i < 3; ++i) {
      ASSERT_GE(output.commanded_pos_w_nm[i], limits.workspace_min_w_nm[i] - 1e-6);
      ASSERT_LE(output.commanded_pos_w_nm[i], limits.workspace_max_w_nm[i] + 1e-6);
    }
    if (output.model.version != 0) {
      ASSERT_NEAR(output.model.normal_w.norm(), 1, 1e-6);
      ASSERT_GE(output.model.stiffness_n_m, 0);
      ASSERT_LE(output.model.stiffness_n_m, limits.coupling_stiffness_n_m * 1.3);
      ASSERT_GE(output.model.adhesion_nn, 0);
    }
  }
  void go(double z_nm, double seconds = 1) {
    input.tip_target_pos_w_nm.z() = z_nm;
    run(seconds);
  }
  double net_aj() const { return output.energy_in_aj - output.energy_out_aj; }

  Kind kind;
  std::unique_ptr<Slave> slave;
  SlaveInput input;
  SlaveOutput output;
};

TEST_P(SlaveContract, LimitsMakeSense) {
  const SlaveLimits& l = slave->limits();
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(l.workspace_min_w_nm[i], l.workspace_max_w_nm[i]);
    EXPECT_GE(l.start_pos_w_nm[i], l.workspace_min_w_nm[i]);
    EXPECT_LE(l.start_pos_w_nm[i], l.workspace_max_w_nm[i]);
  }
  EXPECT_GT(l.start_pos_w_nm.z(), l.surface_z_w_nm);
  EXPECT_GT(l.force_max_nn, 0);
  EXPECT_GT(l.coupling_stiffness_n_m, 0);
  EXPECT_GT(l.rate_max_hz, 0u);
}

TEST_P(SlaveContract, FreeAtTheStartAndThereWhenCommanded) {
  go(slave->limits().start_pos_w_nm.z(), kind.settle_s);
  EXPECT_NEAR(output.force_w_nn.norm(), 0, 2);
  EXPECT_LT((output.commanded_pos_w_nm - input.tip_target_pos_w_nm).norm(), 0.1);
}

TEST_P(SlaveContract, PressedItPushesAndLetGoItIsFreeAndTheAccountCloses) {
  const double surface = slave->limits().surface_z_w_nm;
  go(surface + 3, kind.settle_s);
  const double before = net_aj();
  go(surface - 4, kind.settle_s);
  EXPECT_GT(output.force_w_nn.z(), 10);
  EXPECT_EQ(output.contact_state, link::ContactState::kContact);
  EXPECT_GT(net_aj(), before);
  go(surface + 15, kind.settle_s);
  EXPECT_NEAR(output.force_w_nn.norm(), 0, 3);
  EXPECT_GE(net_aj() - before, -kind.energy_slack_aj) << "a port gives back no more than it got";
}

TEST_P(SlaveContract, TheForceLimitHolds) {
  go(slave->limits().workspace_min_w_nm.z(), 3);
  EXPECT_GT(output.force_w_nn.z(), 0.8 * slave->limits().force_max_nn);
  EXPECT_NE(output.fault_bits & link::kFaultForceLimit, 0u);
  EXPECT_GT(output.commanded_pos_w_nm.z(), input.tip_target_pos_w_nm.z());
}

TEST_P(SlaveContract, OutOfTheWorkspaceItStaysInside) {
  input.tip_target_pos_w_nm = Vec3(1e6, -1e6, 1e6);
  run(0.2);
  EXPECT_NE(output.fault_bits & link::kFaultWorkspace, 0u);
}

TEST_P(SlaveContract, NotFollowingItHolds) {
  go(slave->limits().surface_z_w_nm + 5, kind.settle_s);
  const Vec3 held = output.commanded_pos_w_nm;
  input.follow = false;
  go(slave->limits().surface_z_w_nm - 10, 0.3);
  EXPECT_LT((output.commanded_pos_w_nm - held).norm(), 0.1);
}

TEST_P(SlaveContract, RetractGoesUpWhateverIsCommandedAndSaysSo) {
  go(slave->limits().surface_z_w_nm - 3, kind.settle_s);
  ASSERT_GT(output.force_w_nn.z(), 1);
  input.retract = true;
  go(slave->limits().surface_z_w_nm - 10, 1);
  EXPECT_NE(output.fault_bits & link::kFaultRetracted, 0u);
  EXPECT_NEAR(output.force_w_nn.norm(), 0, 1e-3) << "van der Waals attraction reaches that far";
  EXPECT_GT(output.commanded_pos_w_nm.z(), slave->limits().start_pos_w_nm.z() - 1e-9);
}

TEST_P(SlaveContract, RandomAndSenselessInputDoesNoHarm) {
  Random random(3);
  const SlaveLimits& l = slave->limits();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 4000; ++i) {
    if (i % 40 == 0) {
      for (int k = 0; k < 3; ++k)
        input.tip_target_pos_w_nm[k] = random.uniform(l.workspace_min_w_nm[k], l.workspace_max_w_nm[k]);
      input.follow = random.chance(0.8);
      input.wants_model = random.chance(0.5);
      if (random.chance(0.1)) input.tip_target_pos_w_nm[random.below(3)] = random.chance(0.5) ? nan : 1e300;
    }
    const double odd[] = {kT, kT, kT, 0.0, -1.0, nan, 1e-9, 0.05};
    step(odd[random.below(8)]);
    if (!is_finite(input.tip_target_pos_w_nm)) {
      EXPECT_NE(output.fault_bits & link::kFaultNonFinite, 0u);
      EXPECT_EQ(output.force_w_nn.norm(), 0);
    }
  }
}

TEST_P(SlaveContract, AnotherOneBeginsAtTheStart) {
  go(slave->limits().surface_z_w_nm - 3, kind.settle_s);
  slave = kind.make();
  output = {};
  input.tip_target_pos_w_nm = slave->limits().start_pos_w_nm;
  run(kind.settle_s);
  EXPECT_NEAR(output.force_w_nn.norm(), 0, 3);
  EXPECT_LT((output.commanded_pos_w_nm - slave->limits().start_pos_w_nm).norm(), 0.5);
}

INSTANTIATE_TEST_SUITE_P(All, SlaveContract, ::testing::Values(&nve, &wall, &afm_kind),
                         [](const auto& kind) { return kind.param().name; });

// What only a slave with a measurement can get wrong.

struct AfmRig {
  support::VirtualAfmSlave slave{ready_afm()};
  SlaveInput input;
  SlaveOutput output;
  AfmRig() {
    input.tip_target_pos_w_nm = Vec3(0, 0, -3);
    run(0.6);
  }
  void run(double seconds) {
    for (int i = static_cast<int>(seconds / kT); i > 0; --i) slave.step(input, kT, output);
  }
};

TEST(AfmContract, TheAgeOfTheMeasurementIsWhatItIs) {
  AfmRig rig;
  std::int64_t most = 0, least = INT64_MAX;
  for (int i = 0; i < 500; ++i) {
    rig.run(kT);
    most = std::max(most, rig.output.measurement_age_ns);
    least = std::min(least, rig.output.measurement_age_ns);
  }
  // At 200 Hz: half a period when a value arrives, a period and the replies' latency more before the next.
  EXPECT_GE(least, 2'000'000);
  EXPECT_LE(most, 11'000'000);
}

TEST(AfmContract, FaultsEndWithdrawnWithZeroForceAndStaySoUntilCleared) {
  using afm_sim::FaultKind;
  for (const FaultKind kind : {FaultKind::kGarbage, FaultKind::kReset, FaultKind::kSilent}) {
    AfmRig rig;
    ASSERT_GT(rig.output.force_w_nn.z(), 20);
    rig.slave.afm().apply({0, kind, 300'000'000, 0});
    rig.run(0.6);
    EXPECT_TRUE(rig.slave.afm().controller().withdrawn());
    EXPECT_EQ(rig.output.force_w_nn.norm(), 0);
    EXPECT_NE(rig.output.fault_bits & link::kFaultRetracted, 0u);
    rig.run(1);
    EXPECT_TRUE(rig.slave.afm().controller().withdrawn()) << "latched, though the target goes on";
    // The server's own retract, on silence, clears nothing.
    rig.input.retract = true;
    rig.run(0.1);
    rig.input.retract = false;
    rig.run(0.5);
    EXPECT_TRUE(rig.slave.afm().controller().withdrawn());
    // An operator's stop, released, does.
    rig.input.retract = rig.input.by_operator = true;
    rig.run(0.1);
    rig.input.retract = rig.input.by_operator = false;
    rig.run(8);
    EXPECT_GT(rig.output.force_w_nn.z(), 20) << "touching again";
  }
}

TEST(AfmContract, TheLinkIsLostWhenNoStepComes) {
  AfmRig rig;
  rig.slave.idle(0.15);
  EXPECT_TRUE(rig.slave.afm().controller().withdrawn());
  rig.run(0.2);
  EXPECT_NE(rig.output.fault_bits & link::kFaultRetracted, 0u);
}

TEST(AfmContract, TheAccountIsTheTrueWorkWithinItsBound) {
  for (const double rate_hz : {200.0, 20.0}) {
    afm::AfmConfig config;
    config.force_rate_hz = rate_hz;
    afm_sim::SimConfig rig_config;
    support::VirtualAfmSlave slave(support::approached(config, rig_config, afm_sim::default_scene()));
    SlaveInput input;
    SlaveOutput output;
    Random random(5);
    const auto run = [&](double seconds) {
      for (int i = static_cast<int>(seconds / kT); i > 0; --i) slave.step(input, kT, output);
    };
    input.tip_target_pos_w_nm = Vec3(0, 0, 15);
    run(0.5);
    const double work_before = slave.afm().controller().tip().work_aj();
    const double counted_before = output.energy_in_aj - output.energy_out_aj;
    const double bound_before = slave.afm().logic().state().energy_bound_aj;
    for (int i = 0; i < 12; ++i) {
      input.tip_target_pos_w_nm.z() = random.uniform(-5, 6);
      run(0.7);
      // The simulator's own integral over its true positions, in steps of half a millisecond and less. Drift
      // moves the base as well: its work, at most 0.05 nm/s of it, is not the port's.
      const double work = slave.afm().controller().tip().work_aj() - work_before;
      const double counted = output.energy_in_aj - output.energy_out_aj - counted_before;
      const double bound = slave.afm().logic().state().energy_bound_aj - bound_before;
      const double drift = 0.1 * 300 * 0.7 * (i + 1);
      EXPECT_LE(std::fabs(work - counted), bound + drift) << rate_hz << " Hz, " << i;
    }
  }
}

}  // namespace
}  // namespace telenano::slave
