#include "telenano/master/device/intended_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

double lowest_nm(const IntendedMotion& motion, double from_s, double to_s) {
  double lowest = 1e300;
  for (double t = from_s; t <= to_s; t += 1e-3) lowest = std::fmin(lowest, motion.pos_nm(t).z());
  return lowest;
}

double highest_nm(const IntendedMotion& motion, double from_s, double to_s) {
  double highest = -1e300;
  for (double t = from_s; t <= to_s; t += 1e-3) highest = std::fmax(highest, motion.pos_nm(t).z());
  return highest;
}

TEST(IntendedMotion, PositionHoldsTenToTwentyNanometresAboveTheSurface) {
  const auto motion = IntendedMotion::for_task(Task::kPosition, {});
  EXPECT_NEAR(motion.pos_nm(0).z(), 40, 0);
  EXPECT_NEAR(lowest_nm(motion, 0, 10), 10, 1e-6);
  EXPECT_NEAR(lowest_nm(motion, 2, 10), 10, 1e-6);
  EXPECT_NEAR(highest_nm(motion, 2, 10), 20, 1e-6);
}

TEST(IntendedMotion, ContactJustTouchesAndLeaves) {
  const auto motion = IntendedMotion::for_task(Task::kContact, {});
  EXPECT_NEAR(lowest_nm(motion, 0, 10), -0.5, 1e-9);
  EXPECT_NEAR(motion.pos_nm(10).z(), 40, 0);
}

TEST(IntendedMotion, IndentPressesToItsDepthAndRetracts) {
  TaskOptions options;
  options.depth_nm = 7;
  options.duration_s = 4;
  const auto motion = IntendedMotion::for_task(Task::kIndent, options);
  EXPECT_NEAR(lowest_nm(motion, 0, 4), -7, 1e-9);
  EXPECT_NEAR(motion.duration_s(), 4, 0);
  EXPECT_NEAR(motion.pos_nm(99).z(), 40, 0);  // at rest after the end
}

// A station that was killed in contact and resumes its session finds the tip where it pressed.
TEST(IntendedMotion, BeginsBelowTheSurfaceWhereTheTipStillPresses) {
  TaskOptions options;
  options.start_height_nm = -2.72;
  for (const Task task : {Task::kPosition, Task::kContact, Task::kIndent, Task::kScan}) {
    const auto motion = IntendedMotion::for_task(task, options);
    EXPECT_EQ(motion.pos_nm(0).z(), -2.72) << task_name(task);
  }
}

TEST(IntendedMotion, ScanCoversItsSquareInLightContact) {
  TaskOptions options;
  options.scan_size_nm = 30;
  options.scan_lines = 4;
  const auto motion = IntendedMotion::for_task(Task::kScan, options);
  double min_x = 0, max_x = 0, min_y = 0, max_y = 0;
  for (double t = 2.0; t <= 8.5; t += 1e-3) {
    const Vec3 p = motion.pos_nm(t);
    min_x = std::fmin(min_x, p.x()), max_x = std::fmax(max_x, p.x());
    min_y = std::fmin(min_y, p.y()), max_y = std::fmax(max_y, p.y());
    ASSERT_NEAR(p.z(), -0.5, 1e-6);
  }
  EXPECT_NEAR(min_x, -15, 1e-6);
  EXPECT_NEAR(max_x, 15, 1e-6);
  EXPECT_NEAR(min_y, -15, 1e-6);
  EXPECT_NEAR(max_y, 15, 1e-6);
}

TEST(IntendedMotion, IsSmooth) {
  for (Task task : {Task::kPosition, Task::kContact, Task::kIndent, Task::kScan}) {
    const auto motion = IntendedMotion::for_task(task, {});
    // Least-jerk way of 40 nm in 0.1·10 s or more: speed ≤ 1.875·d/t, acceleration ≤ 5.78·d/t².
    Vec3 last_vel = Vec3::Zero();
    const double h = 1e-3;
    for (double t = h; t < 10; t += h) {
      const Vec3 vel = (motion.pos_nm(t) - motion.pos_nm(t - h)) / h;
      ASSERT_LT(vel.norm(), 300.0) << task_name(task) << t;
      ASSERT_LT((vel - last_vel).norm() / h, 4000.0) << task_name(task) << t;
      last_vel = vel;
    }
  }
}

TEST(IntendedMotion, ReadsAScript) {
  std::istringstream csv("# a comment\nt_s,x_nm,y_nm,z_nm\n0,0,0,30\n\n 1.5 , 1, -2, 5e0\r\n3,1,-2,30\n");
  const auto motion = IntendedMotion::from_csv(csv, "a.csv");
  ASSERT_EQ(motion.waypoints().size(), 3u);
  EXPECT_EQ(motion.pos_nm(1.5), Vec3(1, -2, 5));
  EXPECT_EQ(motion.pos_nm(-1), Vec3(0, 0, 30));
  EXPECT_NEAR(motion.pos_nm(0.75).z(), 17.5, 1e-12);  // half way at half time
}

TEST(IntendedMotion, RefusesBadScriptsNamingFileAndLine) {
  const std::string header = "t_s,x_nm,y_nm,z_nm\n";
  const struct {
    std::string text, where;
  } cases[] = {
      {"", "bad.csv"},
      {header, "bad.csv"},
      {"t,x,y,z\n0,0,0,0\n", "bad.csv:1:"},
      {header + "0,0,0\n", "bad.csv:2:"},
      {header + "0,0,0,0,0\n", "bad.csv:2:"},
      {header + "0,0,0,1\n1,2,3,nan\n", "bad.csv:3:"},
      {header + "0,0,0,1\n1,2,inf,3\n", "bad.csv:3:"},
      {header + "0,0,0,1\n1,2,,3\n", "bad.csv:3:"},
      {header + "0,0,0,1\n0,0,0,2\n", "bad.csv:3:"},
      {header + "0,0,0,1e9\n", "bad.csv:2:"},
      {header + "-1,0,0,1\n", "bad.csv:2:"},
      {header + "0,0,0,0x10\n", "bad.csv:2:"},
      {header + "0,0,0,1 nm\n", "bad.csv:2:"},
      {std::string(2000, 'x') + "\n", "bad.csv:1:"},
  };
  for (const auto& bad : cases) {
    std::istringstream csv(bad.text);
    try {
      IntendedMotion::from_csv(csv, "bad.csv");
      ADD_FAILURE() << bad.text.substr(0, 60);
    } catch (const UserError& error) {
      const std::string what = error.what();
      EXPECT_EQ(what.rfind(bad.where, 0), 0u) << what;
      EXPECT_EQ(what.find('\n'), std::string::npos);
      EXPECT_NE(what.find(bad.text.size() > 1500 ? "longer" : "expected"), std::string::npos) << what;
    }
  }
  EXPECT_THROW(IntendedMotion::from_csv_file("no/such.csv"), UserError);
}

TEST(IntendedMotion, RefusesBadOptions) {
  TaskOptions options;
  options.duration_s = 0;
  EXPECT_THROW(IntendedMotion::for_task(Task::kContact, options), UserError);
  options = {};
  options.hover_high_nm = 5;  // below hover_low_nm
  EXPECT_THROW(IntendedMotion::for_task(Task::kPosition, options), UserError);
  options = {};
  options.depth_nm = NAN;
  EXPECT_THROW(IntendedMotion::for_task(Task::kIndent, options), UserError);
  EXPECT_THROW(IntendedMotion::for_task(Task::kScript, {}), UserError);
  EXPECT_THROW(parse_task("poke"), UserError);
  EXPECT_EQ(parse_task("indent"), Task::kIndent);
}

}  // namespace
}  // namespace telenano::device
