// The simulated rig as its protocol's document says that such a controller behaves.
#include "telenano/nve_server/afm_sim/sim_controller.h"

#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "telenano/nve_server/afm_sim/sim_faults.h"

namespace telenano::afm_sim {
namespace {

using enum nanonis::CommandId;
using nanonis::ZStatus;

constexpr std::int64_t kMs = 1'000'000;

SimConfig quiet() {
  SimConfig config;
  config.drift_x_nm_s = config.drift_y_nm_s = config.drift_z_nm_s = 0;
  config.creep = 0;
  config.thermal_nm = 0;
  config.noise_nm_sqrt_hz = config.lateral_noise_nn_sqrt_hz = 0;
  return config;
}

struct Rig {
  SimController controller;
  std::int64_t now_ns = 0;
  std::int64_t took_ns = 0;

  explicit Rig(const SimConfig& config = quiet()) : controller(config, default_scene()) {}
  nanonis::Answer call(nanonis::CommandId id, std::vector<double> numbers = {}, int port = -1) {
    const std::int64_t begin = now_ns;
    auto pending = controller.begin({id, std::move(numbers)}, port, now_ns);
    while (!controller.finish(pending, now_ns)) now_ns += 100'000;
    took_ns = now_ns - begin;
    return pending.answer;
  }
  void wait(std::int64_t ns) { controller.advance_to(now_ns += ns); }
  void touch() {
    call(kOnOffSet, {1});
    wait(2500 * kMs);
  }
};

TEST(SimController, ZPosSetWorksOnlyWithTheControllerOffAndOffComesLate) {
  Rig rig;
  rig.touch();
  EXPECT_EQ(rig.call(kStatusGet).numbers[0], static_cast<double>(ZStatus::kOn));
  EXPECT_NE(rig.call(kZPosSet, {1e-7}).error, 0u);
  rig.call(kTipLiftSet, {20e-9});
  rig.call(kSwitchOffDelaySet, {0.05});
  const double before = rig.controller.height_nm();
  rig.call(kOnOffSet, {0});
  EXPECT_EQ(rig.call(kOnOffGet).numbers[0], 1) << "not yet";
  EXPECT_NE(rig.call(kZPosSet, {1e-7}).error, 0u);
  rig.wait(60 * kMs);
  EXPECT_EQ(rig.call(kOnOffGet).numbers[0], 0);
  EXPECT_NEAR(rig.controller.height_nm(), before + 20, 0.5)
      << "lifted; the feedback moves a little meanwhile";
  EXPECT_EQ(rig.call(kZPosSet, {1e-7}).error, 0u);
  EXPECT_NEAR(rig.call(kZPosGet).numbers[0], 1e-7, 1e-13);
}

TEST(SimController, TheFeedbackRestsAtItsSetPoint) {
  Rig rig;
  rig.touch();
  // F(z) rises: the integral rests only where the error is 0; a step of 0.5 ms leaves a millionth of it.
  EXPECT_NEAR(rig.controller.tip().force_w_nn().z(), rig.controller.config().setpoint_nn, 1e-3);
}

TEST(SimController, TheForceIsTheLeversDeflection) {
  Rig rig;
  rig.touch();
  const double value = rig.call(kSignalValGet, {kDeflectionSignal, 1}).numbers[0];
  const auto& config = rig.controller.config();
  // 40 N/m of the default scene; a float32 has 24 bits on the wire, not here.
  EXPECT_NEAR(value, 1e-9 * (config.setpoint_nn / 40 + config.deflection_offset_nm), 1e-13);
  const auto calibration = rig.call(kSignalCalibrGet, {kDeflectionSignal}).numbers;
  EXPECT_NEAR(calibration[0], 50e-9, 1e-18);
}

TEST(SimController, AValueComesAfterNoneToOnePeriodOrOneToTwo) {
  Rig rig;
  rig.call(kAcqPeriodSet, {0.05});
  std::int64_t least[2] = {INT64_MAX, INT64_MAX}, most[2] = {0, 0};
  for (int i = 0; i < 200; ++i) {
    rig.wait((i * 7) % 50 * kMs);  // anywhere in a period
    const int newest = i % 2;
    rig.call(kSignalValsGet, {kDeflectionSignal, kLateralSignal, 1.0 * newest});
    least[newest] = std::min(least[newest], rig.took_ns);
    most[newest] = std::max(most[newest], rig.took_ns);
  }
  // Besides up to 1.2 ms of latency, in steps of 0.1 ms.
  EXPECT_LT(least[0], 10 * kMs);
  EXPECT_GT(most[0], 40 * kMs);
  EXPECT_LT(most[0], 52 * kMs);
  EXPECT_GE(least[1], 50 * kMs);
  EXPECT_LT(most[1], 102 * kMs);
}

TEST(SimController, NoiseOfAnAverageFallsWithTheRootOfItsTime) {
  for (const double period_s : {0.005, 0.05}) {
    SimConfig config = quiet();
    config.noise_nm_sqrt_hz = 1e-3;
    Rig rig(config);
    rig.call(kAcqPeriodSet, {period_s});
    double sum = 0, squares = 0;
    const int n = 400;
    for (int i = 0; i < n; ++i) {
      const double nm =
          1e9 * rig.call(kSignalValGet, {kDeflectionSignal, 0}).numbers[0] - config.deflection_offset_nm;
      sum += nm;
      squares += nm * nm;
    }
    const double sigma = 1e-3 * std::sqrt(0.5 / period_s);
    EXPECT_NEAR(std::sqrt(squares / n), sigma, 4 * sigma / std::sqrt(2.0 * n)) << "four standard errors";
    EXPECT_NEAR(sum / n, 0, 4 * sigma / std::sqrt(1.0 * n));
  }
}

TEST(SimController, AWithdrawalThatIsNotCarriedOutIsAnsweredAllTheSame) {
  Rig rig(quiet());
  rig.touch();
  const double touch_nm = rig.controller.height_nm();
  rig.controller.set_withdraw_fault(WithdrawFault::kUndone, 2);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(rig.call(kWithdraw, {1, 2000}).error, 0u);
    EXPECT_EQ(rig.controller.height_nm(), touch_nm);
  }
  rig.controller.set_withdraw_fault(WithdrawFault::kHalf, -1);
  for (const double part : {0.5, 0.75}) {
    EXPECT_EQ(rig.call(kWithdraw, {1, 2000}).error, 0u);
    EXPECT_NEAR(rig.controller.height_nm(), touch_nm + part * (500 - touch_nm), 0.01);
    EXPECT_EQ(rig.controller.status(), nanonis::ZStatus::kOff);
  }
  rig.controller.set_withdraw_fault(WithdrawFault::kHalf, 0);
  rig.call(kWithdraw, {1, 2000});
  EXPECT_TRUE(rig.controller.withdrawn());
}

TEST(SimController, WithdrawRetractsToTheUpperLimitAtItsRate) {
  for (const int sign : {1, -1}) {
    SimConfig config = quiet();
    config.z_sign = sign;
    Rig rig(config);
    rig.touch();
    rig.call(kWithdrawRateSet, {5e-6});
    rig.call(kLimitsEnabledSet, {1});
    rig.call(kLimitsSet,
             sign > 0 ? std::vector<double>{250e-9, -500e-9} : std::vector<double>{500e-9, -250e-9});
    const double way = 250 - rig.controller.height_nm();
    rig.call(kWithdraw, {1, -1});
    EXPECT_NEAR(1e-9 * static_cast<double>(rig.took_ns), way / 5000, 2e-3);
    EXPECT_NEAR(rig.call(kZPosGet).numbers[0], sign * 250e-9, 1e-12);
    EXPECT_EQ(rig.call(kStatusGet).numbers[0], static_cast<double>(ZStatus::kOff));
  }
}

TEST(SimController, ThePiezosRangeAndItsLimitsHold) {
  Rig rig;
  EXPECT_NE(rig.call(kZPosSet, {501e-9}).error, 0u);
  EXPECT_NE(rig.call(kXyPosSet, {5001e-9, 0, 0}).error, 0u);
  EXPECT_NE(rig.call(kLimitsSet, {-1e-9, 1e-9}).error, 0u);
  EXPECT_NE(rig.call(kSignalValGet, {kSignalCount, 0}).error, 0u);
  const auto range = rig.call(kPiezoRangeGet).numbers;
  ASSERT_EQ(range.size(), 3u);
  EXPECT_NEAR(range[0], 1e-5, 1e-15);
  EXPECT_NEAR(range[2], 1e-6, 1e-15);
}

TEST(SimController, LimitsCountOnlyWhileTheyAreOnAndAFloorHoldsALateCommand) {
  for (const int sign : {1, -1}) {
    SimConfig config = quiet();
    config.z_sign = sign;
    Rig rig(config);
    rig.call(kLimitsSet, {1e-9, -1e-9});
    EXPECT_EQ(rig.call(kLimitsEnabledGet).numbers[0], 0);
    EXPECT_NEAR(rig.call(kLimitsGet).numbers[0], 0.5e-6, 1e-15) << "they were off";
    EXPECT_NEAR(rig.call(kLimitsGet).numbers[1], -0.5e-6, 1e-15);
    rig.call(kLimitsEnabledSet, {1});
    // The floor: with Z towards the sample it is the high limit.
    const double high = sign > 0 ? 500e-9 : -499e-9, low = sign > 0 ? 499e-9 : -500e-9;
    rig.call(kLimitsSet, {high, low});
    EXPECT_EQ(rig.call(kLimitsEnabledGet).numbers[0], 1);
    EXPECT_EQ(rig.call(kLimitsGet).numbers, (std::vector<double>{high, low}));
    EXPECT_NE(rig.call(kZPosSet, {0}).error, 0u);
    EXPECT_TRUE(rig.controller.withdrawn());
  }
}

TEST(SimController, SettingsAreReadAsTheyWereSet) {
  Rig rig;
  rig.call(kAcqPeriodSet, {0.02});
  rig.call(kWithdrawRateSet, {3e-6});
  rig.call(kTipLiftSet, {2e-8});
  rig.call(kSwitchOffDelaySet, {0.05});
  EXPECT_NEAR(rig.call(kAcqPeriodGet).numbers[0], 0.02, 1e-9);
  EXPECT_NEAR(rig.call(kWithdrawRateGet).numbers[0], 3e-6, 1e-12);
  EXPECT_NEAR(rig.call(kTipLiftGet).numbers[0], 2e-8, 1e-15);
  EXPECT_NEAR(rig.call(kSwitchOffDelayGet).numbers[0], 0.05, 1e-9);
}

TEST(SimController, SafeTipSaysTheValueOfWhatItWatches) {
  for (const auto& [signal, value] :
       {std::pair{kDeflectionSignal, 1.5e-9}, std::pair{-kDeflectionSignal, -1.5e-9},
        std::pair{kZSignal, 5e-7}, std::pair{kLateralSignal, 0.0}}) {
    SimConfig config = quiet();
    config.safe_tip_signal = signal;
    EXPECT_NEAR(Rig(config).call(kSafeTipSignalGet).numbers[0], value, 1e-12) << signal;
  }
}

TEST(SimController, SensorFaultsAreSeenByTheSignalsAndNotByTheTip) {
  Rig rig;
  rig.touch();
  const auto reading = [&] {
    rig.wait(20 * kMs);
    return rig.call(kSignalValGet, {kDeflectionSignal, 1}).numbers[0];
  };
  const double good = reading(), free = 1.5e-9;
  ASSERT_NEAR(good, free + 1e-9 * 15 / 40, 1e-11);
  rig.call(kOnOffSet, {0});
  rig.wait(50 * kMs);
  rig.controller.set_sensor_fault(SensorFault::kInverted);
  EXPECT_NEAR(reading(), 2 * free - good, 2e-11);
  rig.controller.set_sensor_fault(SensorFault::kHighEnd);
  EXPECT_NEAR(reading(), 10 * 50e-9, 1e-12);
  rig.controller.set_sensor_fault(SensorFault::kLowEnd);
  EXPECT_NEAR(reading(), -10 * 50e-9, 1e-12);
  rig.controller.set_sensor_fault(SensorFault::kFrozen);
  const double frozen = reading();
  rig.call(kWithdraw, {1, -1});
  EXPECT_EQ(reading(), frozen);
  rig.controller.set_sensor_fault(SensorFault::kNone);
  EXPECT_NEAR(reading(), free, 1e-11);
}

TEST(SimController, ADipIsInTheSignalForItsTimeAndNotInTheTip) {
  Rig rig;
  const double free = 1.5e-9;
  rig.wait(2 * kMs);  // between two ends of an average of 5 ms
  rig.controller.dip(8, 12 * kMs);
  const double force_nn = rig.controller.tip().normal_force_nn();
  // Of the averages that end next: 3 of 5 ms in it, all of the next, 4 ms of the third.
  for (const double part : {0.6, 1.0, 0.8, 0.0}) {
    EXPECT_NEAR(rig.call(kSignalValGet, {kDeflectionSignal, 0}).numbers[0], free - 8e-9 * part, 1e-11);
    rig.wait(kMs / 2);
  }
  EXPECT_EQ(rig.controller.tip().normal_force_nn(), force_nn);
}

TEST(SimController, AConverterOf16BitsRoundsToItsSteps) {
  SimConfig config = quiet();
  config.noise_nm_sqrt_hz = 5e-3;
  config.quantum_v = 20.0 / 65536;
  Rig rig(config);
  for (int i = 0; i < 50; ++i) {
    rig.wait(7 * kMs);
    const double steps =
        rig.call(kSignalValGet, {kDeflectionSignal, 0}).numbers[0] / (50e-9 * config.quantum_v);
    EXPECT_NEAR(steps, std::round(steps), 1e-6);
  }
}

TEST(SimController, SafeTipWithdrawsByItself) {
  Rig rig;
  rig.touch();
  rig.call(kSafeTipPropsSet, {0, 0, 1e-9 * (1.5 + 100.0 / 40)});  // 100 nN
  rig.call(kSafeTipOnOffSet, {1});
  rig.call(kTipLiftSet, {0});
  rig.call(kOnOffSet, {0});
  rig.wait(50 * kMs);
  const double z = rig.call(kZPosGet).numbers[0];
  rig.call(kZPosSet, {z - 10e-9});
  rig.wait(kMs);
  EXPECT_EQ(rig.controller.status(), ZStatus::kSafeTip);
  rig.wait(200 * kMs);
  EXPECT_TRUE(rig.controller.withdrawn());
  EXPECT_EQ(rig.controller.safe_tips(), 1u);
}

TEST(SimController, DriftAndCreepAreWhatTheySay) {
  SimConfig config = quiet();
  config.drift_z_nm_s = -0.5;
  config.creep = 0.01;
  Rig rig(config);
  const double z0 = rig.controller.tip().base_w_nm().z();
  rig.call(kZPosSet, {300e-9});  // 200 nm down
  rig.wait(10'000 * kMs);
  const double t = 1e-9 * static_cast<double>(rig.now_ns);
  // y follows an exponential of 20 s: of the 200 nm, 1 % · exp(−10/20) is still to come after ten seconds.
  EXPECT_NEAR(rig.controller.tip().base_w_nm().z() - z0, -200 + 2 * std::exp(-10.0 / 20) - 0.5 * t, 5e-3);
}

TEST(SimController, ACopyGoesOnAlike) {
  Rig rig{SimConfig{}};
  rig.touch();
  Rig other = rig;
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(rig.call(kSignalValGet, {kDeflectionSignal, 0}).numbers,
              other.call(kSignalValGet, {kDeflectionSignal, 0}).numbers);
  }
  EXPECT_EQ(rig.controller.tip().work_aj(), other.controller.tip().work_aj());
}

TEST(SimFaults, WhatAPersonWrites) {
  const Fault fault = parse_fault("@1.5s slow 2s 50ms", "--fault");
  EXPECT_EQ(fault.at_ns, 1'500'000'000);
  EXPECT_EQ(fault.kind, FaultKind::kSlow);
  EXPECT_EQ(fault.length_ns, 2'000'000'000);
  EXPECT_EQ(fault.delay_ns, 50'000'000);
  EXPECT_EQ(parse_fault("reset", "--fault").kind, FaultKind::kReset);
  EXPECT_EQ(parse_fault("withdraw half 3", "--fault").withdraw, WithdrawFault::kHalf);
  EXPECT_EQ(parse_fault("withdraw half 3", "--fault").count, 3);
  EXPECT_LT(parse_fault("withdraw undone ever", "--fault").count, 0);
  const Fault dip = parse_fault("dip -0.5nm 12ms", "--fault");
  EXPECT_EQ(dip.kind, FaultKind::kDip);
  EXPECT_EQ(dip.depth_nm, -0.5);
  EXPECT_EQ(dip.length_ns, 12'000'000);
  for (const char* bad : {"", "@", "silent", "silent 5", "silent -1s", "silent 1s 2s", "loud 1s", "@x reset",
                          "slow 1s", "dip 8 12ms", "dip 12ms", "dip 8nm 12", "dip nannm 1s"})
    EXPECT_THROW(parse_fault(bad, "--fault"), UserError) << bad;
  for (const char* bad : {"withdraw", "withdraw 3", "withdraw half", "withdraw half -3", "withdraw half 3x",
                          "withdraw undone 1001", "withdraw undone 99999999999"})
    EXPECT_THROW(parse_fault(bad, "--fault"), UserError) << bad;
}

}  // namespace
}  // namespace telenano::afm_sim
