// A simulated operator who changes tasks, with the station's own mapping from hand to tip between: where the
// tip goes on the way, whatever has happened to the anchor before.
#include "telenano/master/device/task_change.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"
#include "telenano/master/device/sim_device.h"
#include "telenano/master/station/workspace_mapping.h"
#include "tests/support/alloc_guard.h"

namespace telenano::device {
namespace {

constexpr double kHeight_nm = 40;

/// Device and mapping; the tip is a point that is where it is wanted.
struct Bench {
  explicit Bench(Task first = Task::kIndent) : device(config(), motion(first)), mapping({velocity_scale, 1}) {
    mapping.begin(Vec3(0, 0, kHeight_nm), Vec3::Constant(-400), Vec3::Constant(400));
    scan = device.add_task(motion(Task::kScan));
    hover = device.add_task(motion(Task::kPosition));
    free = device.add_free_task(pointer);
    device.start_motion();
  }
  static SimDeviceConfig config() {
    SimDeviceConfig config;
    config.start_height_nm = kHeight_nm;
    return config;
  }
  static IntendedMotion motion(Task task) {
    TaskOptions options;
    options.start_height_nm = kHeight_nm;
    options.scan_size_nm = 20;
    return IntendedMotion::for_task(task, options);
  }
  void tick() {
    device.see_tip({mapping.target_w_nm(), 1e-9 / velocity_scale, engaged});
    device.advance(1'000'000);
    DeviceReading reading;
    device.read(reading);
    engaged = !stopped && (reading.buttons & kButtonClutch) == 0 && (reading.buttons & kButtonDeadman) != 0;
    const Vec3 before = mapping.target_w_nm();
    mapping.update(engaged, reading.hand_pos_h_m);
    step_nm = (mapping.target_w_nm() - before).norm();
    hand_m = reading.hand_pos_h_m;
    buttons = reading.buttons;
  }
  void run(double seconds) {
    for (int i = 0; i < seconds * 1000; ++i) tick();
  }
  /// Until it is at the start; the least height, and the least at which it moves across, on the way.
  void change_over(double give_up_s) {
    lowest_nm = lowest_across_nm = 1e9;
    fastest_nm_s = 0;
    for (int i = 0; i < give_up_s * 1000 && device.task().changing; ++i) {
      const Vec3 before = mapping.target_w_nm();
      const Vec3 hand_before_m = hand_m;
      tick();
      const Vec3 now = mapping.target_w_nm();
      lowest_nm = std::min(lowest_nm, now.z());
      // Friction leaves the hand a little behind on every axis.
      if ((now - before).head<2>().norm() > 0.002) lowest_across_nm = std::min(lowest_across_nm, now.z());
      fastest_nm_s = std::max(fastest_nm_s, step_nm * 1e3);
      fastest_hand_m_s = std::max(fastest_hand_m_s, (hand_m - hand_before_m).norm() * 1e3);
    }
    EXPECT_FALSE(device.task().changing);
  }
  double velocity_scale = 1e-6;
  rt::LatestValue<PointerState> pointer;
  SimDevice device;
  station::WorkspaceMapping mapping;
  int scan = 0, hover = 0, free = 0;
  bool engaged = true, stopped = false;
  Vec3 hand_m = Vec3::Zero();
  std::uint32_t buttons = 0;
  double step_nm = 0, lowest_nm = 0, lowest_across_nm = 0, fastest_nm_s = 0, fastest_hand_m_s = 0;
};

TEST(TaskChange, LiftsBeforeItGoesOverAndBeginsAtTheStart) {
  Bench bench;
  bench.run(6);  // of 10: pressing, 5 nm deep
  const double deep_nm = bench.mapping.target_w_nm().z();
  ASSERT_NEAR(deep_nm, -5, 0.2);
  ASSERT_TRUE(bench.device.begin_task(bench.scan));
  EXPECT_EQ(bench.device.task().task, bench.scan);
  EXPECT_EQ(bench.device.motion_time_s(), 0);
  bench.change_over(20);
  EXPECT_GE(bench.lowest_nm, deep_nm - 1e-9);
  EXPECT_GE(bench.lowest_across_nm, kHeight_nm - 1.5);  // the nanometre that is enough, and friction
  // 0.05 m/s at a nanometre to the millimetre; the hand of 400 N/m overshoots its intention a little.
  EXPECT_LE(bench.fastest_nm_s, 1.3 * 50);
  EXPECT_LE(bench.fastest_hand_m_s, 0.25);  // half of the velocity trip
  EXPECT_LE((bench.mapping.target_w_nm() - Vec3(0, 0, kHeight_nm)).cwiseAbs().maxCoeff(), 2);
  // And the new task is done where it says: lines 0.5 nm deep between ±10 nm.
  double lowest = 1e9, left = 0, right = 0;
  for (int i = 0; i < 10'000; ++i) {
    bench.tick();
    lowest = std::min(lowest, bench.mapping.target_w_nm().z());
    left = std::min(left, bench.mapping.target_w_nm().x());
    right = std::max(right, bench.mapping.target_w_nm().x());
  }
  EXPECT_TRUE(bench.device.motion_done());
  // What the change was off by, at most 2 % of the box (80 mm high, 1 mm to the nanometre).
  EXPECT_NEAR(lowest, -0.5, 1.6);
  EXPECT_NEAR(left, -10, 1.6);
  EXPECT_NEAR(right, 10, 1.6);
}

TEST(TaskChange, TheTipStandsWhileTheClutchIsPressed) {
  Bench bench;
  bench.run(6);
  ASSERT_TRUE(bench.device.begin_task(bench.hover));
  const Vec3 stood = bench.mapping.target_w_nm();
  bench.tick();
  ASSERT_NE(bench.buttons & kButtonClutch, 0u);
  int pressed = 0;
  while ((bench.buttons & kButtonClutch) != 0 && pressed < 5000) {
    ASSERT_EQ(bench.mapping.target_w_nm(), stood);
    bench.tick();
    ++pressed;
  }
  EXPECT_GE(pressed, 400);  // the hand has come to rest
  EXPECT_LT(pressed, 5000);
}

TEST(TaskChange, FindsTheStartFromATipThatAStopHasWithdrawn) {
  Bench bench;
  bench.run(6);
  bench.stopped = true;
  bench.run(0.5);
  bench.mapping.stand_at(Vec3(3, -4, 300));  // 260 mm of hand away, several times its box
  bench.stopped = false;
  bench.run(0.1);
  ASSERT_TRUE(bench.device.begin_task(bench.scan));
  bench.change_over(120);
  EXPECT_LE((bench.mapping.target_w_nm() - Vec3(0, 0, kHeight_nm)).cwiseAbs().maxCoeff(), 2);
  EXPECT_GE(bench.lowest_nm, kHeight_nm - 2);
  EXPECT_LE(bench.hand_m.cwiseAbs().maxCoeff(), 0.08);
}

TEST(TaskChange, AStopOnTheWayBeginsANewStroke) {
  Bench bench;
  bench.run(6);
  ASSERT_TRUE(bench.device.begin_task(bench.hover));
  while ((bench.buttons & kButtonClutch) != 0 || !bench.engaged || bench.step_nm < 0.02) bench.tick();
  bench.stopped = true;  // in the middle of lifting
  bench.run(0.05);
  EXPECT_NE(bench.buttons & kButtonClutch, 0u);  // it goes no further without the tip
  bench.run(0.95);
  bench.mapping.stand_at(Vec3(0, 0, 120));
  bench.stopped = false;
  bench.change_over(60);
  EXPECT_LE((bench.mapping.target_w_nm() - Vec3(0, 0, kHeight_nm)).cwiseAbs().maxCoeff(), 2);
}

TEST(TaskChange, FollowsTheScaleOfTheDay) {
  Bench bench;
  bench.run(6);
  bench.velocity_scale = 2e-6;
  bench.mapping.rescale({2e-6, 1}, bench.hand_m);
  bench.run(0.1);
  ASSERT_TRUE(bench.device.begin_task(bench.scan));
  bench.change_over(30);
  double left = 0, right = 0;
  for (int i = 0; i < 10'000; ++i) {
    bench.tick();
    left = std::min(left, bench.mapping.target_w_nm().x());
    right = std::max(right, bench.mapping.target_w_nm().x());
  }
  EXPECT_NEAR(right - left, 20, 1);  // not twice as wide
  // A scale at which the lines would leave the box: said, and nothing changes.
  bench.velocity_scale = 1e-7;
  bench.mapping.rescale({1e-7, 1}, bench.hand_m);
  bench.tick();
  EXPECT_FALSE(bench.device.begin_task(bench.scan));
  EXPECT_FALSE(bench.device.task().changing);
  EXPECT_FALSE(bench.device.begin_task(-1));
  EXPECT_FALSE(bench.device.begin_task(99));
}

TEST(TaskChange, AFreeHandGoesWhereThePointerSaysWhileItIsHeld) {
  Bench bench;
  bench.run(1);
  ASSERT_TRUE(bench.device.begin_task(bench.free));
  bench.change_over(30);
  bench.run(0.2);
  const Vec3 start = bench.mapping.target_w_nm();
  PointerState state;
  state.hand_pos_h_m = {0.010, 0, -0.020};
  for (int i = 0; i < 2000; ++i) {  // not held: the tip stands
    bench.pointer.store(state);
    bench.tick();
  }
  EXPECT_EQ(bench.mapping.target_w_nm(), start);
  state.hand_pos_h_m = {0, 0, 0};
  for (int i = 0; i < 2000; ++i) {
    bench.pointer.store(state);
    bench.tick();
  }
  state.buttons = kButtonDeadman;
  bench.pointer.store(state);
  bench.tick();
  state.hand_pos_h_m = {0.010, 0, -0.020};
  for (int i = 0; i < 2000; ++i) {
    bench.pointer.store(state);
    bench.tick();
  }
  const Vec3 way = bench.mapping.target_w_nm() - start;
  EXPECT_NEAR(way.x(), 10, 0.2);  // friction, twice 0.06 mm
  EXPECT_NEAR(way.z(), -20, 0.2);
  EXPECT_FALSE(bench.device.motion_done());
  // Back to a task of its own.
  ASSERT_TRUE(bench.device.begin_task(0));
  bench.change_over(30);
  EXPECT_LE((bench.mapping.target_w_nm() - Vec3(0, 0, kHeight_nm)).cwiseAbs().maxCoeff(), 2);
}

TEST(TaskChange, AllocatesNothing) {
  Bench bench;
  bench.run(1);
  const support::AllocGuard guard;
  bench.device.begin_task(bench.free);
  bench.run(6);
  bench.device.begin_task(bench.scan);
  bench.run(6);
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST(TaskChange, ATaskIsNotBegunBeforeTheFirstHasStarted) {
  SimDevice device(Bench::config(), Bench::motion(Task::kIndent));
  device.add_task(Bench::motion(Task::kScan));
  EXPECT_FALSE(device.begin_task(1));
  device.start_motion();
  EXPECT_TRUE(device.begin_task(1));
}

}  // namespace
}  // namespace telenano::device
