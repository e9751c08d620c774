// What a step may cost: counted in solvers' iterations, ended where the count is used up, the rest of the way
// left for later steps.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano::slave {
namespace {

std::shared_ptr<const scene::Scene> project_scene(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

/// Presses the tip of `slave` in by `depth_nm`, with steps of 1 ms.
SlaveOutput pressed(NveSlave& slave, double depth_nm) {
  SlaveInput input;
  SlaveOutput output;
  input.tip_target_pos_w_nm = slave.limits().start_pos_w_nm;
  while (input.tip_target_pos_w_nm.z() > slave.limits().surface_z_w_nm - depth_nm) {
    input.tip_target_pos_w_nm.z() -= 0.2;
    slave.step(input, 1e-3, output);
  }
  return output;
}

class Work : public testing::TestWithParam<const char*> {};

// A single balance may go over: a flow takes up to eight of them, at the force limit thirteen times. What is
// asserted is that a step of 200 nm, which takes ten to a hundred times as much, does not.
TEST_P(Work, AStepEndsWhereItsWorkIsUsedUp) {
  const auto scene = project_scene(GetParam());
  NveSlave bounded(scene), unbounded(scene);
  const SlaveOutput before = pressed(bounded, 6);
  pressed(unbounded, 6);
  SlaveInput far;
  far.tip_target_pos_w_nm = before.commanded_pos_w_nm + Vec3(120, 40, 0);
  SlaveOutput all, some;
  unbounded.step(far, 0.1, all);
  EXPECT_EQ(all.fault_bits & link::kFaultShare, 0u) << "without a bound it goes all the way";
  EXPECT_NEAR(all.commanded_pos_w_nm.x(), far.tip_target_pos_w_nm.x(), 1);
  far.work_most = 20;
  bounded.step(far, 0.1, some);
  EXPECT_NE(some.fault_bits & link::kFaultShare, 0u);
  std::printf("%s: a step of %.0f nm takes %u; bounded to 20 it takes %u and goes %.1f nm\n", GetParam(),
              (all.commanded_pos_w_nm - before.commanded_pos_w_nm).norm(), all.work, some.work,
              (some.commanded_pos_w_nm - before.commanded_pos_w_nm).norm());
  EXPECT_GT(all.work, 8 * some.work);
  EXPECT_GT((some.commanded_pos_w_nm - before.commanded_pos_w_nm).norm(), 0.1) << "some of the way is made";
}

// Nothing of the motion is lost: the same target, said again, is come to. On the way it is no work of the
// port's more than the way costs: the account says so, which is a function of the state.
TEST_P(Work, WhatIsLeftOfTheWayIsCaughtUpWith) {
  const auto scene = project_scene(GetParam());
  NveSlave slave(scene);
  const SlaveOutput before = pressed(slave, 6);
  SlaveInput far;
  far.tip_target_pos_w_nm = before.commanded_pos_w_nm + Vec3(30, 10, 0.5);
  far.work_most = 40;
  SlaveOutput output;
  int steps = 0;
  do {
    slave.step(far, 0.01, output);
    ++steps;
  } while ((output.fault_bits & link::kFaultShare) != 0 && steps < 10'000);
  EXPECT_GT(steps, 3);
  EXPECT_EQ(output.fault_bits & ~std::uint32_t{link::kFaultForceLimit}, 0u);
  // Held back by the force limit along the normal only.
  EXPECT_NEAR(output.commanded_pos_w_nm.x(), far.tip_target_pos_w_nm.x(), 0.5);
  EXPECT_NEAR(output.commanded_pos_w_nm.y(), far.tip_target_pos_w_nm.y(), 0.5);
}

// A step that stays within its bound is the step that it would have been without one, to the bit.
TEST_P(Work, ABoundThatIsNotReachedChangesNothing) {
  const auto scene = project_scene(GetParam());
  NveSlave bounded(scene), unbounded(scene);
  SlaveInput input;
  SlaveOutput a, b;
  const Vec3 start = bounded.limits().start_pos_w_nm;
  for (int k = 0; k < 400; ++k) {
    input.tip_target_pos_w_nm =
        start + Vec3(0.1 * k, 0.03 * k,
                     -(start.z() - bounded.limits().surface_z_w_nm + 4) * std::min(1.0, k / 200.0));
    input.work_most = UINT32_MAX;
    unbounded.step(input, 1e-3, a);
    input.work_most = 5000;
    bounded.step(input, 1e-3, b);
    ASSERT_EQ(a.force_w_nn, b.force_w_nn) << k;
    ASSERT_EQ(a.work, b.work) << k;
  }
  EXPECT_EQ(bounded.state_hash(), unbounded.state_hash());
}

INSTANTIATE_TEST_SUITE_P(Scenes, Work, testing::Values("lithography", "particle"),
                         [](const auto& instance) { return std::string(instance.param); });

}  // namespace
}  // namespace telenano::slave
