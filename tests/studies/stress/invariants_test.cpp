#include "tests/studies/stress/invariants.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>

#include "telenano/common/control/methods.h"
#include "telenano/master/station/station.h"
#include "tests/studies/stress/hands.h"
#include "tests/studies/stress/stress_hand.h"

namespace telenano::studies::stress {
namespace {

using control::Method;

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
    around.silent_s = silent_s;
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
  double silent_s = 0;
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

TEST(Invariants, NoMoreComesBackThanTheStoreHolds) {
  for (const bool beyond : {false, true}) {
    Bench bench;
    bench.limits.balance = false;
    bench.limits.store_j = 0.05;
    // 0.22 mJ a tick are put in; 60 mJ at most come back, 0.18 mJ a tick.
    for (int k = 0; k < 1000; ++k) bench.tick(2, -1e-4);
    for (int k = 0; k < (beyond ? 334 : 333); ++k) bench.tick(2, 1e-4);
    EXPECT_EQ(bench.violated(), beyond ? kInvariantEnergy : 0u);
  }
}

TEST(Invariants, AForceFadesFromTheHoldTimeOn) {
  Bench holds;
  holds.limits.stale_hold_s = 0.02;
  for (int k = 0; k < 10; ++k) holds.tick(1);
  for (int k = 0; k < 21; ++k) holds.tick(1, 0, 1, false);
  EXPECT_EQ(holds.violated(), 0u) << invariant_names(holds.violated());
  for (int k = 0; k < 5; ++k) holds.tick(1, 0, 1, false);
  EXPECT_EQ(holds.violated(), kInvariantStale);
}

TEST(Invariants, NoForceOverALinkThatIsTooLong) {
  for (const double force_n : {0.0, 0.01}) {
    Bench bench;
    bench.limits.too_long = true;
    for (int k = 0; k < 600; ++k) bench.tick(k < 499 ? 0.01 : force_n);
    EXPECT_EQ(bench.violated(), force_n > 0 ? kInvariantStale : 0u);
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
  EXPECT_EQ(flagged([](Bench& b) {
              b.slave.sums_are_work = false;
              b.tick(1);
            }),
            kInvariantWork);
  Bench slow;
  slow.limits.recover_s = 3;
  slow.tick(0);
  slow.watch->well_again(slow.time_s);
  for (int k = 0; k < 3010; ++k) slow.tick(0, 0, 1, false);
  EXPECT_EQ(slow.violated(), kInvariantRecover);
}

// A slave that has been told to stop, or that nobody talks to, rises.
TEST(Invariants, ASlaveThatDoesNotWithdrawIsFlagged) {
  const auto flagged = [](auto&& prepare, bool rises, int ticks) {
    Bench bench;
    bench.limits.stop_s = 0.03;
    bench.limits.silence_s = 2;
    bench.tick(0);
    prepare(bench);
    bench.slave.rises = rises;
    for (int k = 0; k < ticks; ++k) bench.tick(0);
    return bench.violated();
  };
  const auto stop = [](Bench& b) { b.row.limit_flags = recording::kLimitStop; };
  EXPECT_EQ(flagged(stop, false, 30), 0u) << "it has not heard it";
  EXPECT_EQ(flagged(stop, false, 33), kInvariantWithdraw);
  EXPECT_EQ(flagged(stop, true, 33), 0u);
  EXPECT_EQ(flagged([](Bench& b) { b.silent_s = 1.9; }, false, 1), 0u);
  EXPECT_EQ(flagged([](Bench& b) { b.silent_s = 2.1; }, false, 1), kInvariantWithdraw);
}

TEST(Invariants, AHandThatWasTooFastAndDidNotStopTheStationIsFlagged) {
  const auto flagged = [](double moved_m, double interval_s, std::uint32_t faults) {
    Bench bench;
    bench.row.dt_s = interval_s;
    bench.row.hand_pos_h_m[0] = 0.1;  // where it begins is no motion
    bench.tick(0);
    bench.row.hand_pos_h_m[0] -= moved_m;
    bench.row.station_faults = faults;
    bench.tick(0);
    return bench.violated();
  };
  EXPECT_EQ(flagged(4.9e-4, 1e-3, 0), 0u);
  EXPECT_EQ(flagged(5.1e-4, 1e-3, 0), kInvariantTrip);
  EXPECT_EQ(flagged(5.1e-4, 1e-3, station::kFaultVelocityTrip), 0u);
  EXPECT_EQ(flagged(9e-4, 2e-3, 0), 0u) << "a tick that came late";
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

}  // namespace
}  // namespace telenano::studies::stress
