#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/config/shared_files.h"
#include "telenano/common/control/methods.h"
#include "tests/source_dir.h"
#include "tests/studies/stress/arm.h"
#include "tests/studies/stress/hunt.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/mutants.h"
#include "tests/studies/stress/profile.h"
#include "tests/studies/stress/record_watch.h"
#include "tests/studies/stress/results.h"
#include "tests/studies/stress/search.h"
#include "tests/studies/stress/stress_bench.h"
#include "tests/studies/stress/stress_run.h"
#include "tests/studies/stress/summary.h"
#include "tests/support/plant_oracle.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::stress {
namespace {

using control::Method;

// The measuring instruments first: nothing that they say of a method is worth more than they are.

// Against the power series of the plant's oracle, which shares no method with the matrix exponential.
TEST(StressArm, FollowsTheOracleWithAMovingAim) {
  ArmConfig config;
  ArmAxis arm(config);
  support::PlantOracleConfig same;
  same.device_mass_kg = config.device_mass_kg;
  same.device_damping_n_s_m = config.device_damping_n_s_m;
  same.arm_mass_kg = config.arm_mass_kg;
  same.arm_stiffness_n_m = config.arm_stiffness_n_m;
  same.arm_damping_n_s_m = config.arm_damping_n_s_m;
  same.grip_stiffness_n_m = config.grip_stiffness_n_m;
  same.grip_damping_n_s_m = config.grip_damping_n_s_m;
  support::PlantOracle oracle(same);
  oracle.reset(0);
  Random random(3);
  for (int k = 1; k <= 400; ++k) {
    const double force_n = random.uniform(-3, 3), aim_m = 0.01 * std::sin(0.02 * k);
    arm.advance(force_n, aim_m);
    oracle.advance(force_n, aim_m, config.period_s);
    // Both in long double; its rounding, 400 times, in a damped system.
    ASSERT_NEAR(arm.pos_m(), static_cast<double>(oracle.pos_m()), 1e-15) << k;
  }
  EXPECT_NEAR(static_cast<double>(arm.stored_j()), static_cast<double>(oracle.stored_j()), 1e-14);
  EXPECT_GT(std::fabs(arm.pos_m()), 1e-4) << "something happened";
}

// A sampled spring K that is moved by x = A sin ωt gives away ½KΔx² a step (tests/studies/methods): 39.5 mJ.
TEST(StressAccount, ASampledSpringGivesAwayWhatTheClosedFormSays) {
  constexpr double kK = 1000, kA = 0.010, kHz = 2, kT = 1e-3;
  constexpr int kSteps = 10'000;
  TrueAccount account(0, kT, 0);
  const auto at = [&](int k) { return kA * std::sin(2 * M_PI * kHz * kT * k); };
  // Along a diagonal: a third of the energy on each axis.
  const Vec3 along = Vec3(1, 1, 1).normalized();
  for (int k = 1; k <= kSteps; ++k) account.add(-kK * at(k - 1) * along, (at(k) - at(k - 1)) * along);
  const double expected_j = 0.5 * kK * kA * kA * kSteps * (1 - std::cos(2 * M_PI * kHz * kT));
  // 1e4 terms of up to 1e-5 J, each of three products rounded in double.
  EXPECT_NEAR(account.given_j(), expected_j, 1e-11);
  EXPECT_EQ(account.quantum_bound_j(), 0);
}

// Q must hold whatever is hidden below a quantum: positions off by ±q/2 in the worst way for each change of
// force reach it.
TEST(StressAccount, TheQuantumsBoundIsReachedByTheWorstEncoderAndNeverPassed) {
  constexpr double kQ = 1e-5;
  Random random(5);
  TrueAccount account(0, 1e-3, kQ);
  double hidden_j = 0, x = 0, last_f = 0, last_e = 0;
  for (int k = 0; k < 2000; ++k) {
    const double f = random.uniform(-5, 5), next = x + random.uniform(-1e-4, 1e-4);
    // Error after the interval: against the change of force that follows is best done at random here.
    const double e = kQ * (random.uniform() - 0.5);
    account.add(Vec3(0, 0, f), Vec3(0, 0, next - x));
    hidden_j += f * (e - last_e);
    last_e = e;
    last_f = f;
    x = next;
    ASSERT_LE(std::fabs(hidden_j), account.quantum_bound_j());
  }
  // Worst: the error flips with the sign of each step of force.
  TrueAccount worst(0, 1e-3, kQ);
  hidden_j = last_e = 0;
  for (int k = 0; k < 1000; ++k) {
    const double f = k % 2 == 0 ? 1 : -1, e = kQ / 2 * f;
    worst.add(Vec3(0, 0, f), Vec3::Zero());
    hidden_j += f * (e - last_e);
    last_e = e;
  }
  EXPECT_NEAR(hidden_j, worst.quantum_bound_j(), 2e-3 * hidden_j) << "to a term of the first sample";
  (void)last_f;
}

/// A watch with sane limits, a hand at rest, a row in which all is well.
struct Bench {
  Bench() {
    limits.method = Method::kModel;
    limits.force_limit_n = 9.6;
    limits.tip_limit_nn = 600;
    limits.damper_cap_n_s_m = 1.5;
    limits.balance = true;
    limits.hand_j_per_aj = 1e-3;
    row.station_mode = 2;
    HandConfig config;
    class Still final : public HandMotion {
     public:
      explicit Still(double& step) : step_m(step) {}
      Vec3 next(const Vec3& pos, const Vec3&) noexcept override { return pos + Vec3(0, 0, step_m); }
      double& step_m;
    };
    hand = std::make_unique<StressHand>(config, std::make_unique<Still>(step_m));
    hand->start_motion();
  }
  /// A tick: the force, and how far the hand moves until the next one.
  void tick(double force_n, double moved_m = 0, int periods = 1, bool news = true) {
    InvariantWatch::Around around;
    around.given_before_j = hand->account().given_j();
    around.q_before_j = hand->account().quantum_bound_j();
    around.periods = periods;
    around.reply_ns = reply_ns += news;
    row.reply_age_ms = (shows < 0 ? news : shows == 1) ? 0 : 1;
    row.hand_force_applied_h_n[2] = row.hand_force_rendered_h_n[2] = force_n;
    if (!lies) row.energy_j = -around.given_before_j;
    hand->write_force(Vec3(0, 0, force_n));
    step_m = moved_m / periods;
    for (int i = 0; i < periods; ++i) hand->advance(0);
    time_s += 1e-3 * periods;
    if (!watch) watch = std::make_unique<InvariantWatch>(limits);
    around.time_s = time_s;
    watch->look(row, *hand, slave, around);
  }
  std::uint32_t violated() const { return watch->violated(); }

  InvariantWatch::Limits limits;
  std::unique_ptr<InvariantWatch> watch;
  double step_m = 0;
  std::unique_ptr<StressHand> hand;
  recording::Sample row;
  SlaveWatch slave;
  double time_s = 0;
  std::int64_t reply_ns = 0;
  int shows = -1;  ///< a reply in each tick, or none; −1: what comes
  bool lies = false;
};

TEST(Invariants, WhatIsWellIsNotFlagged) {
  Bench bench;
  for (int k = 0; k < 300; ++k) bench.tick(k < 100 ? 0.02 * k : 2, k % 2 == 0 ? 1e-4 : -1e-4);
  EXPECT_EQ(bench.violated(), 0u) << invariant_names(bench.violated());
}

TEST(Invariants, EnergyIsFlaggedBeyondWhatIsAllowedAndNotBefore) {
  for (const bool beyond : {false, true}) {
    Bench bench;
    bench.limits.method = Method::kTank;
    bench.limits.balance = false;
    // 2 N over 0.1 mm is 0.2 mJ, of which b Δx²/T = 2·1e-8/1e-3 = 0.02 mJ is the device's: 0.18 mJ a tick,
    // 20 mJ in 111.1.
    for (int k = 0; k < (beyond ? 112 : 111); ++k) bench.tick(2, 1e-4);
    EXPECT_EQ(bench.violated(), beyond ? kInvariantEnergy : 0u);
    EXPECT_NEAR(bench.watch->least_margin_j(), 0.020 - (beyond ? 112 : 111) * 1.8e-4, 1e-9);
  }
  for (const Method method : {Method::kKsClamp, Method::kModel, Method::kTwin}) {
    for (const bool beyond : {false, true}) {
      Bench one_port;
      one_port.limits.method = method;
      one_port.limits.balance = false;
      for (int k = 0; k < (beyond ? 56 : 55); ++k) one_port.tick(2, 1e-4);
      EXPECT_EQ(one_port.violated(), beyond ? kInvariantEnergy : 0u)
          << control::method_name(method) << ": one port has one allowance";
    }
  }
}

TEST(Invariants, AWellIsAllowedToThoseOnlyThatPassItOn) {
  for (const Method method : {Method::kTank, Method::kModel, Method::kKsClamp}) {
    Bench bench;
    bench.limits.method = method;
    bench.limits.balance = false;
    bench.slave.well_aj = 10;                           // 10 mJ at the hand
    for (int k = 0; k < 100; ++k) bench.tick(2, 1e-4);  // 18 mJ
    EXPECT_EQ(bench.violated(), method == Method::kKsClamp ? kInvariantEnergy : 0u)
        << control::method_name(method);
  }
}

TEST(Invariants, ALateTickMayOverdrawOnce) {
  Bench bench;
  bench.limits.method = Method::kTank;
  bench.limits.balance = false;
  for (int k = 0; k < 111; ++k) bench.tick(2, 1e-4);
  bench.tick(2, 1e-3, 10);  // 10 periods of 0.1 mm: 9·2 N·0.5 mm = 9 mJ allowed, 1.8 taken
  EXPECT_EQ(bench.violated(), 0u);
  EXPECT_DOUBLE_EQ(bench.watch->late_j(), 9e-3);
}

TEST(Invariants, EachOfTheOthersIsFlagged) {
  const auto flagged = [](auto&& wrong) {
    Bench bench;
    for (int k = 0; k < 150; ++k) bench.tick(1);
    EXPECT_EQ(bench.violated(), 0u);
    wrong(bench);
    return bench.violated();
  };
  EXPECT_EQ(flagged([](Bench& b) {
              b.slave.net_in_aj = 21;
              b.tick(1);
            }),
            kInvariantBalance);
  EXPECT_EQ(flagged([](Bench& b) {
              b.row.energy_in_j = -1e-9;
              b.tick(1);
            }),
            kInvariantSums);
  EXPECT_EQ(flagged([](Bench& b) {
              b.slave.sums_fell = true;
              b.tick(1);
            }),
            kInvariantSums);
  EXPECT_EQ(flagged([](Bench& b) {
              b.tick(4.9);
              b.tick(8.8);
              b.tick(9.61);
            }),
            kInvariantForce);
  EXPECT_EQ(flagged([](Bench& b) { b.tick(5.01); }), kInvariantSlew);
  EXPECT_EQ(flagged([](Bench& b) { b.tick(-4.01); }), kInvariantSlew) << "a reversal grows from zero";
  EXPECT_EQ(flagged([](Bench& b) { b.tick(0); }), 0u) << "force may fall at once";
  EXPECT_EQ(flagged([](Bench& b) {
              for (int k = 0; k < 99; ++k) b.tick(1, 0, 1, false);
            }),
            0u);
  EXPECT_EQ(flagged([](Bench& b) {
              for (int k = 0; k < 102; ++k) b.tick(1, 0, 1, false);
            }),
            kInvariantStale);
  EXPECT_EQ(flagged([](Bench& b) {
              for (int k = 0; k < 110; ++k) b.tick(k < 90 ? 1 : 0, 0, 1, false);
              b.row.hand_force_rendered_h_n[2] = 1;
              b.tick(0.5);
            }),
            kInvariantLeap);
  EXPECT_EQ(flagged([](Bench& b) {
              b.slave.most_force_nn = 600.1;
              b.tick(1);
            }),
            kInvariantTip);
  EXPECT_EQ(flagged([](Bench& b) {
              b.row.tip_target_w_nm[0] = NAN;
              b.tick(1);
            }),
            kInvariantFinite);
  EXPECT_EQ(flagged([](Bench& b) {
              b.tick(1, 1e-4);
              b.lies = true;
              b.tick(1, 1e-4);
            }),
            kInvariantAccount);
  EXPECT_EQ(flagged([](Bench& b) {
              b.row.damper_n_s_m = 1.51;
              b.tick(1);
            }),
            kInvariantDamper);
  EXPECT_EQ(flagged([](Bench& b) {
              b.watch->well_again(b.time_s);
              for (int k = 0; k < 4000; ++k) b.tick(0, 0, 1, false);
            }),
            0u)
      << "not checked without a limit";
  Bench slow;
  slow.limits.recover_s = 3;
  slow.tick(0);
  slow.watch->well_again(slow.time_s);
  for (int k = 0; k < 3010; ++k) slow.tick(0, 0, 1, false);
  EXPECT_EQ(slow.violated(), kInvariantRecover);
}

// A row is what was: a place, a force, a tick and a time, each a little off.
TEST(Invariants, ARowThatIsNotWhatWasIsFlagged) {
  const auto flagged = [](auto&& wrong, double quantum_m = 0) {
    RecordWatch watch(1e-3, quantum_m);
    bool right = true;
    for (int k = 0; k < 4; ++k) {
      recording::Sample row;
      row.tick = k;
      row.time_s = 1e-3 * k + (k > 2 ? 2e-3 : 0);
      row.hand_pos_h_m = {0.1 * k, 0.2, 0.3};
      row.hand_force_applied_h_n = {0, 1, 2.5};
      if (k == 3) wrong(row);
      right = watch.is_true(row, Vec3(0.1 * k, 0.2, 0.3), Vec3(0, 1, 2.5), k == 2 ? 3 : 1) && right;
      EXPECT_TRUE(k == 3 || right) << k;
    }
    return !right;
  };
  EXPECT_FALSE(flagged([](recording::Sample&) {})) << "a tick that comes three periods late is none";
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.hand_pos_h_m[1] += 1e-15; }));
  EXPECT_FALSE(flagged([](recording::Sample& row) { row.hand_pos_h_m[1] += 4e-6; }, 1e-5));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.hand_pos_h_m[1] += 6e-6; }, 1e-5));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.hand_force_applied_h_n[2] = 2.4; }));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.tick = 4; }));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.time_s -= 1e-3; }));
}

// Replies that wait to be shown: what counts is what was shown, and that does not outlive what came by more
// than the longest wait.
TEST(Invariants, PlayedOutRepliesHoldTheForceNoLongerThanTheyWait) {
  const auto flagged = [](int shows, bool news, int ticks) {
    Bench bench;
    bench.limits.waits_s = 0.05;
    bench.tick(1);
    bench.shows = shows;
    for (int k = 0; k < ticks; ++k) bench.tick(1, 0, 1, news);
    return bench.violated();
  };
  EXPECT_EQ(flagged(0, true, 99), 0u);
  EXPECT_EQ(flagged(0, true, 102), kInvariantStale) << "they come, and none is shown";
  EXPECT_EQ(flagged(1, false, 150), 0u);
  EXPECT_EQ(flagged(1, false, 153), kInvariantStale) << "what is shown cannot have come";
}

TEST(Invariants, ARateIsBoundedExactly) {
  MethodSummary s;
  EXPECT_EQ(s.rate_at_most(), 1);
  s.runs = 1000;
  // (1 − p)^N = 0.05; the rule of three is 0.14 % above.
  const double none = 1 - std::pow(0.05, 1.0 / 1000);
  EXPECT_NEAR(s.rate_at_most(), none, 1e-9 * none);
  s.broken = 1;
  const double p = s.rate_at_most();
  EXPECT_NEAR(std::pow(1 - p, 1000) + 1000 * p * std::pow(1 - p, 999), 0.05, 1e-9);
  s.broken = s.runs;
  EXPECT_EQ(s.rate_at_most(), 1);
}

// What the text says is what is run.
TEST(RunSpecText, ReadsBackToTheBit) {
  ProfileOptions options;
  options.methods.assign(control::kAllMethods.begin(), control::kAllMethods.end());
  options.scenes = {SceneKind::kWall, SceneKind::kOxide, SceneKind::kScan, SceneKind::kHard};
  for (const RunSpec& spec : make_profile(options)) {
    const RunSpec again = parse_run_spec(to_text(spec));
    EXPECT_EQ(to_text(again), to_text(spec));
    for (const NumberField& field : number_fields())
      ASSERT_EQ(again.*field.value, spec.*field.value) << field.key;
    ASSERT_EQ(again.seed, spec.seed);
    ASSERT_EQ(again.restart, spec.restart);
    ASSERT_EQ(again.playout, spec.playout);
  }
}

TEST(RunSpecText, SaysWhatIsWrong) {
  for (const char* text : {"method=magic",
                           "scene=moon",
                           "hand=foot",
                           "mutant=x",
                           "drops=x",
                           "restart=x",
                           "rtt-ms=-1",
                           "rtt-ms=nan",
                           "rtt-ms=1e",
                           "loss=1",
                           "speed=3",
                           "press",
                           "seed=-1",
                           "hand=path",
                           "playout=x",
                           "playout-ms=-1",
                           "redundancy=1.5",
                           "redundancy=5",
                           "deadband-nm=-1",
                           "reply-permille=1001",
                           "hand=path hand-b=0.1 knots-m=0.1",
                           "hand=path hand-b=0.1 knots-m=0,x"})
    EXPECT_THROW(parse_run_spec(text), UserError) << text;
}

TEST(Profile, TheFullOneIsAsLargeAsItSaysAndRepeats) {
  ProfileOptions options;
  options.full = true;
  options.methods.assign(control::kAllMethods.begin(), control::kAllMethods.end());
  options.scenes = {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPolystyrene,
                    SceneKind::kPdms, SceneKind::kScan,  SceneKind::kHard};
  const auto runs = make_profile(options);
  std::size_t long_ones = 0, defaults = 0, played_out = 0, repeated = 0, held_back = 0;
  std::set<std::uint64_t> seeds;
  for (const RunSpec& spec : runs) {
    long_ones += spec.seconds >= 10;
    defaults += spec.method == Method::kModel;
    played_out += spec.playout != RunSpec{}.playout;
    repeated += spec.redundancy > 0;
    held_back += spec.deadband_nm > 0;
    seeds.insert(spec.seed);
    for (const NumberField& field : number_fields()) {
      ASSERT_GE(spec.*field.value, field.low) << field.key;
      ASSERT_LE(spec.*field.value, field.high) << field.key;
    }
  }
  EXPECT_GE(long_ones, 20'000u);
  EXPECT_GE(defaults, 6'000u);
  EXPECT_GE(std::min({played_out, repeated, held_back}), 2'000u);
  EXPECT_EQ(seeds.size(), runs.size());
  const auto again = make_profile(options);
  ASSERT_EQ(again.size(), runs.size());
  for (std::size_t i = 0; i < runs.size(); i += 101) ASSERT_EQ(to_text(again[i]), to_text(runs[i]));
}

TEST(Profile, TheOneOfRepliesLeavesSomeOutInEachRun) {
  ProfileOptions options;
  options.replies = true;
  options.methods.assign(control::kAllMethods.begin(), control::kAllMethods.end());
  options.scenes = {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPdms, SceneKind::kScan};
  const auto runs = make_profile(options);
  EXPECT_GE(runs.size(), 30'000u);
  for (const RunSpec& spec : runs) {
    ASSERT_GT(spec.reply_permille, 0);
    ASSERT_NE(spec.method, Method::kTwin);
    ASSERT_EQ(to_text(parse_run_spec(to_text(spec))), to_text(spec));
  }
  options.methods = {Method::kTwin};
  EXPECT_THROW(make_profile(options), UserError);
}

TEST(Profile, ARangeLeavesOutWhatIsBeyondIt) {
  ProfileOptions options;
  options.methods = {Method::kModel};
  options.scenes = {SceneKind::kWall};
  options.rtt_ms = {5, 50};
  options.loss = {0.1, 0.3};
  for (const RunSpec& spec : make_profile(options)) {
    ASSERT_TRUE(options.rtt_ms.holds(spec.rtt_ms) && options.loss.holds(spec.loss)) << to_text(spec);
    ASSERT_EQ(spec.scene, SceneKind::kWall);
  }
}

// A stand-in that does what the right method does must change no bit: only then a wrong one shows what its
// fault does.
TEST(StandIn, AFaithfulOneChangesNothing) {
  class Faithful final : public control::StationMethod {
   public:
    explicit Faithful(Method method) : right_(method, {}) {}
    void take_over(double account_j, const control::MethodConfig& c, const Vec3& p) noexcept override {
      right_.now().take_over(account_j, c, p);
    }
    void begin_session(bool epoch) noexcept override { right_.now().begin_session(epoch); }
    void account_for(const control::PortInterval& i) noexcept override { right_.now().account_for(i); }
    void on_reply(const control::SlaveNews& n) noexcept override { right_.now().on_reply(n); }
    Vec3 force_h_n(const control::RenderPoint& at) noexcept override { return right_.now().force_h_n(at); }
    Vec3 damper_force_h_n() const noexcept override { return right_.now().damper_force_h_n(); }
    double damper_n_s_m() const noexcept override { return right_.now().damper_n_s_m(); }
    double force_bound_n() const noexcept override { return right_.now().force_bound_n(); }
    double account_j() const noexcept override { return right_.now().account_j(); }
    void fill_command(control::SlaveOrder& order) const noexcept override {
      right_.now().fill_command(order);
    }

   private:
    control::Methods right_;
  };
  for (const Method method : control::kAllMethods) {
    if (method == Method::kTwin)
      continue;  // without a twin the station takes another method, the stand-in none
    double sums[2] = {0, 0};
    for (const bool stand_in : {false, true}) {
      support::VirtualSessionConfig config;
      config.scene = Scenes::of_this_tree().file(SceneKind::kOxide);
      config.station.method = method;
      config.station.allow_unsafe_scaling = true;
      config.task_options.duration_s = 3;
      config.to_server.delay_ns = config.to_station.delay_ns = 10'000'000;
      if (stand_in) config.make_method = [method] { return std::make_unique<Faithful>(method); };
      support::VirtualSession session(config);
      session.run(4000, [&](const recording::Sample& row) {
        sums[stand_in] =
            1.0000001 * sums[stand_in] + row.hand_force_applied_h_n[2] + row.account_j + row.hand_pos_h_m[2];
      });
    }
    EXPECT_EQ(sums[0], sums[1]) << control::method_name(method);
    EXPECT_NE(sums[0], 0);
  }
}

TEST(VirtualSession, MissesTicksWhileDeviceAndLinkGoOn) {
  support::VirtualSessionConfig config;
  config.scene = Scenes::of_this_tree().file(SceneKind::kPdms);
  support::VirtualSession session(config);
  for (int k = 0; k < 10; ++k) session.step();
  const double before_s = session.step(25).time_s;
  const double late_s = session.step().time_s;
  EXPECT_NEAR(late_s - before_s, 0.025, 1e-12);
  EXPECT_NEAR(session.step().time_s - late_s, 0.001, 1e-12);
}

TEST(StressRun, SameTextSameBits) {
  for (const char* text :
       {"method=model scene=oxide hand=human seconds=2 rtt-ms=20 loss=0.3 jitter=0.5 duplicate=0.1 seed=5",
        "method=tank scene=wall hand=telegraph hand-a=0.01 hand-b=30 seconds=2 restart=random late=0.05 "
        "late-periods=9",
        "method=model scene=wall hand=climb-slow hand-a=3 seconds=1 rtt-ms=20"}) {
    const RunSpec spec = parse_run_spec(text);
    const Outcome first = run(spec, Scenes::of_this_tree()), second = run(spec, Scenes::of_this_tree());
    EXPECT_EQ(first.hash, second.hash) << text;
    EXPECT_EQ(first.extracted_mj, second.extracted_mj);
    if (spec.hand == HandKind::kClimbSlow) continue;  // few tries may find nothing better with either
    RunSpec other = spec;
    other.seed += 1;
    EXPECT_NE(run(other, Scenes::of_this_tree()).hash, first.hash) << text;
  }
}

TEST(StressRun, FaultsDoWhatTheySay) {
  const auto of = [](const char* text) { return run(parse_run_spec(text), Scenes::of_this_tree()); };
  EXPECT_EQ(of("hand=press seconds=6").sessions, 1);
  const Outcome died = of("hand=press seconds=6 rtt-ms=20 restart=contact down-ms=300");
  EXPECT_EQ(died.sessions, 2);
  EXPECT_GE(died.recover_s, 0.02);
  EXPECT_LT(died.recover_s, 2);
  const Outcome outage = of("hand=press seconds=6 rtt-ms=20 outage-ms=500");
  EXPECT_GE(outage.recover_s, 0.01);
  EXPECT_EQ(of("hand=press seconds=6").recover_s, -1);
  EXPECT_LT(of("hand=press seconds=6 late=0.1 late-periods=10").ticks, 5000);
  EXPECT_GT(of("hand=press seconds=6 late=0.1 late-periods=10").late_mj, 0.1);
  // The wall itself without a delay; a firm hand's rest on it is a closed form (tests/studies/methods).
  const Outcome plain = of("hand=press seconds=6");
  EXPECT_NEAR(plain.shown_ratio, 1, 1e-3);
  EXPECT_NEAR(plain.swing_mm, 0, 1e-2);
}

// Each act changes what is felt, ends without a stop that a person did not ask for, and breaks nothing.
TEST(StressRun, ActsDoWhatTheySay) {
  std::set<std::uint64_t> hashes;
  for (const char* act : {"none", "scale", "impedance", "method", "clutch", "stop"}) {
    const std::string text =
        "method=model scene=oxide hand=press rtt-ms=20 seconds=6 act=" + std::string(act);
    const Outcome outcome = run(parse_run_spec(text), Scenes::of_this_tree());
    EXPECT_TRUE(outcome.survived()) << text << ": " << invariant_names(outcome.violated);
    EXPECT_TRUE(hashes.insert(outcome.hash).second) << text;
    EXPECT_EQ(outcome.stop_ticks > 0, std::string(act) == "stop") << text;
  }
  // With the damping of a real device in doubt a change that forgives is found.
  const std::string wrong =
      "method=ks-clamp scene=wall hand=greedy mutant=forgiving-change act=scale scale=4 seconds=20 "
      "hand-a=0.1 "
      "hand-b=0.01 damping=0.2";
  EXPECT_NE(run(parse_run_spec(wrong), Scenes::of_this_tree()).violated & kInvariantEnergy, 0u);
}

TEST(StressRun, TheNewActsAndCompandingDoWhatTheySay) {
  const Scenes& scenes = Scenes::of_this_tree();
  const auto outcome = [&](const std::string& text) { return run(parse_run_spec(text), scenes); };
  const std::string calm = "method=twin scene=oxide hand=indent seconds=6 seed=5";
  const Outcome plain = outcome(calm), companded = outcome(calm + " compand=5");
  EXPECT_NE(plain.hash, companded.hash);
  EXPECT_EQ(companded.violated, 0u) << "felt is judged by psi' as it is written down";
  EXPECT_EQ(outcome("method=tank scene=oxide hand=indent rtt-ms=20 seconds=6 compand=5 seed=5").hash,
            outcome("method=tank scene=oxide hand=indent rtt-ms=20 seconds=6 seed=5").hash)
      << "only a twin knows the energy";
  EXPECT_NE(plain.hash, outcome(calm + " act=task").hash);

  // A scale beyond what is passive is refused each time, one within it never.
  const Outcome refused = outcome("method=model scene=oxide hand=indent seconds=6 act=impedance seed=5");
  EXPECT_GE(refused.refused, 5);
  EXPECT_EQ(refused.violated, 0u);
  EXPECT_EQ(outcome("method=model scene=oxide hand=indent seconds=6 act=scale seed=5").refused, 0);

  const Outcome taken =
      outcome("method=tank scene=oxide hand=indent rtt-ms=20 seconds=6 act=take-over seed=5");
  EXPECT_GE(taken.handed_over, 10) << "to the other operator and back, every 0.7 s";
  EXPECT_EQ(taken.violated, 0u);
  EXPECT_EQ(outcome("method=tank scene=oxide hand=indent rtt-ms=20 seconds=6 seed=5").handed_over, 0);
  EXPECT_THROW(parse_run_spec("act=take-over restart=free"), UserError);
}

TEST(StressRun, LinkOptionsDoWhatTheySay) {
  // Nothing but the reply itself is felt with `none`, one tick after its command where the link takes no
  // time.
  const auto felt_s = [](const std::string& text) {
    std::vector<TraceRow> trace;
    RunExtras extras;
    extras.trace = &trace;
    run(parse_run_spec("method=none hand=press seconds=3 " + text), Scenes::of_this_tree(), extras);
    const auto first =
        std::find_if(trace.begin(), trace.end(), [](const TraceRow& row) { return row.force_n != 0; });
    return first == trace.end() ? NAN : first->time_s;
  };
  const double plain_s = felt_s("");
  EXPECT_NEAR(felt_s("playout=constant playout-ms=100") - plain_s, 0.099, 1e-9);
  EXPECT_NEAR(felt_s("playout=adaptive playout-ms=3") - plain_s, 0, 0.0011) << "down to SRTT and a tick";

  const auto of = [](const std::string& text) {
    return run(parse_run_spec("seconds=3 " + text), Scenes::of_this_tree());
  };
  EXPECT_EQ(of("redundancy=4").hash, of("").hash) << "where nothing is lost, what is repeated is no news";
  const std::string lossy =
      "method=none scene=oxide hand=square hand-a=0.008 hand-b=0.02 loss=0.3 burst-ms=2";
  EXPECT_NE(of(lossy + " redundancy=4").hash, of(lossy).hash);
  // A staircase of 1 mm of the hand against one of a tick's motion.
  EXPECT_GT(of("method=none reply-permille=500 reply-n=0.1").force_step_n,
            2 * of("method=none").force_step_n);
  EXPECT_GT(of("method=none deadband-nm=1").force_step_n, 2 * of("method=none").force_step_n);
}

TEST(StressBench, MeasuresEachMethodAndTwoThreads) {
  StressBenchOptions options;
  options.scenes = config::shared_folder() / "scenes";
  options.rounds = 1;
  options.seconds = 0.5;
  const std::string csv = stress_bench_csv(options);
  // Every method, three scenes, two hands; scaling; head.
  const auto methods = static_cast<std::ptrdiff_t>(control::kAllMethods.size());
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), methods * 3 * 2 + 2) << csv;
  EXPECT_NE(csv.find("\nsteps_per_s,oxide,greedy,model,1,"), std::string::npos) << csv;
  EXPECT_NE(csv.find("\nscaling,all,all,all,2,"), std::string::npos) << csv;
}

TEST(Results, GroupsHaveEveryRunOnce) {
  std::vector<Row> rows(5);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i].spec.scene = i < 2 ? SceneKind::kOxide : SceneKind::kWall;
    rows[i].outcome.shown_ratio = i == 0 ? NAN : 0.1 * static_cast<double>(i);
    rows[i].outcome.margin_mj = 20 - static_cast<double>(i);
  }
  rows[4].outcome.violated = kInvariantEnergy;
  const std::string csv = groups_csv(rows);
  EXPECT_NE(csv.find("model,wall,press,3,1,2,0,0,16,0,0.3\n"), std::string::npos) << csv;
  EXPECT_NE(csv.find("model,oxide,press,2,0,2,0,0,19,0,0.1\n"), std::string::npos) << csv;
}

TEST(Search, ClimbingFindsMoreAndShrinkingKeepsTheFault) {
  const Scenes& scenes = Scenes::of_this_tree();
  const RunSpec start = parse_run_spec("method=none hand=climb-slow hand-a=0 seconds=1 rtt-ms=50 seed=3");
  RunSpec climbing = start;
  climbing.hand_a = 30;
  const Outcome before = run(start, scenes);
  EXPECT_GT(run(climbing, scenes).extracted_mj, before.extracted_mj);

  const RunSpec whole = parse_run_spec(
      "method=ks-clamp mutant=no-clamp hand=greedy hand-a=0.1 hand-b=0.01 seconds=4 rtt-ms=100 scale=4 "
      "loss=0.1 "
      "duplicate=0.1 drift-ppm=100 leap-ms=50 seed=9");
  const auto bad = [](const Outcome& o) { return (o.violated & kInvariantEnergy) != 0; };
  ASSERT_TRUE(bad(run(whole, scenes)));
  const RunSpec small = shrink(whole, scenes, bad);
  EXPECT_TRUE(bad(run(small, scenes)));
  EXPECT_EQ(small.hand, HandKind::kPath);
  EXPECT_LT(small.seconds, 2);
  EXPECT_LT(small.knots_m.size(), 200u);
  EXPECT_EQ(small.leap_ms, 0);
  EXPECT_EQ(small.duplicate, 0);
  EXPECT_EQ(small.mutant, Mutant::kNoClamp);
}

// The worst that was ever found, shrunk, for ever: a trace with a mutant must still find it out, and without
// the mutant, as every other trace, nothing that is promised may be broken.
TEST(Traces, TheWorstThatWasFoundIsHarmlessAndFaultsAreStillFound) {
  const auto folder = std::filesystem::path(TELENANO_SOURCE_DIR) / "tests/studies/stress/traces";
  std::size_t traces = 0, mutants = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".trace") continue;
    std::ifstream in(entry.path());
    for (std::string line; std::getline(in, line);) {
      if (line.empty() || line[0] == '#') continue;
      ++traces;
      const RunSpec spec = parse_run_spec(line);
      RunSpec right = spec;
      right.mutant = Mutant::kNone;
      const Outcome outcome = run(right, Scenes::of_this_tree());
      EXPECT_EQ(outcome.violated & promised(right.method), 0u)
          << entry.path() << ": " << invariant_names(outcome.violated & promised(right.method));
      if (spec.mutant == Mutant::kNone) continue;
      ++mutants;
      EXPECT_NE(run(spec, Scenes::of_this_tree()).violated & ~outcome.violated, 0u)
          << entry.path() << ": the wrong controller is not found out any more";
    }
  }
  EXPECT_GE(traces, 20u);
  EXPECT_GE(mutants, kMutants);
}

}  // namespace
}  // namespace telenano::studies::stress
