#include "tests/studies/stress/lead_watch.h"

#include <gtest/gtest.h>

namespace telenano::studies::stress {
namespace {

/// A hand that goes down by 0.1 mm a tick, and a station that is right: 1e-6 of it, 0.1 nm.
struct LedStation {
  LedStation() {
    now.engaged = true;
    now.lowest_w_nm = Vec3(-100, -100, -100);
    now.highest_w_nm = Vec3(100, 100, 100);
    now.tip_w_nm = now.held_w_nm = Vec3(7, 7, 7);
    now.begins_w_nm = Vec3(0, 0, 20);
    now.target_w_nm = now.begins_w_nm;
    tick();
  }
  void tick() {
    watch.look(now);
    now.time_s += 1e-3;
    now.acted = now.rescaled = false;
  }
  void go(int ticks, double led = 0.1) {
    for (int k = 0; k < ticks; ++k) {
      now.hand_h_m.z() -= 1e-4;
      now.target_w_nm.z() = std::clamp(now.target_w_nm.z() - led, -100.0, 100.0);
      tick();
    }
  }
  LeadWatch watch{LeadWatch::Limits{}};
  LeadWatch::Tick now;
};

TEST(LeadWatch, TheRightStationLeads) {
  LedStation b;
  b.go(50);
  // The clutch: the hand goes on, the target stays; the force fades.
  b.now.engaged = false;
  b.now.clutch = true;
  for (int k = 0; k < 200; ++k) {
    b.now.hand_h_m.z() += 2e-4;
    b.now.force_h_n.z() = std::max(0.0, 1 - k / 80.0);
    b.tick();
  }
  b.now.clutch = false;
  b.now.engaged = true;
  b.tick();
  b.go(10);
  // Another scale: from where the target stands.
  b.now.velocity_scale = 2e-7;
  b.now.rescaled = b.now.acted = true;
  b.go(10, 0.02);
  // A tip that has been put elsewhere, and a new session.
  b.now.tip_w_nm = b.now.target_w_nm = Vec3(1, 2, 3);
  b.tick();
  b.go(5, 0.02);
  ++b.now.sessions;
  b.now.target_w_nm = b.now.begins_w_nm = Vec3(0, 0, 33);
  b.tick();
  b.go(5, 0.02);
  EXPECT_TRUE(b.watch.leads());
  EXPECT_TRUE(b.watch.lets_go());
  EXPECT_TRUE(b.watch.is_smooth());
}

TEST(LeadWatch, WhatWentBeyondTheWorkspaceMustComeBack) {
  for (const bool right : {true, false}) {
    LedStation b;
    b.go(1210);  // 121 nm, of which 120 are there
    b.now.hand_h_m.z() += 5e-4;
    if (!right) b.now.target_w_nm.z() += 0.5;  // as if the workspace's end were an anchor
    b.tick();
    EXPECT_EQ(b.watch.leads(), right);
  }
}

// A soft sample's pull can hold the tip a little outside the workspace, and the target is put where the tip is.
TEST(LeadWatch, ATargetOutsideTheWorkspaceComesBackIntoItWhenEngaged) {
  for (const bool right : {true, false}) {
    LedStation b;
    b.go(100);
    b.now.engaged = false;
    b.now.tip_w_nm = b.now.target_w_nm = Vec3(0, 0, -100.5);
    b.tick();
    b.now.engaged = true;
    b.now.target_w_nm.z() = -100;
    b.tick();
    // It is led from where it was put, half a nanometre outside.
    b.now.hand_h_m.z() += 2e-3;
    b.now.target_w_nm.z() = right ? -98.5 : -96;
    b.tick();
    EXPECT_EQ(b.watch.leads(), right);
  }
}

TEST(LeadWatch, SeesAMotionThatIsNotTheHands) {
  LedStation far;
  far.go(3, 0.11);
  EXPECT_FALSE(far.watch.leads());
  LedStation by_itself;
  by_itself.now.engaged = false;
  by_itself.tick();
  by_itself.now.target_w_nm.z() -= 0.1;
  by_itself.tick();
  EXPECT_FALSE(by_itself.watch.leads());
  // Not anchored anew: what the hand did with the clutch is made up for at once.
  LedStation leaps;
  leaps.now.engaged = false;
  leaps.now.hand_h_m.z() -= 1e-2;
  leaps.tick();
  leaps.now.engaged = true;
  leaps.now.target_w_nm.z() -= 10;
  leaps.tick();
  EXPECT_FALSE(leaps.watch.leads());
  LedStation old_scale;
  old_scale.now.velocity_scale = 2e-7;
  old_scale.now.rescaled = true;
  old_scale.go(1, 0.1);
  EXPECT_FALSE(old_scale.watch.leads());
  LedStation elsewhere;
  ++elsewhere.now.sessions;
  elsewhere.now.target_w_nm.z() += 1;
  elsewhere.tick();
  EXPECT_FALSE(elsewhere.watch.leads());
}

TEST(LeadWatch, ATipThatWasUpIsNotDrivenBack) {
  for (const bool right : {true, false}) {
    LedStation b;
    b.go(100);
    b.now.engaged = false;
    b.now.retracted = true;
    b.now.tip_w_nm = b.now.held_w_nm = Vec3(0, 0, 60);
    b.tick();
    b.now.retracted = false;
    b.now.engaged = true;
    if (right) b.now.target_w_nm = b.now.tip_w_nm;
    b.tick();
    EXPECT_EQ(b.watch.leads(), right);
  }
}

TEST(LeadWatch, SeesAStationThatHoldsOn) {
  LedStation observer;
  observer.now.observes = true;
  observer.tick();
  EXPECT_FALSE(observer.watch.lets_go());
  LedStation engaged;
  engaged.now.clutch = true;
  engaged.tick();
  EXPECT_FALSE(engaged.watch.lets_go());
  LedStation pushes;
  pushes.now.engaged = false;
  pushes.now.clutch = true;
  pushes.now.force_h_n.z() = 0.1;
  for (int k = 0; k < 82; ++k) pushes.tick();
  EXPECT_TRUE(pushes.watch.lets_go());
  for (int k = 0; k < 3; ++k) pushes.tick();
  EXPECT_FALSE(pushes.watch.lets_go());
  LedStation stopped;
  stopped.now.engaged = false;
  stopped.now.stopped = true;
  stopped.now.force_h_n.z() = 1e-6;
  stopped.tick();
  EXPECT_FALSE(stopped.watch.lets_go());
}

// Another operator leads the shared tip aside: this hand, which goes down meanwhile, must not press it.
TEST(LeadWatch, SeesATipThatAHandMovesThatDoesNotHaveIt) {
  for (const bool right : {true, false}) {
    LedStation b;
    b.go(100);
    b.now.engaged = false;
    b.now.observes = b.now.another_has_tip = true;
    b.now.slave_z_w_nm = b.now.target_w_nm.z();
    for (int k = 0; k < 100; ++k) {
      b.now.hand_h_m.z() -= 1e-4;
      if (!right) b.now.slave_z_w_nm -= 0.1;
      b.tick();
    }
    EXPECT_EQ(b.watch.lets_go(), right);
    // What it does by its own clock is nobody's.
    b.now.withdraws = true;
    b.now.slave_z_w_nm += 50;
    b.tick();
    EXPECT_EQ(b.watch.lets_go(), right);
  }
}

TEST(LeadWatch, SeesAJumpOfTheForce) {
  for (const double jump_n : {0.04, 0.2}) {
    LedStation b;
    b.now.rendered_h_n.z() = 1;
    b.now.force_h_n.z() = 0.5;
    b.tick();
    b.tick();
    b.now.acted = true;
    b.now.force_h_n.z() += jump_n;
    b.tick();
    EXPECT_EQ(b.watch.is_smooth(), jump_n < 0.05) << jump_n;
  }
}

}  // namespace
}  // namespace telenano::studies::stress
