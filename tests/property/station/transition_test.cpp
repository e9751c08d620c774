// Every way from one mode of the station to another, each by every fault that can cause it, at random
// moments: the force never steps up, falls to zero at once where it must, and comes back by the ramp.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/random.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

using device::DeviceStatus;

constexpr double kTipForceNn = 300;  // 6 N at the hand
const double kNan = std::numeric_limits<double>::quiet_NaN();

/// What a hand, a device, a link do to a station, tick by tick.
class Rig : public StationRig {
 public:
  using StationRig::StationRig;
  bool replies = true;

  void run(int count) {
    for (int k = 0; k < count; ++k) run_one();
  }
  void run_one() {
    const Vec3 before = output.hand_force_h_n;
    const Mode from = station.mode();
    tick(replies);
    const Vec3 now = output.hand_force_h_n;
    modes.insert({from, station.mode()});
    ASSERT_TRUE(is_finite(now));
    const double rise_n = now.norm() - (now.dot(before) > 0 ? before.norm() : 0);
    worst_rise_n = std::max(worst_rise_n, rise_n);
    worst_fall_n = std::max(worst_fall_n, before.norm() - now.norm());
  }

  double worst_rise_n = 0;
  double worst_fall_n = 0;
  std::set<std::pair<Mode, Mode>> modes;  // transitions seen
};

struct Step {
  const char* name;
  Mode from;
  Mode to;
  bool at_once;  ///< force is zero in the very tick
  std::function<void(Rig&)> inject;
};

const std::vector<Step>& steps() {
  static const std::vector<Step> kSteps = {
      {"deadman released", Mode::kEngaged, Mode::kReady, false, [](Rig& r) { r.input.buttons = 0; }},
      {"clutch pressed", Mode::kEngaged, Mode::kReady, false,
       [](Rig& r) { r.input.buttons |= device::kButtonClutch; }},
      {"device's force off", Mode::kEngaged, Mode::kReady, true,
       [](Rig& r) { r.input.device_status = DeviceStatus::kForceOff; }},
      {"calibration lost", Mode::kEngaged, Mode::kHoming, true,
       [](Rig& r) {
         r.input.device_status = DeviceStatus::kHoming;
         r.input.hand_pos_h_m = Vec3(0.4, -0.3, 0.2);
       }},
      {"calibration lost, positions not finite", Mode::kEngaged, Mode::kHoming, true,
       [](Rig& r) {
         r.input.device_status = DeviceStatus::kHoming;
         r.input.hand_pos_h_m = Vec3(kNan, kNan, kNan);
       }},
      {"replies stop", Mode::kEngaged, Mode::kHeld, false, [](Rig& r) { r.replies = false; }},
      {"session lost", Mode::kEngaged, Mode::kHeld, false,
       [](Rig& r) {
         r.replies = false;
         r.input.session_up = false;
       }},
      {"stop pressed", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) { r.input.buttons |= device::kButtonStop; }},
      {"device failed", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) { r.input.device_status = DeviceStatus::kFailed; }},
      {"hand too fast", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) { r.input.hand_pos_h_m.y() += 0.01; }},
      {"hand leaps", Mode::kEngaged, Mode::kStopped, true, [](Rig& r) { r.input.hand_pos_h_m.y() += 5; }},
      {"hand not finite", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) { r.input.hand_pos_h_m.x() = kNan; }},
      {"applied force not finite", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) { r.input.applied_force_h_n.z() = kNan; }},
      {"applied force not believable", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) { r.input.applied_force_h_n.z() = 1000; }},
      {"replies not finite", Mode::kEngaged, Mode::kHeld, true,
       [](Rig& r) { r.reply.force_w_nn.z() = kNan; }},
      {"stiffer slave", Mode::kEngaged, Mode::kStopped, true,
       [](Rig& r) {
         link::Welcome stiff = r.welcome;
         stiff.coupling_stiffness_n_m = 1000;
         r.station.begin_session(stiff);
       }},
      {"stop pressed while held", Mode::kHeld, Mode::kStopped, true,
       [](Rig& r) { r.input.buttons |= device::kButtonStop; }},
      {"device failed while held", Mode::kHeld, Mode::kStopped, true,
       [](Rig& r) { r.input.device_status = DeviceStatus::kFailed; }},
      {"deadman released while held", Mode::kHeld, Mode::kReady, false, [](Rig& r) { r.input.buttons = 0; }},
      {"replies come again", Mode::kHeld, Mode::kEngaged, false, [](Rig& r) { r.replies = true; }},
      {"calibration lost while held", Mode::kHeld, Mode::kHoming, true,
       [](Rig& r) { r.input.device_status = DeviceStatus::kHoming; }},
      {"deadman held", Mode::kReady, Mode::kEngaged, false,
       [](Rig& r) { r.input.buttons = device::kButtonDeadman; }},
      {"stop pressed while ready", Mode::kReady, Mode::kStopped, true,
       [](Rig& r) { r.input.buttons |= device::kButtonStop; }},
      {"session lost while ready", Mode::kReady, Mode::kIdle, false,
       [](Rig& r) {
         r.replies = false;
         r.input.session_up = false;
       }},
      {"calibrated", Mode::kHoming, Mode::kReady, false,
       [](Rig& r) {
         r.input.device_status = DeviceStatus::kOk;
         r.input.buttons = 0;
         r.input.hand_pos_h_m = Vec3(-0.05, 0.05, 0.02);  // a leap that is no motion
       }},
      {"calibrated, deadman held", Mode::kHoming, Mode::kEngaged, false,
       [](Rig& r) {
         r.input.device_status = DeviceStatus::kOk;
         r.input.hand_pos_h_m = Vec3(-0.05, 0.05, 0.02);
       }},
      {"device failed while homing", Mode::kHoming, Mode::kStopped, true,
       [](Rig& r) { r.input.device_status = DeviceStatus::kFailed; }},
      {"stop pressed while homing", Mode::kHoming, Mode::kStopped, true,
       [](Rig& r) { r.input.buttons |= device::kButtonStop; }},
      {"session begins, not calibrated", Mode::kIdle, Mode::kHoming, true,
       [](Rig& r) {
         r.input.device_status = DeviceStatus::kHoming;
         r.input.session_up = true;
       }},
      {"session begins", Mode::kIdle, Mode::kReady, false,
       [](Rig& r) {
         r.input.buttons = 0;
         r.input.session_up = true;
       }},
      {"device failed while idle", Mode::kIdle, Mode::kStopped, true,
       [](Rig& r) { r.input.device_status = DeviceStatus::kFailed; }},
      {"a person clears the stop", Mode::kStopped, Mode::kReady, false,
       [](Rig& r) {
         r.input.buttons = 0;
         r.station.clear_stop();
       }},
  };
  return kSteps;
}

/// Brings a fresh station into a mode, `ticks` after the first one of being engaged where that is on the way.
void bring_to(Mode mode, Rig& rig, int ticks) {
  if (mode == Mode::kIdle) {
    rig.input.session_up = false;
    rig.replies = false;
    rig.run(5);
    return;
  }
  if (mode == Mode::kHoming) rig.input.device_status = DeviceStatus::kHoming;
  if (mode == Mode::kReady) rig.input.buttons = 0;
  rig.run(5 + ticks);
  if (mode == Mode::kHeld) {
    rig.replies = false;
    rig.run(150);
  }
  if (mode == Mode::kStopped) {
    rig.input.buttons |= device::kButtonStop;
    rig.run(5);
    rig.input.buttons = device::kButtonDeadman;
  }
}

TEST(Transitions, NoFaultStepsTheForceUpAndStopsActAtOnce) {
  Random random(42);
  const StationConfig config;
  const double force_n = config.scaling.hand_force_n(Vec3(0, 0, kTipForceNn)).norm();
  // The ramp is the only thing that brings force in: one tick of it, of the whole force; a ppm for rounding.
  const double allowed_n = force_n * StationRig::kPeriodS / config.engage_ramp_s * (1 + 1e-6);
  double worst_rise_n = 0;
  std::string worst_of;
  std::set<std::pair<Mode, Mode>> seen;
  for (const Step& step : steps()) {
    SCOPED_TRACE(step.name);
    double rise_n = 0;
    double fall_n = 0;
    for (int round = 0; round < 50; ++round) {
      Rig rig(config);
      rig.reply.force_w_nn = Vec3(0, 0, kTipForceNn);
      bring_to(step.from, rig, static_cast<int>(random.below(600)));
      ASSERT_EQ(rig.station.mode(), step.from);
      step.inject(rig);
      rig.run_one();
      if (step.at_once) {
        ASSERT_EQ(rig.output.hand_force_h_n, Vec3::Zero());
      }
      rig.run(200);
      ASSERT_EQ(rig.station.mode(), step.to) << mode_name(rig.station.mode());
      if (step.to != Mode::kEngaged) {
        ASSERT_EQ(rig.output.hand_force_h_n, Vec3::Zero());
      }
      // Back to work: what can be mended is, what is latched a person clears; then it engages again.
      rig.replies = true;
      rig.reply.force_w_nn = Vec3(0, 0, kTipForceNn);
      rig.input.session_up = true;
      rig.input.device_status = DeviceStatus::kOk;
      rig.input.hand_pos_h_m = rig.output.trace.hand_pos_h_m;
      if (!is_finite(rig.input.hand_pos_h_m)) rig.input.hand_pos_h_m.setZero();
      rig.input.applied_force_h_n = rig.output.hand_force_h_n;
      rig.input.buttons = device::kButtonDeadman;
      if (step.to == Mode::kStopped) {
        rig.run(5);
        ASSERT_EQ(rig.station.mode(), Mode::kStopped) << "a stop is latched";
        rig.station.clear_stop();
      }
      rig.run(300);
      ASSERT_EQ(rig.station.mode(), Mode::kEngaged);
      ASSERT_GT(rig.output.hand_force_h_n.norm(), 0.99 * force_n);
      rise_n = std::max(rise_n, rig.worst_rise_n);
      fall_n = std::max(fall_n, rig.worst_fall_n);
      seen.merge(rig.modes);
    }
    EXPECT_LE(rise_n, allowed_n);
    std::printf("%-8s -> %-8s %-40s up %.4f N, down %.4f N\n", mode_name(step.from), mode_name(step.to),
                step.name, rise_n, fall_n);
    if (rise_n > worst_rise_n) {
      worst_rise_n = rise_n;
      worst_of = step.name;
    }
  }
  std::printf("worst force step up over %zu transitions at a force of %.1f N: %.4f N (%s)\n", steps().size(),
              force_n, worst_rise_n, worst_of.c_str());
  // All ways between the modes that there are.
  for (const auto& [from, to] : std::vector<std::pair<Mode, Mode>>{{Mode::kIdle, Mode::kHoming},
                                                                   {Mode::kIdle, Mode::kReady},
                                                                   {Mode::kHoming, Mode::kEngaged},
                                                                   {Mode::kReady, Mode::kEngaged},
                                                                   {Mode::kEngaged, Mode::kReady},
                                                                   {Mode::kEngaged, Mode::kHeld},
                                                                   {Mode::kEngaged, Mode::kHoming},
                                                                   {Mode::kEngaged, Mode::kStopped},
                                                                   {Mode::kHeld, Mode::kEngaged},
                                                                   {Mode::kHeld, Mode::kReady},
                                                                   {Mode::kHeld, Mode::kStopped},
                                                                   {Mode::kHoming, Mode::kStopped}}) {
    EXPECT_TRUE(seen.contains({from, to})) << mode_name(from) << " -> " << mode_name(to) << " was never gone";
  }
}

TEST(Transitions, HomingAccountsNothingAndAnchorsAnew) {
  Rig rig;
  rig.engage(Vec3(0, 0, kTipForceNn));
  const double energy_j = rig.output.trace.energy_j;
  const Vec3 tip_w_nm = rig.output.trace.tip_target_pos_w_nm;
  rig.input.device_status = DeviceStatus::kHoming;
  Random random(1);
  for (int k = 0; k < 200; ++k) {
    rig.input.hand_pos_h_m = Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    rig.run_one();
    EXPECT_EQ(rig.output.hand_force_h_n, Vec3::Zero());
  }
  rig.input.device_status = DeviceStatus::kOk;
  rig.input.hand_pos_h_m = Vec3(0.03, 0.02, 0.01);
  rig.input.applied_force_h_n = Vec3(0, 0, 1);  // even if the device says that it showed a force: over no way
  rig.run(300);
  EXPECT_EQ(rig.station.latched_faults(), 0u);
  EXPECT_EQ(rig.output.trace.energy_j, energy_j);
  EXPECT_EQ(rig.output.trace.tip_target_pos_w_nm, tip_w_nm) << "the tip does not follow a leap of the origin";
  // And from there on positions count again: down by 1 mm against an upward force puts energy in.
  rig.input.hand_pos_h_m.z() -= 1e-4;
  rig.run_one();
  EXPECT_NEAR(rig.output.trace.energy_j - energy_j, 1e-4 * 6, 1e-6);
}

// The slave withdraws its tip and brings it back: meanwhile there is no force, and what the hand does moves
// nothing; then hand and tip are anchored where they are.
TEST(Transitions, ATipThatIsUpIsWaitedForAndTakenUpWhereItComesBack) {
  for (const bool shared : {false, true}) {
    SCOPED_TRACE(shared);
    Rig rig;
    if (shared) {
      rig.welcome.feature_bits |= link::kFeatureSharing;
      rig.station.begin_session(rig.welcome);
      rig.reply.tip.hold = 1;
    }
    const auto tip_at = [&](const Vec3& pos_w_nm) {
      rig.reply.tip_pos_w_nm = rig.reply.tip.pos_w_nm = pos_w_nm;
    };
    tip_at(Vec3(100, 200, 40));
    rig.engage(Vec3(0, 0, kTipForceNn));
    ASSERT_EQ(rig.station.mode(), Mode::kEngaged);
    ASSERT_GT(rig.force_n(), 3);

    tip_at(Vec3(100, 200, 500));
    rig.reply.fault_bits = link::kFaultRetracted;
    rig.reply.force_w_nn.setZero();
    rig.worst_rise_n = 0;
    for (int k = 0; k < 400; ++k) {
      rig.input.hand_pos_h_m.z() -= 2e-5;  // the hand goes on pressing: 8 mm in all
      rig.run_one();
      ASSERT_EQ(rig.station.mode(), Mode::kReady);
      ASSERT_EQ(rig.output.trace.tip_target_pos_w_nm, Vec3(100, 200, 500));
      // The slave of a shared tip is told that the operator waits; a private one must not be led.
      ASSERT_EQ((rig.output.command.flags & link::kFlagClutch) != 0, shared);
    }
    EXPECT_EQ(rig.force_n(), 0);
    EXPECT_LE(rig.worst_rise_n, 0);

    tip_at(Vec3(90, 190, 25));
    rig.reply.fault_bits = 0;
    rig.reply.force_w_nn = Vec3(0, 0, kTipForceNn);
    rig.run_one();
    EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
    EXPECT_EQ(rig.output.trace.tip_target_pos_w_nm, Vec3(90, 190, 25));
    // 6 N come in by the ramp of a quarter of a second: 0.024 N in a tick.
    rig.run(400);
    EXPECT_LE(rig.worst_rise_n, 1.01 * 6.0 * StationRig::kPeriodS / rig.station.config().engage_ramp_s);
    EXPECT_EQ(rig.output.trace.tip_target_pos_w_nm, Vec3(90, 190, 25)) << "the hand has not moved since";
  }
}

}  // namespace
}  // namespace telenano::station
