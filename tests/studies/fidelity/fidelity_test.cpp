#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <set>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/config/shared_files.h"
#include "tests/studies/fidelity/fidelity_grid.h"
#include "tests/studies/fidelity/haptic_metrics.h"
#include "tests/studies/fidelity/lagged_products.h"
#include "tests/studies/fidelity/sensitivity.h"
#include "tests/support/driven_hand.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies::fidelity {
namespace {

constexpr double kHz = 2, kAmplitudeM = 0.01, kWallN_m = 100;
constexpr std::size_t kTicks = 2000;  // four whole periods at 1 kHz

double angle(double tick) {
  return 2 * kPi * kHz * 1e-3 * tick;
}

// The sums are compared bit by bit with the loop that the definition says: a lag that is found must not depend on
// how they are made. Rows without a force, forces along one axis, and forces that are no numbers take ways of
// their own.
TEST(LaggedProducts, HaveTheBitsOfThePlainSums) {
  Random random(7);
  const auto force = [&](bool lateral) {
    return Vec3(lateral ? random.normal() : -0.0, lateral ? random.normal() : 0.0, random.normal());
  };
  for (const std::size_t rows : {0u, 1u, 5u, 600u, 1500u}) {
    for (const int kind : {0, 1, 2, 3, 4, 5}) {
      TouchTrace trace;
      for (std::size_t k = 0; k < rows; ++k) {
        TouchTrace::Row row;
        if (kind == 0 || k % 90 < 40) row.felt_h_n = force(kind != 1);
        if (kind == 0 || k % 70 < 50) row.true_h_n = force(kind != 2);
        trace.rows.push_back(row);
      }
      if (rows > 4 && kind == 4) trace.rows[4].true_h_n.x() = std::numeric_limits<double>::infinity();
      if (rows > 4 && kind == 5) trace.rows[3].felt_h_n.y() = std::numeric_limits<double>::quiet_NaN();
      for (const std::ptrdiff_t wanted : {0, 3, 7, 230}) {
        const auto n = static_cast<std::ptrdiff_t>(rows);
        const std::ptrdiff_t reach = std::min(wanted, n / 2), ahead = std::min<std::ptrdiff_t>(20, reach);
        const std::vector<double> sums = lagged_products(trace, ahead, reach);
        ASSERT_EQ(std::ssize(sums), ahead + reach + 1);
        for (std::ptrdiff_t lag = -ahead; lag <= reach; ++lag) {
          double both = 0;
          for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, lag); k < std::min(n, n + lag); ++k)
            both += trace.rows[static_cast<std::size_t>(k)].felt_h_n.dot(
                trace.rows[static_cast<std::size_t>(k - lag)].true_h_n);
          const double sum = sums[static_cast<std::size_t>(lag + ahead)];
          if (std::isnan(both)) {
            EXPECT_TRUE(std::isnan(sum)) << rows << ' ' << kind << ' ' << lag;
          } else {
            ASSERT_EQ(std::bit_cast<std::uint64_t>(sum), std::bit_cast<std::uint64_t>(both))
                << rows << ' ' << kind << ' ' << lag;
          }
        }
      }
    }
  }
}

/// A hand that swings in a spring, which it feels `late` ticks late.
TouchTrace swinging(int late) {
  TouchTrace trace;
  for (std::size_t k = 0; k < kTicks; ++k) {
    const auto t = static_cast<double>(k);
    TouchTrace::Row row;
    row.hand_pos_h_m.z() = kAmplitudeM * std::sin(angle(t));
    row.true_h_n.z() = -kWallN_m * kAmplitudeM * std::sin(angle(t));
    row.felt_h_n.z() = -kWallN_m * kAmplitudeM * std::sin(angle(t - late));
    row.touches = true;
    trace.rows.push_back(row);
  }
  return trace;
}

// sin a − sin(a − φ) has the RMS of sin times 2 sin φ/2; a spring felt late by φ gives π k A² sin φ a turn.
TEST(FeltMetrics, APureDelayIsFoundAsLagWithItsErrorAndItsWork) {
  for (const int late : {0, 1, 20, 80}) {
    const FeltMetrics m = measure(swinging(late), 0.2);
    const double phi = angle(late);
    EXPECT_NEAR(m.nrmse, 2 * std::sin(phi / 2), 1e-9) << late;
    EXPECT_NEAR(m.nrmse_z, 2 * std::sin(phi / 2), 1e-9) << late;
    EXPECT_TRUE(std::isnan(m.nrmse_x)) << "there is no lateral force";
    EXPECT_EQ(m.lag_ms, late);
    EXPECT_LT(m.nrmse_at_lag, 1e-9) << late;
    // Sums of F(k−1)·Δx for the integral: of first order in the angle of a tick.
    EXPECT_NEAR(m.work_felt_mj, -4e3 * kPi * kWallN_m * kAmplitudeM * kAmplitudeM * std::sin(phi),
                4e3 * kPi * kWallN_m * kAmplitudeM * kAmplitudeM * angle(1))
        << late;
    EXPECT_NEAR(m.work_true_mj, 0, 4e3 * kPi * kWallN_m * kAmplitudeM * kAmplitudeM * angle(1));
  }
}

TEST(HapticMetrics, AConstantDelayIsTheEffectiveDelayAndLeavesNothing) {
  for (const int late : {0, 1, 20, 80}) {
    TouchTrace trace = swinging(late);
    // What was before the first tick is nowhere to be found.
    for (int k = 0; k < late; ++k) trace.rows[static_cast<std::size_t>(k)].felt_h_n.setZero();
    const HapticMetrics m = measure_haptic(trace, 0.2);
    EXPECT_NEAR(m.effective_delay_ms, late, 0.03 * late) << "the first ones have none";
    EXPECT_LT(m.effective_nrmse, late == 0 ? 1e-12 : 0.02) << late;
  }
}

// Twenty ticks for a second, sixty for another: the mean, where a correlation finds one of the two.
TEST(HapticMetrics, ADelayThatChangesIsFoundPieceByPiece) {
  TouchTrace trace = swinging(0);
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    const std::size_t late = i < trace.rows.size() / 2 ? 20 : 60;
    trace.rows[i].felt_h_n = i >= late ? trace.rows[i - late].true_h_n : Vec3(Vec3::Zero());
  }
  const HapticMetrics m = measure_haptic(trace, 0.2);
  EXPECT_NEAR(m.effective_delay_ms, 40, 1.5);
  EXPECT_LT(m.effective_nrmse, 0.03);
  EXPECT_GT(measure(trace, 0.2).nrmse_at_lag, 3 * m.effective_nrmse);
}

// Time is no excuse for a force that is too weak, and a force that comes before its time is no late one.
TEST(HapticMetrics, WhatIsTooWeakOrTooEarlyStaysWrong) {
  TouchTrace weak = swinging(0);
  for (auto& row : weak.rows) row.felt_h_n *= 0.5;
  EXPECT_GT(measure_haptic(weak, 0.2).effective_nrmse, 0.2);
  TouchTrace early = swinging(0);
  for (std::size_t i = 0; i + 40 < early.rows.size(); ++i)
    early.rows[i].felt_h_n = early.rows[i + 40].true_h_n;
  EXPECT_GT(measure_haptic(early, 0.02).effective_nrmse, 0.05);
}

// The least sum of all that are allowed, by trying each of them.
TEST(HapticMetrics, TheAlignmentIsTheCheapestThereIs) {
  Random random(3);
  constexpr std::size_t kRows = 7, kMost = 3;
  for (int turn = 0; turn < 200; ++turn) {
    std::vector<TouchTrace::Row> rows(kRows);
    for (auto& row : rows) {
      row.true_h_n = Vec3(random.uniform(-1, 1), 0, random.uniform(-1, 1));
      row.felt_h_n = Vec3(random.uniform(-1, 1), 0, random.uniform(-1, 1));
    }
    const double change = random.uniform(0, 0.5);
    double found = 0;
    const auto delays = effective_delays(rows, kMost, change, found);
    double least = 1e300, of_found = 0;
    const auto cost_of = [&](const std::vector<std::size_t>& d) {
      double sum = 0;
      for (std::size_t i = 0; i < kRows; ++i) {
        if (d[i] > i || (i > 0 && d[i] > d[i - 1] + 1)) return 1e300;
        sum += (rows[i].felt_h_n - rows[i - d[i]].true_h_n).squaredNorm();
        if (i > 0) sum += change * std::fabs(static_cast<double>(d[i]) - static_cast<double>(d[i - 1]));
      }
      return sum;
    };
    std::vector<std::size_t> d(kRows);
    for (std::size_t code = 0; code < (1u << (2 * kRows)); ++code) {
      for (std::size_t i = 0; i < kRows; ++i) d[i] = (code >> (2 * i)) & 3;
      least = std::min(least, cost_of(d));
    }
    of_found = cost_of(delays);
    ASSERT_NEAR(found, least, 1e-12);
    ASSERT_NEAR(of_found, least, 1e-12);
  }
}

/// Swings of two axes that do not repeat within the trace, told wrong by a gain, an offset, a delay and noise.
TouchTrace told_wrong(std::size_t late, double gain, const Vec3& offset_n, double noise_n = 0) {
  const auto force = [](double t) {
    return Vec3(0.3 * std::sin(1.7 * t), 0.0, -0.6 - 0.4 * std::sin(3.1 * t) - 0.2 * std::sin(7.7 * t + 1));
  };
  Random random(11);
  TouchTrace trace;
  for (std::size_t k = 0; k < 3000; ++k) {
    TouchTrace::Row row;
    row.true_h_n = force(1e-3 * static_cast<double>(k));
    row.felt_h_n = gain * force(1e-3 * (static_cast<double>(k) - static_cast<double>(late))) + offset_n;
    for (int axis = 0; axis < 3; ++axis) row.felt_h_n[axis] += noise_n * random.normal();
    row.touches = true;
    trace.rows.push_back(row);
  }
  return trace;
}

TEST(HapticMetrics, TimeGainAndValueOffsetAreFoundAsTheyWereMade) {
  struct Case {
    std::size_t late;
    double gain;
    Vec3 offset_n;
  };
  const Case cases[] = {{0, 1, Vec3::Zero()},
                        {35, 1, Vec3::Zero()},
                        {0, 0.5, Vec3::Zero()},
                        {0, 1, Vec3(0.05, 0, 0.12)},
                        {70, 1.3, Vec3(-0.1, 0.02, 0.2)},
                        {1, 0.9, Vec3(0, 0, -0.3)}};
  for (const Case& c : cases) {
    for (const double noise_n : {0.0, 0.05}) {
      SCOPED_TRACE(::testing::Message() << c.late << " ticks, gain " << c.gain << ", noise " << noise_n);
      const Alignment a = align(told_wrong(c.late, c.gain, c.offset_n, noise_n).rows, 200);
      ASSERT_TRUE(a.found);
      // Noise of 0.05 N over 3000 ticks beside a slope of some N/s: a tick or two, and 0.05/√3000 N by each of the rest.
      EXPECT_NEAR(static_cast<double>(a.ticks), static_cast<double>(c.late), noise_n > 0 ? 2 : 0);
      EXPECT_NEAR(a.gain, c.gain, noise_n > 0 ? 0.01 : 1e-9);
      EXPECT_LT((a.offset_n - c.offset_n).norm(), noise_n > 0 ? 0.01 : 1e-9);
      EXPECT_NEAR(a.left_n, std::sqrt(3.0) * noise_n, 0.03 * noise_n + 1e-7);
    }
  }
  const HapticMetrics m = measure_haptic(told_wrong(70, 1.3, Vec3(-0.1, 0.02, 0.2)), 0.2);
  EXPECT_NEAR(m.time_offset_ms, 70, 1e-9);
  EXPECT_NEAR(m.value_gain, 1.3, 1e-9);
  EXPECT_NEAR(m.value_offset_n, std::sqrt(0.0504), 1e-9);
}

// A press that never changes has no gain and no delay: what is wrong is value.
TEST(HapticMetrics, OfAForceThatStandsStillOnlyTheValueIsWrong) {
  TouchTrace trace;
  for (int k = 0; k < 500; ++k) {
    TouchTrace::Row row;
    row.true_h_n.z() = -0.8;
    row.felt_h_n.z() = -0.5;
    row.touches = true;
    trace.rows.push_back(row);
  }
  const Alignment a = align(trace.rows, 100);
  EXPECT_EQ(a.ticks, 0u);
  EXPECT_EQ(a.gain, 1);
  EXPECT_NEAR(a.offset_n.z(), 0.3, 1e-12);
  EXPECT_FALSE(align({}, 100).found);
}

// Noise that a hand does not notice must not become time: the delay's changes cost as much as two such forces.
TEST(HapticMetrics, NoiseDoesNotBecomeDelay) {
  const HapticMetrics m = measure_haptic(told_wrong(40, 1, Vec3::Zero(), 0.4 * kJudgedN), 0.2);
  EXPECT_NEAR(m.effective_delay_ms, 40, 1.5);
  EXPECT_LT(m.effective_delay_derivative, 0.1);
  // A delay that falls by 40 ticks once, and is reached once.
  TouchTrace trace = told_wrong(0, 1, Vec3::Zero());
  for (std::size_t i = 1500; i < trace.rows.size(); ++i) trace.rows[i].felt_h_n = trace.rows[i - 30].true_h_n;
  EXPECT_NEAR(measure_haptic(trace, 0.2).effective_delay_derivative * 3000, 30, 3);
}

// From 1 N down to e⁻² N in steps of 0.01 %: one sample each time that a tenth is lost, 2/ln(1/0.9) = 18.98.
TEST(HapticMetrics, ADeadbandOfWeberSendsTheLogarithm) {
  TouchTrace trace;
  for (int k = 0; k < 20000; ++k) {
    TouchTrace::Row row;
    row.true_h_n.z() = std::exp(-1e-4 * k);
    trace.rows.push_back(row);
  }
  const HapticMetrics m = measure_haptic(trace, 0.001);
  EXPECT_NEAR(m.weber_sent_share * 20000, 1 + std::floor(2 / std::log(1 / 0.9)), 0.5);
  EXPECT_GT(m.weber_nrmse, 0.03);
  EXPECT_LT(m.weber_nrmse, 0.1);
  // Half a deadband of nothing: not a single one.
  for (auto& row : trace.rows) row.true_h_n.z() = 0.9 * kJudgedN;
  EXPECT_EQ(measure_haptic(trace, 0.001).weber_sent_share, 0);
}

/// Free, pulled down by 0.4 N, pressed with 1 N, pulled by 1 N until it lets go, free.
TouchTrace touch(double felt_pull_n, bool lost = false, double seconds_free = 1) {
  TouchTrace trace;
  const auto add = [&](double seconds, double true_n, double felt_n, bool touches) {
    for (int k = 0; k < std::lround(seconds * 1e3); ++k) {
      TouchTrace::Row row;
      row.true_h_n.z() = true_n;
      row.felt_h_n.z() = felt_n;
      row.touches = touches;
      trace.rows.push_back(row);
    }
  };
  add(seconds_free, 0, 0, false);
  add(0.1, -0.4, -0.3, true);
  add(0.5, 1, 1, true);
  if (lost) add(0.1, 1, 0, true);
  add(0.5, -1, -felt_pull_n, true);
  add(seconds_free, 0, 0, false);
  return trace;
}

TEST(FeltMetrics, SnapInAndPullOffAreComparedByTheirGreatestAttraction) {
  const FeltMetrics m = measure(touch(1.1), 0.1);
  EXPECT_EQ(m.contacts, 1);
  EXPECT_NEAR(m.snap_in_true_n, 0.4, 1e-12);
  EXPECT_NEAR(m.snap_in_error, -0.25, 1e-12);
  EXPECT_NEAR(m.pull_off_true_n, 1, 1e-12);
  EXPECT_NEAR(m.pull_off_error, 0.1, 1e-12);
  EXPECT_NEAR(m.snap_in_peak_n, 0.1, 1e-12);
  EXPECT_NEAR(m.pull_off_peak_n, 0.1, 1e-12);
  EXPECT_EQ(m.false_releases, 0);
  // (0.1² · 100 + 0.1² · 500)/(0.4² · 100 + 1 · 500 + 1 · 500)
  EXPECT_NEAR(m.nrmse, std::sqrt(6.0 / 1016), 1e-12);
  // Without 50 ms around the beginning and the end: (0.1² · 50 + 0.1² · 450)/(0.4² · 50 + 500 + 450)
  EXPECT_NEAR(m.nrmse_between, std::sqrt(5.0 / 958), 1e-12);
}

TEST(FeltMetrics, AForceThatIsGoneInTheMiddleOfAContactIsAFalseRelease) {
  EXPECT_EQ(measure(touch(1, true), 0.1).false_releases, 1);
  EXPECT_EQ(measure(touch(0), 0.1).false_releases, 1) << "the pull is not felt at all";
}

TEST(FeltMetrics, AForceThatComesAfterTheContactCounts) {
  TouchTrace trace = touch(1);
  trace.rows.back().felt_h_n.z() = 1;  // alone, a second after everything
  EXPECT_NEAR(measure(trace, 0.1).nrmse, std::sqrt((1 + 0.01 * 100) / 1016), 1e-12);
}

/// A whole session over a link, on a wall that can be computed by hand; the hand swings in it.
TouchOutcome on_a_wall(control::Method method, double rtt_ms, double reply_permille = 0) {
  constexpr double kStartM = 0.005;  // a millimetre is a nanometre
  TouchRun run;
  support::AccountedHandConfig hand;
  const auto place_m = [](double tick) {
    return -kStartM - kAmplitudeM * (1 + std::sin(angle(tick))) - 1e-3;
  };
  run.session.hand = std::make_shared<support::DrivenHand>(
      hand, [place_m](const support::DrivenHand::View& v) { return place_m(static_cast<double>(v.tick)); });
  support::WallSlaveConfig wall;  // 50 N/m · 1e-6 · 2e7 = 1000 N/m of the hand's
  wall.stiffness_n_m = kWallN_m / 20;
  run.session.make_slave = run.make_truth = [wall] { return std::make_unique<support::WallSlave>(wall); };
  run.session.station.method = method;
  run.session.station.allow_unsafe_scaling = true;
  run.session.link_options.reply_deadband = {.permille = reply_permille, .adapts = false, .floor_n = 0};
  run.session.to_server.delay_ns = run.session.to_station.delay_ns = std::llround(0.5e6 * rtt_ms);
  run.ticks_max = 5000;
  TouchOutcome outcome = run_touch(run);
  // Whole periods, after everything has come in.
  auto& rows = outcome.trace.rows;
  rows.erase(rows.begin(), rows.end() - static_cast<std::ptrdiff_t>(kTicks));
  return outcome;
}

// `none` shows the newest answer: of the command that left a round trip ago, or in the last tick where there
// is no delay. On a wall that is touched all the time, depth D + A sin, its error has the RMS A √2 sin φ/2,
// of √(D² + A²/2): closed form, no other code of ours. What the wire's doubles leave is below 1e-6.
TEST(FidelityOnAWall, NoneOverADelayIsTheTruthSoMuchLater) {
  for (const int rtt_ms : {0, 20, 100}) {
    const FeltMetrics m = measure(on_a_wall(control::Method::kNone, rtt_ms).trace, 0.3);
    const double phi = angle(std::max(rtt_ms, 1));
    const double mean_m = kAmplitudeM + 1e-3;
    const double rms2_m2 = mean_m * mean_m + 0.5 * kAmplitudeM * kAmplitudeM;
    EXPECT_NEAR(m.true_rms_n, kWallN_m * std::sqrt(rms2_m2), 1e-6) << rtt_ms;
    const double error2_m2 = 2 * kAmplitudeM * kAmplitudeM * std::sin(phi / 2) * std::sin(phi / 2);
    EXPECT_NEAR(m.nrmse, std::sqrt(error2_m2 / rms2_m2), 1e-6) << rtt_ms;
    EXPECT_EQ(m.lag_ms, std::max(rtt_ms, 1));
    EXPECT_LT(m.nrmse_at_lag, 1e-6) << rtt_ms;
  }
}

// The station's own model of this wall, learnt at the first touch, is the wall. What is left is the damper
// that pays for the sampling of the spring: γ v ≤ K T v/2 of K A, an angle of half a tick, 0.006, and twice
// that while it catches up.
// What is held is within the deadband of the last force sent, so of the true one within p/(1 − p) of it.
TEST(FidelityOnAWall, ADeadbandOfRepliesCostsNoMoreThanItself) {
  EXPECT_EQ(on_a_wall(control::Method::kNone, 0).left_out_share, 0);
  for (const double permille : {20.0, 100.0, 300.0}) {
    const TouchOutcome run = on_a_wall(control::Method::kNone, 0, permille);
    const FeltMetrics m = measure(run.trace, 0.3);
    const double exact = measure(on_a_wall(control::Method::kNone, 0).trace, 0.3).nrmse;
    const double p = 1e-3 * permille;
    std::printf("%.0f per mille: %.0f %% of the replies left out, NRMSE %.4f instead of %.4f\n", permille,
                100 * run.left_out_share, m.nrmse, exact);
    EXPECT_LE(m.nrmse, exact + p / (1 - p));
    EXPECT_GT(m.nrmse, exact);
    EXPECT_GT(run.left_out_share, permille < 50 ? 0.3 : 0.7);
    EXPECT_LT(run.left_out_share, 5.0 / 6 + 0.01) << "6 ms";
  }
}

TEST(FidelityOnAWall, AModelOfAPlaneIsTheTruthAtAnyDelay) {
  const FeltMetrics m = measure(on_a_wall(control::Method::kModel, 100).trace, 0.3);
  EXPECT_LT(m.nrmse, 0.02);
  EXPECT_LE(std::fabs(m.lag_ms), 1);
}

TEST(FidelityMotions, EverySceneThatComesWithTheProjectHasOne) {
  std::set<std::string> with;
  for (const SceneMotion& m : scene_motions()) with.insert(m.scene);
  for (const std::string& name : config::shared_names("scenes", ".toml"))
    EXPECT_TRUE(with.contains(name)) << name;
}

TEST(FidelityMotions, AnUnknownNameIsSaidWithTheKnownOnes) {
  try {
    chosen_motions({"moon"}, false);
    FAIL() << "not refused";
  } catch (const UserError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("moon"));
    EXPECT_THAT(error.what(), testing::HasSubstr("flakes/raster"));
  }
}

// What nobody would find out by energy alone; and the sample itself is found right.
TEST(FidelitySensitivity, EveryWrongRendererBreaksARule) {
  const ScenePairs scenes(chosen_motions(telling_motions(), false));
  const std::vector<SensitivityRow> rows = check_sensitivity(scenes);
  ASSERT_EQ(rows.size(), kWrongRenderers.size() + 1);
  EXPECT_THAT(rows.front().rules, testing::IsEmpty()) << sensitivity_csv(rows);
  EXPECT_LT(rows.front().nrmse, 1e-6);
  EXPECT_EQ(rows.front().stress, 0u) << sensitivity_csv(rows);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    EXPECT_THAT(rows[i].rules, testing::Not(testing::IsEmpty())) << wrong_renderer_name(rows[i].wrong);
    EXPECT_NE(rows[i].stress, 0u) << wrong_renderer_name(rows[i].wrong) << " goes unseen under stress";
  }
}

}  // namespace
}  // namespace telenano::studies::fidelity
