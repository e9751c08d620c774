// A scaling that is planned for the twin alone, without any delay, on a measured lower bound of the device's
// damping: what is felt, what becomes of it when there is no twin any more, and what a hand can take meanwhile.
// Whole sessions in virtual time. The oracles are the hand's own account and the planner asked for another method.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/control/scaling_plan.h"
#include "telenano/master/twin/scene_twin.h"
#include "tests/property/twin/felt_run.h"
#include "tests/support/driven_hand.h"

namespace telenano::support {
namespace {

using control::Method;
using station::TwinState;

constexpr double kBoundNsM = 0.1;  ///< of the damping, as measured
constexpr double kAllowanceJ = 0.010;

control::ScalingPlan plan(const std::shared_ptr<const scene::Scene>& scene, Method method, double latency_s) {
  const slave::SlaveLimits limits = slave::NveSlave(scene).limits();
  control::ScalingPlanInput in;
  in.method = method;
  in.plant.device_damping_n_s_m = kBoundNsM;
  in.plant.coupling_stiffness_n_m = limits.coupling_stiffness_n_m;
  in.plant.coupling_damping_n_s_m = limits.coupling_damping_n_s_m;
  in.plant.delay_samples = 100;
  in.tip_force_max_nn = limits.force_max_nn;
  in.velocity_scale = 1e-6;
  in.device_latency_s = latency_s;
  return control::plan_scaling(in);
}

/// As `run` plans it.
void use_plan(VirtualSessionConfig& config) {
  const control::ScalingPlan twin = plan(config.scene, Method::kTwin, 0);
  const control::ScalingPlan any = plan(config.scene, Method::kModel, 0);
  ASSERT_EQ(twin.binding, control::BindingLimit::kPassivity);
  ASSERT_GT(twin.scaling.force, 1.5 * any.scaling.force);
  config.station.scaling = twin.scaling;
  config.station.impedance_without_twin = any.scaling.impedance();
  config.station.device_damping_n_s_m = kBoundNsM;
  config.station.device_latency_s = 0;
  config.station.allowance_j = kAllowanceJ;
  config.plant.device_damping_n_s_m = kBoundNsM;
  config.plant.coulomb_friction_n = 0;  // it would hide what swings
}

VirtualSessionConfig pressing_into(const std::string& name, double rtt_ms) {
  VirtualSessionConfig config;
  config.scene = deployed(name);
  config.station.method = Method::kTwin;
  config.twin = true;
  config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e6 * rtt_ms);
  const double z0 = config.scene->start_apex_w_nm.z() - config.scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {{0, {0, 0, z0}}, {0.8, {0, 0, -5}}, {20, {30, 0, -5}}};
  use_plan(config);
  return config;
}

// With a damping that is no more than the bound: the touch is calm, and what is felt is the sample.
TEST(NoDelay, WhatIsPlannedOnTheBoundIsCalmAndTrue) {
  for (const char* const name : {"flat_silicon_oxide", "flakes", "humid_flakes"}) {
    for (const double rtt_ms : {0.0, 200.0}) {
      const Outcome out = run(name, {rtt_ms}, 1.5, use_plan);
      EXPECT_LT(out.nrmse, 1e-10) << name << ", " << rtt_ms;
      EXPECT_GT(out.compared, 2000u) << name;
      EXPECT_EQ(out.unequal_hashes, 0u) << name;
      VirtualSession session(pressing_into(name, rtt_ms));
      double low_m = 1, high_m = -1, least_n = 1e9, most_n = 0;
      for (int tick = 0; tick < 4000; ++tick) {
        session.step();
        if (tick < 2500) continue;
        const station::StationTrace& t = session.loop().trace();
        EXPECT_EQ(t.mode, station::Mode::kEngaged);
        low_m = std::min(low_m, t.hand_pos_h_m.z());
        high_m = std::max(high_m, t.hand_pos_h_m.z());
        least_n = std::min(least_n, t.commanded_force_h_n.norm());
        most_n = std::max(most_n, t.commanded_force_h_n.norm());
      }
      EXPECT_GT(least_n, 0.02) << name << ": nothing is felt";
      EXPECT_LT(high_m - low_m, 1e-3) << name << ": the hand swings";
      std::printf("%s, %.0f ms: force %.3g to %.3g N, hand within %.3g mm over 1.5 s\n", name, rtt_ms,
                  least_n, most_n, 1e3 * (high_m - low_m));
    }
  }
}

/// What happens between the twin's end and the new engagement.
struct WayBack {
  int fades = 0;        ///< ticks
  double steepest = 0;  ///< rise of the force while it fades, N a tick; and fall
  double fall = 0;
  bool stiff_without_twin = false;  ///< another method's force was shown at the twin's scale
};

/// Steps until the hand has engaged anew, or for 3 s.
WayBack follow(VirtualSession& session, int ticks = 3000) {
  WayBack out;
  double last_n = session.loop().trace().commanded_force_h_n.norm();
  for (int i = 0; i < ticks; ++i) {
    session.step();
    const station::StationTrace& t = session.loop().trace();
    const station::StationConfig& config = session.station().config();
    const double now_n = t.commanded_force_h_n.norm();
    const bool fades = (t.faults & station::kFaultTwinLeft) != 0;
    const bool by_twin = t.method == Method::kTwin && session.station().twin()->on();
    if (fades) {
      ++out.fades;
      out.steepest = std::max(out.steepest, now_n - last_n);
      out.fall = std::max(out.fall, last_n - now_n);
    }
    if (!by_twin && !fades && now_n > 0 &&
        config.scaling.impedance() > config.impedance_without_twin * (1 + 1e-9))
      out.stiff_without_twin = true;
    last_n = now_n;
  }
  return out;
}

void expect_way_back(VirtualSession& session, const WayBack& back, const std::string& what) {
  const station::StationConfig& config = session.station().config();
  EXPECT_GT(back.fades, 1) << what;
  EXPECT_LE(back.steepest, 1e-12) << what << ": the force only fades";
  EXPECT_LE(back.fall, 1e-3 * control::Twin::kGoOver_n_s * (1 + 1e-9)) << what;
  EXPECT_FALSE(back.stiff_without_twin) << what;
  EXPECT_NEAR(config.scaling.impedance(), config.impedance_without_twin, 1e-9 * config.impedance_without_twin)
      << what;
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged) << what << ": it engages anew";
  EXPECT_GT(session.loop().trace().commanded_force_h_n.norm(), 0.02) << what << ": and something is felt";
}

TEST(NoDelay, WhenTheTwinEndsTheForceFadesAndAnotherScaleTakesItsPlace) {
  const std::vector<std::pair<const char*, std::function<void(VirtualSession&)>>> ends = {
      {"the operator chooses model", [](VirtualSession& s) { s.station().change_method(Method::kModel); }},
      {"the operator chooses tank", [](VirtualSession& s) { s.station().change_method(Method::kTank); }},
      {"and comes back at once", [](VirtualSession& s) {
         s.station().change_method(Method::kModel);
         s.step();
         s.station().change_method(Method::kTwin);
       }}};
  for (const char* const name : {"flat_silicon_oxide", "flakes"}) {
    for (const double rtt_ms : {0.0, 100.0}) {
      for (const auto& [what, end] : ends) {
        VirtualSession session(pressing_into(name, rtt_ms));
        for (int i = 0; i < 2000; ++i) session.step();
        ASSERT_EQ(session.loop().trace().mode, station::Mode::kEngaged);
        ASSERT_GT(session.loop().trace().commanded_force_h_n.norm(), 0.02);
        end(session);
        expect_way_back(session, follow(session), std::string(name) + ", " + what);
      }
    }
  }
}

// A server whose state's hash is wrong: three partings, then no twin.
TEST(NoDelay, AServerThatLiesEndsInTheSameWay) {
  for (const double rtt_ms : {0.0, 100.0}) {
    VirtualSessionConfig config = pressing_into("flakes", rtt_ms);
    const auto acts = std::make_shared<bool>(false);
    const auto codec = std::make_shared<link::Codec>();
    config.lie = [=, in = std::make_shared<link::Incoming>(), n = 0](std::span<std::uint8_t> out,
                                                                     std::size_t size) mutable {
      if (!*acts || codec->decode(out.first(size), *in) != link::DropCause::kNone) return size;
      if (in->type != link::MessageType::kReply) return size;
      if (++n % 100 == 0) in->reply.steps.state_hash ^= 1;
      return codec->encode(in->reply, out);
    };
    VirtualSession session(config);
    for (int i = 0; i < 2000; ++i) session.step();
    ASSERT_GT(session.loop().trace().commanded_force_h_n.norm(), 0.02);
    *acts = true;
    const WayBack back = follow(session, 8000);
    EXPECT_EQ(session.station().twin()->state(), TwinState::kGivenUp);
    EXPECT_EQ(session.station().method(), Method::kModel);
    expect_way_back(session, back, "lies, " + std::to_string(rtt_ms));
  }
}

// A restart, an outage and a resumed session leave the twin what it is: nothing fades to another scale.
TEST(NoDelay, WhatDoesNotEndTheTwinKeepsTheScale) {
  for (const bool restarts : {true, false}) {
    VirtualSession session(pressing_into("flakes", 40));
    for (int i = 0; i < 2000; ++i) session.step();
    const double planned = session.station().config().scaling.force;
    if (restarts) session.restart_server();
    session.link().path_a_to_b().down = true;
    EXPECT_EQ(follow(session, 900).fades, 0);
    session.link().path_a_to_b().down = false;
    EXPECT_EQ(follow(session, 4000).fades, 0);
    EXPECT_EQ(session.station().method(), Method::kTwin);
    EXPECT_EQ(session.station().config().scaling.force, planned);
    EXPECT_GT(session.station().twin()->confirmed(), 1000u);
  }
}

TEST(NoDelay, WhatIsTheTwinsAloneCanBeSetOnlyWhileItIsFelt) {
  VirtualSession session(pressing_into("flakes", 20));
  for (int i = 0; i < 1500; ++i) session.step();
  const control::Scaling planned = session.station().config().scaling;
  EXPECT_TRUE(session.station().change_scaling({planned.velocity, 0.9 * planned.force}));
  EXPECT_TRUE(session.station().change_scaling(planned));
  EXPECT_FALSE(session.station().change_scaling({planned.velocity, 1.1 * planned.force}));
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged);
  session.station().change_method(Method::kModel);
  EXPECT_FALSE(session.station().change_scaling(planned));
  follow(session);
  EXPECT_FALSE(session.station().change_scaling(planned));
  session.station().change_method(Method::kTwin);
  for (int i = 0; i < 100; ++i) session.step();
  EXPECT_EQ(session.station().method(), Method::kTwin);
  const station::StationConfig& now = session.station().config();
  EXPECT_NEAR(now.scaling.impedance(), now.impedance_without_twin, 1e-9 * now.impedance_without_twin)
      << "a twin that comes back does not make the touch stiffer under the hand";
}

// What may come while the force fades: the hand lets go, a stop, the link is lost, a person chooses a lower scale or the
// twin again, the server is another one. The force is never more than what the fade alone would leave.
TEST(NoDelay, WhateverComesWhileItFadesTakesForceAwayOnly) {
  const std::vector<std::pair<const char*, std::function<void(VirtualSession&)>>> enemies = {
      {"nothing", [](VirtualSession&) {}},
      {"clutch", [](VirtualSession& s) { s.loop().set_buttons(device::kButtonClutch); }},
      {"stop", [](VirtualSession& s) { s.loop().set_buttons(device::kButtonStop); }},
      {"link lost", [](VirtualSession& s) { s.link().path_b_to_a().down = true; }},
      {"server killed", [](VirtualSession& s) { s.kill_server(); }},
      {"server restarted", [](VirtualSession& s) { s.restart_server(); }},
      {"other method",
       [](VirtualSession& s) {
         s.station().change_method(Method::kTank);
         s.station().change_method(Method::kTwin);
       }},
      {"lower scale",
       [](VirtualSession& s) {
         const control::Scaling now = s.station().config().scaling;
         EXPECT_TRUE(s.station().change_scaling({now.velocity, 0.1 * now.force}));
       }},
      {"higher scale", [](VirtualSession& s) {
         const control::Scaling now = s.station().config().scaling;
         EXPECT_FALSE(s.station().change_scaling(now));
       }}};
  for (const auto& [what, enemy] : enemies) {
    SCOPED_TRACE(what);
    VirtualSessionConfig config = pressing_into("flat_silicon_oxide", 20);
    config.script = {{0, {0, 0, 20}}, {0.8, {0, 0, -12}}, {20, {0, 0, -12}}};
    VirtualSession session(config);
    for (int i = 0; i < 2000; ++i) session.step();
    double allowed_n = session.loop().trace().commanded_force_h_n.norm();
    ASSERT_GT(allowed_n, 0.8);
    session.station().change_method(Method::kModel);
    for (int i = 0; i < 10; ++i) session.step();
    enemy(session);
    allowed_n -= 10 * 1e-3 * control::Twin::kGoOver_n_s * (1 - 1e-9);
    double at_scale = session.station().config().impedance_without_twin;
    int ticks = 0;
    for (; ticks < 100; ++ticks) {
      session.step();
      const station::StationTrace& t = session.loop().trace();
      if ((t.faults & station::kFaultTwinLeft) == 0) break;
      allowed_n = std::max(0.0, allowed_n - 1e-3 * control::Twin::kGoOver_n_s * (1 - 1e-9));
      EXPECT_LE(t.commanded_force_h_n.norm(), allowed_n + 1e-12) << ticks;
      EXPECT_NE(t.mode, station::Mode::kEngaged);
    }
    EXPECT_LT(ticks, 100) << "it ends";
    EXPECT_LE(session.station().config().scaling.impedance(), at_scale * (1 + 1e-9));
    if (std::string(what) == "lower scale") {
      EXPECT_LT(session.station().config().scaling.impedance(), 0.5 * at_scale)
          << "a person's choice is kept";
    }
    session.loop().set_buttons(0);
    for (int i = 0; i < 500; ++i) {
      session.step();
      EXPECT_LE(session.station().config().scaling.impedance(), at_scale * (1 + 1e-9));
    }
  }
}

struct Extracted {
  double most_j = 0;
  double most_more_j = 0;  ///< what a device with the stated damping would have taken up besides
  double well_j = 0;
  int ended = 0;
  std::int64_t by_twin = 0;
};

/// A hand that presses and withdraws, and shivers at the device's own rate while it presses, with a device of
/// this damping. `ends`: in the middle of it a person chooses another method.
Extracted extracted(const std::string& name, double true_damping_n_s_m, double rtt_ms, bool ends,
                    double shiver_m) {
  VirtualSessionConfig config;
  config.scene = deployed(name);
  use_plan(config);
  config.station.method = Method::kTwin;
  config.twin = true;
  config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e6 * rtt_ms);
  AccountedHandConfig device;
  device.device_damping_n_s_m = true_damping_n_s_m;
  double moved2 = 0, last_m = 0;
  const auto hand = std::make_shared<DrivenHand>(device, [&](const DrivenHand::View& view) {
    const double phase = static_cast<double>(view.tick % 1200) / 1200;
    const double z_m = phase < 0.5 ? -0.024 * phase / 0.5 : -0.024 * (1 - phase) / 0.5;
    const double to_m = z_m + (view.tick % 2 == 0 ? shiver_m : -shiver_m);
    moved2 += (to_m - last_m) * (to_m - last_m);
    last_m = to_m;
    return to_m;
  });
  config.hand = hand;
  VirtualSession session(config);
  Extracted out;
  for (int tick = 0; tick < 6000; ++tick) {
    if (ends && tick == 3100) session.station().change_method(Method::kModel);
    session.step();
    const station::StationTrace& t = session.loop().trace();
    out.by_twin += t.method == Method::kTwin && t.mode == station::Mode::kEngaged;
    out.ended += (t.faults & station::kFaultTwinLeft) != 0;
  }
  out.most_j = hand->account().most_extracted_j();
  out.most_more_j = std::max(0.0, kBoundNsM - true_damping_n_s_m) * moved2 / 1e-3;
  out.well_j = config.station.scaling.hand_energy_j(twin::SceneTwin(config.scene).well_aj());
  EXPECT_FALSE(hand->too_fast());
  EXPECT_GT(out.by_twin, 2500) << name;
  return out;
}

// The promise: E₀ and the well, with a device at the bound. Below it, what the device then does not take up of the
// hand's motion, and no more.
TEST(NoDelay, NoHandTakesMoreThanPromisedAtTheBoundNorMoreThanTheMissingDampingBelowIt) {
  double most_of_it = 0;
  for (const char* const name : {"flat_silicon_oxide", "flat_pdms", "flakes"}) {
    for (const double rtt_ms : {0.0, 100.0}) {
      for (const bool ends : {false, true}) {
        for (const double shiver_m : {0.0, 2e-5, 1e-4}) {
          const Extracted at = extracted(name, kBoundNsM, rtt_ms, ends, shiver_m);
          EXPECT_LE(at.most_j, kAllowanceJ + at.well_j + 1e-12) << name << ", " << rtt_ms << ", " << shiver_m;
          EXPECT_EQ(at.ended > 0, ends) << name;
          most_of_it = std::max(most_of_it, at.most_j / (kAllowanceJ + at.well_j));
          const Extracted below = extracted(name, 0.5 * kBoundNsM, rtt_ms, ends, shiver_m);
          EXPECT_LE(below.most_j, kAllowanceJ + below.well_j + below.most_more_j + 1e-12) << name;
        }
      }
    }
  }
  std::printf("at the bound at most %.3g of what is promised\n", most_of_it);
}

}  // namespace
}  // namespace telenano::support
