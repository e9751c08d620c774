#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/control/method.h"
#include "telenano/master/station/station_config.h"
#include "tests/source_dir.h"
#include "tests/studies/methods/adversary.h"
#include "tests/studies/methods/shown_stiffness.h"
#include "tests/studies/zwidth/on_all_cores.h"
#include "tests/support/driven_hand.h"
#include "tests/support/mass_spring_hand.h"
#include "tests/support/plant_oracle.h"
#include "tests/support/virtual_session.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies {
namespace {

using control::Method;

// The measuring instruments first: nothing that they say of a method is worth more than they are.

// A sampled spring K that is moved by x = A sin ωt gives away ½KΔx² a step: over N steps and whole periods
// ½KA²·N(1 − cos ωT), here 39.5 mJ; with the force of the other end of the interval it would seem to take as
// much.
TEST(PortAccount, ASampledSpringGivesAwayWhatTheClosedFormSays) {
  constexpr double kK = 1000, kA = 0.010, kHz = 2, kT = 1e-3;
  constexpr int kSteps = 10'000;
  support::PortAccount right(0, kT), wrong(0, kT);
  const auto at = [&](int k) { return kA * std::sin(2 * M_PI * kHz * kT * k); };
  for (int k = 1; k <= kSteps; ++k) {
    right.add(-kK * at(k - 1), at(k) - at(k - 1));
    wrong.add(-kK * at(k), at(k) - at(k - 1));
  }
  const double expected_j = 0.5 * kK * kA * kA * kSteps * (1 - std::cos(2 * M_PI * kHz * kT));
  EXPECT_NEAR(expected_j, 39.5e-3, 0.05e-3);
  // 1e4 terms of up to 1e-5 J, each rounded in double before it is summed: 1e4·1e-5·1e-16.
  EXPECT_NEAR(right.given_j(), expected_j, 1e-11);
  EXPECT_NEAR(wrong.given_j(), -expected_j, 1e-11);
}

TEST(PortAccount, TheDevicesCertainLossIsNotBlamedOnThePort) {
  constexpr double kB = 2, kT = 1e-3, kV = 0.1;
  support::PortAccount account(kB, kT);
  for (int k = 0; k < 1000; ++k)
    account.add(kB * kV, kV * kT);                      // pushed at constant speed against its damping
  EXPECT_NEAR(account.given_j(), kB * kV * kV, 1e-15);  // 1 s
  EXPECT_NEAR(account.most_extracted_j(), 0, 1e-15);
  for (int k = 0; k < 1000; ++k) account.add(-kB * kV, -kV * kT);
  EXPECT_NEAR(account.most_extracted_j(), 0, 1e-15);
}

// At its port the position is held and the force varies: the work of a step is the integral of the force over
// it, here by Simpson's rule on pieces that end at the surface, where the integrand is a line.
TEST(WallSlave, ItsAccountIsTheIntegralOfItsForce) {
  support::WallSlaveConfig config;
  config.stiffness_n_m = 30;
  config.force_max_nn = 1e9;
  support::WallSlave wall(config);
  Random random(7);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  const auto force_nn = [&](double z) { return z < 0 ? -30 * z : 0.0; };
  double z = config.start_height_nm, work_aj = 0, in = 0, out = 0;
  for (int k = 0; k < 5000; ++k) {
    const double next = random.uniform(-8, 6);
    input.tip_target_pos_w_nm = Vec3(random.uniform(-5, 5), 0, next);
    wall.step(input, 1e-3, output);
    const auto simpson = [&](double a, double b) {
      return -(b - a) / 6 * (force_nn(a) + 4 * force_nn(0.5 * (a + b)) + force_nn(b));
    };
    work_aj += z * next < 0 ? simpson(z, 0) + simpson(0, next) : simpson(z, next);
    z = next;
    ASSERT_DOUBLE_EQ(output.force_w_nn.z(), force_nn(next));
    ASSERT_GE(output.energy_in_aj, in);
    ASSERT_GE(output.energy_out_aj, out);
    in = output.energy_in_aj;
    out = output.energy_out_aj;
    // 5000 terms of up to 1000 aJ: rounding of some 1e-16·5000·1000 at the worst.
    ASSERT_NEAR(in - out, work_aj, 1e-9);
    ASSERT_NEAR(in - out, 0.5 * 30 * std::pow(std::min(0.0, next), 2), 1e-9) << "what is stored, no less";
  }
}

TEST(WallSlave, HoldsRetractsAndKeepsItsOwnForceLimit) {
  support::WallSlaveConfig config;
  config.force_max_nn = 100;
  const auto watch = std::make_shared<support::WallWatch>();
  support::WallSlave wall(config, watch);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  input.tip_target_pos_w_nm.z() = -40;
  wall.step(input, 1e-3, output);
  EXPECT_DOUBLE_EQ(output.force_w_nn.z(), 100);
  EXPECT_DOUBLE_EQ(output.commanded_pos_w_nm.z(), -2);
  EXPECT_TRUE(output.fault_bits & link::kFaultForceLimit);
  input.follow = false;
  input.tip_target_pos_w_nm.z() = 3;
  wall.step(input, 1e-3, output);
  EXPECT_DOUBLE_EQ(output.commanded_pos_w_nm.z(), -2);
  input.retract = true;
  for (int k = 0; k < 1000; ++k) wall.step(input, 1e-3, output);
  EXPECT_TRUE(output.fault_bits & link::kFaultRetracted);
  EXPECT_DOUBLE_EQ(output.commanded_pos_w_nm.z(), config.workspace_max_w_nm.z());
  EXPECT_DOUBLE_EQ(output.energy_in_aj, output.energy_out_aj);
  EXPECT_DOUBLE_EQ(watch->most_force_nn, 100);
}

// Against the power series of the plant's oracle, which shares no method with the matrix exponential. The
// oracle moves the arm's footing on a line, the hand in steps: both stand still here.
TEST(MassSpringHand, FollowsTheOracleAndConservesEnergy) {
  for (const double hz : {4.0, 80.0, 450.0}) {
    support::MassSpringConfig config;
    config.arm_mass_kg = 1;
    config.grip_stiffness_n_m = support::MassSpringConfig::grip_for_hz(hz, config.port.device_mass_kg, 1);
    config.goal_m = 0;
    support::MassSpringHand hand(config);
    support::PlantOracleConfig oracle_config;
    oracle_config.device_damping_n_s_m = config.port.device_damping_n_s_m;
    oracle_config.arm_mass_kg = 1;
    oracle_config.arm_stiffness_n_m = config.arm_stiffness_n_m;
    oracle_config.arm_damping_n_s_m = 0;
    oracle_config.grip_stiffness_n_m = config.grip_stiffness_n_m;
    oracle_config.grip_damping_n_s_m = 0;
    support::PlantOracle oracle(oracle_config);
    oracle.reset(0);
    hand.start_motion();
    Random random(3);
    for (int k = 0; k < 300; ++k) {
      const double force_n = random.uniform(-3, 3);
      hand.write_force(Vec3(0, 0, force_n));
      hand.advance(1'000'000);
      oracle.advance(force_n, 0, 1e-3L);
      // Both in long double; the exponential is good to some 1e-17 a step, which 300 undamped steps add up.
      ASSERT_NEAR(hand.pos_m(), static_cast<double>(oracle.pos_m()), 1e-14) << hz << ' ' << k;
    }
    // What the port gave is stored or was lost in the device, by the oracle's own integrals; and what the
    // account calls certain is no more than that.
    const auto loss_j = static_cast<double>(oracle.device_loss_j);
    EXPECT_NEAR(hand.account().given_j(), static_cast<double>(hand.stored_j()) + loss_j, 1e-13) << hz;
    EXPECT_GT(hand.account().given_j(), 1e-4) << "something happened";
    EXPECT_LE(hand.account().certain_loss_j(), loss_j * (1 + 1e-12)) << hz;
    EXPECT_GT(hand.account().certain_loss_j(), 0.2 * loss_j) << "and not much less";
  }
}

TEST(DrivenHand, IsNeverTooFastAndGoesWhereItIsSent) {
  support::AccountedHandConfig config;
  support::DrivenHand hand(config, [](const auto& view) { return view.tick < 100 ? 1.0 : 0.001; });
  hand.advance(1'000'000);
  EXPECT_EQ(hand.pos_m(), 0) << "it has not been started";
  hand.start_motion();
  for (int k = 0; k < 100; ++k) hand.advance(1'000'000);
  EXPECT_NEAR(hand.pos_m(), 0.05, 1e-9);
  for (int k = 0; k < 200; ++k) hand.advance(1'000'000);
  EXPECT_DOUBLE_EQ(hand.pos_m(), 0.001);
  EXPECT_FALSE(hand.too_fast());
}

TEST(OnAllCores, DoesEachOnceAndSaysWhatWentWrong) {
  std::vector<std::atomic<int>> done(1000);
  on_all_cores(done.size(), [&](std::size_t i) { ++done[i]; });
  for (const auto& count : done) ASSERT_EQ(count, 1);
  EXPECT_THROW(on_all_cores(100,
                            [](std::size_t i) {
                              if (i % 7 == 3) throw RunError("broken");
                            }),
               RunError);
}

// What is shown of a wall.

TEST(ShownStiffness, WithoutDelayTheHandRestsWhereTheSpringsSay) {
  for (const Method method : control::kAllMethods) {
    // Wave variables show a spring of their own even then, and a reactive two-port may yield.
    if (method == Method::kWave || method == Method::kTdpa) continue;
    PressConfig config;
    config.method = method;
    const PressResult result = run_press(config);
    const RestOnWall rest = rest_on_wall(config);
    for (const Press& press : result.presses) {
      // The encoder's step (10 µm) and what dry friction (0.02 N) holds against hand and wall in parallel.
      const double stuck_m = 0.02 / (config.wall_n_m + 353) + 1e-5;
      EXPECT_NEAR(1e-3 * press.depth_mm, rest.depth_m, stuck_m) << control::method_name(method);
      // Half a step of 10 µm in 2.6 mm is 0.2 %.
      EXPECT_NEAR(press.stiffness_n_m, config.wall_n_m, 0.004 * config.wall_n_m)
          << control::method_name(method);
      EXPECT_LT(std::fabs(press.drift_mm), 0.02);
    }
    EXPECT_LT(result.stopped_at_s, 0) << control::method_name(method);
  }
}

TEST(ShownStiffness, TheAccountOfThePressesIsWhatTheClampPromises) {
  for (const double rtt_s : {0.0, 0.05, 0.5}) {
    PressConfig config;
    config.rtt_s = rtt_s;
    for (const Method method : control::kAllMethods) {
      if (!control::claims_energy_bound(method)) continue;
      config.method = method;
      const PressResult result = run_press(config);
      // Q of the encoder: 5 µm·(Σ|Δf| + 2 max|f|), of some newtons' turns each press: well below 2 mJ.
      EXPECT_LE(result.extracted_mj, 20 + 2) << control::method_name(method) << ' ' << rtt_s;
    }
  }
}

// A server that died and came again is the same wall at the same place, and it feels the same.
TEST(ShownStiffness, AfterARestartTheWallIsThereAgain) {
  for (const Method method : control::kAllMethods) {
    // A tank whose slave is granted its energy once has nothing to press with after a restart: not held to
    // this.
    if (method == Method::kTank) continue;
    PressConfig config;
    config.method = method;
    config.rtt_s = 0.01;
    const PressResult plain = run_press(config);
    config.restarts = true;
    const PressResult result = run_press(config);
    EXPECT_EQ(result.sessions, 1u + kPresses) << control::method_name(method);
    // Of a new slave nothing is known yet: each press is a first one.
    for (const Press& press : result.presses) {
      // The hand comes to rest up to 2·0.02 N/353 N/m from where it began, and the encoder adds 0.01 mm; of a
      // depth of 2.6 mm that is 5 %.
      EXPECT_NEAR(press.stiffness_n_m, plain.first().stiffness_n_m, 0.05 * plain.first().stiffness_n_m)
          << control::method_name(method);
      EXPECT_LT(press.swing_mm, 0.2) << control::method_name(method);
    }
    EXPECT_LT(result.stopped_at_s, 0) << control::method_name(method);
  }
}

// The table that the local model was chosen for: what a prototype showed at each round trip.
TEST(ShownStiffness, TheDefaultBeatsThePrototypeIfItIsTheLocalModel) {
  const Method method = station::StationConfig{}.method;
  if (method != Method::kModel) GTEST_SKIP() << "the default is " << control::method_name(method);
  const std::pair<double, double> cells[] = {{10, 949}, {20, 911}, {50, 832}, {100, 761}, {200, 699}};
  for (const auto& [rtt_ms, prototype_n_m] : cells) {
    PressConfig config;
    config.method = method;
    config.rtt_s = 1e-3 * rtt_ms;
    const PressResult result = run_press(config);
    EXPECT_GE(result.later_stiffness_n_m(), prototype_n_m) << rtt_ms;
    EXPECT_LT(result.worst_swing_mm(), 0.2) << rtt_ms;
  }
}

// What is missing to 1000 N/m is the encoder: half a quantum of 10 µm in a depth of 2.6 mm. Without it every
// touch but the first shows the wall itself, as near as any passive cell of the prototype, its 1000 at 10 ms
// included.
TEST(ShownStiffness, ALocalModelShowsTheWallItselfAtEveryDelay) {
  for (const double rtt_s : {0.0, 0.010, 0.020, 0.050, 0.100, 0.200, 0.500}) {
    PressConfig config;
    config.method = Method::kModel;
    config.rtt_s = rtt_s;
    config.plant.position_quantum_m = 0;
    const PressResult result = run_press(config);
    EXPECT_NEAR(result.later_stiffness_n_m(), 1000, 0.5) << rtt_s;
    EXPECT_LT(result.worst_swing_mm(), 0.01) << rtt_s;
  }
}

TEST(ShownStiffness, KsClampHoldsTheWallAtShortDelaysAndFadesAtLongOnes) {
  PressConfig config;
  config.method = Method::kKsClamp;
  for (const double rtt_s : {0.0, 0.010, 0.020}) {
    config.rtt_s = rtt_s;
    const PressResult result = run_press(config);
    EXPECT_NEAR(result.later_stiffness_n_m(), config.wall_n_m, 0.005 * config.wall_n_m) << rtt_s;
  }
  config.rtt_s = 0.2;
  const PressResult far = run_press(config);
  EXPECT_LT(far.later_stiffness_n_m(), 200) << "it cannot pay for more";
  EXPECT_LT(far.worst_swing_mm(), 0.2) << "but it is calm";
  config.method = Method::kNone;
  config.rtt_s = 0.1;
  EXPECT_GT(run_press(config).worst_swing_mm(), 5) << "without control the hand is thrown about";
}

// Hostile hands.

AttackEffort quick() {
  return {1.5, 4, 8};
}

TEST(Adversary, NoHandBreaksAPromise) {
  std::int64_t steps = 0;
  for (const Method method : control::kAllMethods) {
    if (!control::claims_energy_bound(method)) continue;
    for (const double rtt_s : {0.0, 0.010, 0.1, 0.3}) {
      for (const Channel channel : kChannels) {
        AttackConfig config;
        config.method = method;
        config.rtt_s = rtt_s;
        config.channel = channel;
        config.seed = 100 + static_cast<std::uint64_t>(1e3 * rtt_s) + static_cast<std::uint64_t>(channel);
        const WorstAttack worst = worst_attack(config, quick());
        steps += worst.steps;
        EXPECT_EQ(worst.stopped, 0) << "no stop kept the promise";
        // Rounding: 1e6 terms of some millijoules in long double and double: below 1e-12 J.
        EXPECT_LE(worst.outcome.extracted_j, promised_bound_j(config) + 1e-12)
            << control::method_name(method) << ' ' << rtt_s << ' ' << channel_name(channel) << ' '
            << worst.hand;
        if (balances_both_ports(method)) {
          EXPECT_LE(worst.generated_j, 2 * config.allowance_j + 1e-12)
              << control::method_name(method) << ' ' << rtt_s << ' ' << channel_name(channel);
        }
        EXPECT_TRUE(worst.limits_kept) << control::method_name(method) << ' ' << rtt_s;
      }
    }
  }
  RecordProperty("steps", std::to_string(steps));
}

// A restarted server is another slave with a new account: what the hand has got out stays got out, however
// often. Each of these hands takes the whole allowance between two restarts if it is granted again.
TEST(Adversary, RestartsGrantNothing) {
  for (const Method method : control::kAllMethods) {
    if (!control::claims_energy_bound(method)) continue;
    for (const double rtt_s : {0.02, 0.1}) {
      AttackConfig config;
      config.method = method;
      config.rtt_s = rtt_s;
      config.channel = Channel::kRestarts;
      config.seconds = 20;
      config.restart_mean_s = 1;
      config.hand.velocity_max_m_s = 0.1;
      config.hand.device_damping_n_s_m = 0.2;
      double most_j = 0;
      for (const NamedHand& named : named_hands(config, 3)) {
        const AttackOutcome outcome = attack(config, named.make(config, named.a, named.b));
        EXPECT_LE(outcome.extracted_j, promised_bound_j(config) + 1e-12)
            << control::method_name(method) << ' ' << rtt_s << ' ' << named.name;
        EXPECT_FALSE(outcome.stopped && !outcome.too_fast) << "no stop kept the promise: " << named.name;
        most_j = std::max(most_j, outcome.extracted_j);
      }
      // The hands have teeth.
      EXPECT_GT(most_j, 0.2 * config.allowance_j) << control::method_name(method) << ' ' << rtt_s;
    }
  }
}

// As above with an encoder of 10 µm: the account of the station is then wrong by up to Q, which it knows.
TEST(Adversary, NoHandBreaksAPromiseBehindAnEncoder) {
  for (const Method method : control::kAllMethods) {
    if (!control::claims_energy_bound(method)) continue;
    for (const double rtt_s : {0.0, 0.05}) {
      AttackConfig config;
      config.method = method;
      config.rtt_s = rtt_s;
      config.seconds = 1.5;
      config.channel = Channel::kBursts;
      config.hand.position_quantum_m = 1e-5;
      const auto hands = named_hands(config, 3);
      std::size_t felt = 0, stopped = 0;
      for (const NamedHand& named : hands) {
        const AttackOutcome outcome = attack(config, named.make(config, named.a, named.b));
        felt += outcome.quantum_bound_j > 0;  // a force that changes makes a Q
        stopped += outcome.stopped && !outcome.too_fast;
        EXPECT_LE(outcome.extracted_j, promised_bound_j(config) + outcome.quantum_bound_j)
            << control::method_name(method) << ' ' << rtt_s << ' ' << named.name;
      }
      EXPECT_GE(felt, hands.size() * 3 / 4) << "the promise was put to the test";
      EXPECT_EQ(stopped, 0u) << "no stop kept it";
    }
  }
}

// Without delay this wall is passive for the device (K < 2b/(3T): b pays for what sampling leaks), so nothing
// needs to be taken away, ever. A method that counts the leak but not what pays for it lets the wall fade:
// here the leak is 3·½K Σ Δx² = 3.7 mJ a second, of which the capped damper gets 2.7 mJ back; the allowance
// lasts for ten seconds.
TEST(Adversary, APassiveWallDoesNotFade) {
  for (const Method method : control::kAllMethods) {
    if (!control::claims_energy_bound(method)) continue;
    AttackConfig config;
    config.method = method;
    config.seconds = 60;
    config.wall_n_m = 1250;
    constexpr double kAmplitudeM = 0.002, kHz = 5;
    double early_n = 0, late_n = 0;
    const auto hand = std::make_shared<support::DrivenHand>(config.hand, [&](const auto& view) {
      const double t = 1e-3 * static_cast<double>(view.tick);
      if (t > 1 && t < 2) early_n = std::max(early_n, view.force_n);
      if (t > 58 && t < 59) late_n = std::max(late_n, view.force_n);
      return -config.clearance_m - kAmplitudeM * (1 + std::sin(2 * M_PI * kHz * t));
    });
    const AttackOutcome outcome = attack(config, hand);
    // 4 mm into the wall; the force is two samples old when it has gone: less than 1 %.
    EXPECT_NEAR(early_n, 2 * kAmplitudeM * config.wall_n_m, 0.02 * early_n) << control::method_name(method);
    EXPECT_NEAR(late_n, early_n, 0.02 * early_n) << control::method_name(method);
    EXPECT_LT(outcome.extracted_j, 1e-4) << control::method_name(method);
  }
}

// A device without any certain damping: nothing may be credited then.
TEST(Adversary, NoHandBreaksAPromiseWithoutDamping) {
  for (const Method method : control::kAllMethods) {
    if (!control::claims_energy_bound(method)) continue;
    AttackConfig config;
    config.method = method;
    config.rtt_s = 0.02;
    config.hand.device_damping_n_s_m = 0;
    const WorstAttack worst = worst_attack(config, quick());
    EXPECT_LE(worst.outcome.extracted_j, promised_bound_j(config) + 1e-12)
        << control::method_name(method) << ' ' << worst.hand;
    EXPECT_DOUBLE_EQ(worst.outcome.extracted_j, worst.outcome.given_j);
  }
}

// The hands have teeth: what promises nothing gives joules away.
// The same promise on the product's own samples, with adhesion, marks and friction, whose models change while
// they are felt: the default method, over round trips, restarts and hands that go with the force.
TEST(Adversary, NoHandBreaksTheDefaultsPromiseOnRealSamples) {
  for (const char* name : {"flat_silicon_oxide", "flat_pdms", "humid_flakes", "lithography"}) {
    const auto scene =
        scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
    for (const double rtt_s : {0.0, 0.1, 0.5}) {
      for (const int hand : {0, 1, 2}) {
        support::AccountedHandConfig hand_config;
        auto random = std::make_shared<Random>(17 + static_cast<std::uint64_t>(hand));
        const double wall_m = -0.04;  // the scenes start 40 nm above their ground
        double goal_m = wall_m;
        const auto driven = std::make_shared<support::DrivenHand>(
            hand_config, [=](const support::DrivenHand::View& view) mutable {
              switch (hand) {
                case 0:  // with the force, after a press
                  return view.tick % 400 < 150 ? wall_m - 0.006 : view.pos_m + (view.force_n > 0 ? 1 : -1);
                case 1:  // telegraph about the ground
                  if (random->chance(0.02)) goal_m = wall_m + 0.012 * (random->uniform() - 0.7);
                  return goal_m;
                default:  // in slowly, out at once
                  return view.tick % 300 < 250 ? wall_m - 2e-5 * static_cast<double>(view.tick % 300)
                                               : wall_m + 0.02;
              }
            });
        support::VirtualSessionConfig config;
        config.scene = scene;
        config.hand = driven;
        config.station.scaling = {1e-6, 4e7};
        config.station.allow_unsafe_scaling = true;
        config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e9 * rtt_s);
        support::VirtualSession session(config);
        const int ticks = static_cast<int>(3000 + 4e3 * rtt_s);
        double most_tip_nn = 0;
        for (int k = 0; k < ticks; ++k) {
          const recording::Sample& row = session.step();
          most_tip_nn = std::max(most_tip_nn, std::fabs(row.force_w_nn[2]));
          if (k == ticks / 2) session.restart_server();
        }
        // What the sample gives of its own is credited once, over the restart in the middle too.
        const double well_j =
            std::min(config.station.scaling.hand_energy_j(session.client().welcome().well_aj),
                     config.station.well_max_j);
        EXPECT_LE(driven->account().most_extracted_j(), config.station.allowance_j + well_j + 1e-12)
            << name << ' ' << rtt_s << ' ' << hand;
        EXPECT_LE(most_tip_nn, scene->limits.force_max_nn) << name << ' ' << rtt_s << ' ' << hand;
        EXPECT_FALSE(driven->too_fast());
        EXPECT_GT(most_tip_nn, 5) << "the sample was never felt";
      }
    }
  }
}

TEST(Adversary, MethodsWithoutAPromiseLeak) {
  AttackConfig config;
  config.rtt_s = 0.1;
  for (const Method method : {Method::kNone, Method::kKs}) {
    config.method = method;
    const WorstAttack worst = worst_attack(config, quick());
    EXPECT_GT(worst.outcome.extracted_j, 0.2) << control::method_name(method);
    EXPECT_TRUE(worst.limits_kept) << control::method_name(method);
  }
}

TEST(Adversary, ClimbingFindsMore) {
  AttackConfig config;
  config.method = Method::kNone;
  config.rtt_s = 0.05;
  config.seconds = 1;
  const Climbed start = climb(config, 0.025, 0, {});
  const Climbed end = climb(config, 0.025, 60, {});
  EXPECT_EQ(start.outcome.extracted_j, 0) << "a hand that stays on the surface gets nothing";
  EXPECT_GT(end.outcome.extracted_j, 0.05);
  EXPECT_EQ(end.steps, 61 * config.ticks());
}

TEST(Adversary, SameSeedSameBits) {
  AttackConfig config;
  config.rtt_s = 0.02;
  config.channel = Channel::kEverything;
  config.seed = 5;
  const WorstAttack first = worst_attack(config, quick());
  const WorstAttack second = worst_attack(config, quick());
  EXPECT_EQ(std::memcmp(&first.outcome.extracted_j, &second.outcome.extracted_j, sizeof(double)), 0);
  EXPECT_EQ(std::memcmp(&first.outcome.given_j, &second.outcome.given_j, sizeof(double)), 0);
  EXPECT_EQ(first.hand, second.hand);
  config.seed = 6;
  EXPECT_NE(worst_attack(config, quick()).outcome.given_j, first.outcome.given_j);
  PressConfig press;
  press.rtt_s = 0.05;
  const PressResult once = run_press(press), again = run_press(press);
  for (int i = 0; i < kPresses; ++i) {
    EXPECT_EQ(std::memcmp(&once.presses[static_cast<std::size_t>(i)],
                          &again.presses[static_cast<std::size_t>(i)], sizeof(Press)),
              0);
  }
}

}  // namespace
}  // namespace telenano::studies
