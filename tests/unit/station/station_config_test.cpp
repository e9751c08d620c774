#include "telenano/master/station/station_config.h"

#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/base/error.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

std::string refusal(const StationConfig& config) {
  try {
    config.validate("station.toml");
  } catch (const UserError& error) {
    return error.what();
  }
  return "";
}

TEST(StationConfig, DefaultsAreValid) {
  EXPECT_EQ(refusal({}), "");
}

TEST(StationConfig, NamesSourceKeyValueAndRange) {
  StationConfig config;
  config.rate_hz = 9000;
  EXPECT_EQ(refusal(config), "station.toml: rate_hz = 9000, expected 10 to 8000");
  config = {};
  config.trip_velocity_m_s = 0.6;
  EXPECT_EQ(
      refusal(config),
      "station.toml: limits.trip_velocity_m_s = 0.6, expected 0.01 to control.guaranteed_velocity_m_s = 0.5");
}

TEST(StationConfig, RefusesEveryBadValue) {
  const double bad[] = {NAN, INFINITY, -INFINITY, -1.0, 1e30};
  double StationConfig::*const fields[] = {&StationConfig::rate_hz,
                                           &StationConfig::allowance_j,
                                           &StationConfig::guaranteed_velocity_m_s,
                                           &StationConfig::trip_velocity_m_s,
                                           &StationConfig::force_safety,
                                           &StationConfig::slew_n_s,
                                           &StationConfig::stale_hold_s,
                                           &StationConfig::stale_zero_s,
                                           &StationConfig::force_age_s,
                                           &StationConfig::engage_ramp_s};
  for (double value : bad) {
    for (auto field : fields) {
      StationConfig config;
      config.*field = value;
      EXPECT_NE(refusal(config), "") << value;
    }
    StationConfig config;
    config.scaling.force = value;
    EXPECT_NE(refusal(config), "");
    config = {};
    config.scaling.velocity = value;
    EXPECT_NE(refusal(config), "");
  }
  StationConfig config;
  config.device_damping_n_s_m = NAN;
  EXPECT_NE(refusal(config), "");
  config = {};
  config.store_max_j = 0;
  EXPECT_NE(refusal(config), "");
  config = {};
  config.leak_time_s = -1;
  EXPECT_NE(refusal(config), "");
}

TEST(CheckScaling, RefusesBeyondTheExactBoundAndSaysWhatWouldDo) {
  StationConfig config;  // α_v α_F = 20
  config.method = control::Method::kNone;
  const auto device = StationRig::device();
  const SlavePort slave{40, 0, 500};
  const ScalingCheck near = check_scaling(config, device, slave, 0);
  EXPECT_NEAR(near.exact_bound, 100, 1e-9);      // b/(k_c T/2)
  EXPECT_NEAR(near.llewellyn_bound, 400, 1e-6);  // 8b/(k_c T)
  EXPECT_NEAR(near.shown_stiffness_n_m, 800, 1e-9);
  EXPECT_NEAR(near.device_force_scale, 0.8 * 12 / 500e-9, 1);
  EXPECT_TRUE(near.safe);
  EXPECT_TRUE(near.saturates);
  const ScalingCheck far = check_scaling(config, device, slave, 4);
  EXPECT_NEAR(far.exact_bound, 4, 1e-6);  // 2b/((d+1)² T k_c)
  EXPECT_FALSE(far.safe);
  EXPECT_NE(far.advice.find("--allow-unsafe-scaling"), std::string::npos);
  EXPECT_NE(far.advice.find("3.998e+06"), std::string::npos)
      << far.advice;  // just below 4e6, the α_F that is safe
  EXPECT_EQ(near.advice, "");
  EXPECT_EQ(far.text.find('\n'), std::string::npos);
}

// What the delay of the way does to a method that bounds its energy is told, not refused; the sampling at the
// hand, one tick, is. k_c = 40 N/m: 2b/((d+1)² T k_c) = 25 at one tick, 4 at d = 4.
TEST(CheckScaling, TheDelayOfTheWayBindsOnlyMethodsThatRestOnTheLoop) {
  const auto device = StationRig::device();
  const SlavePort slave{40, 0, 500};
  StationConfig config;
  for (const auto method :
       {control::Method::kNone, control::Method::kKs, control::Method::kKsClamp, control::Method::kTdpa,
        control::Method::kWave, control::Method::kTank, control::Method::kModel}) {
    config.method = method;
    const bool rests = method == control::Method::kNone || method == control::Method::kKs;
    config.scaling.force = 2e7;  // α_v α_F = 20
    const ScalingCheck check = check_scaling(config, device, slave, 4);
    EXPECT_NEAR(check.exact_bound, rests ? 4 : 25, 1e-6);
    EXPECT_NEAR(check.loop_bound, 4, 1e-6);
    EXPECT_EQ(check.safe, !rests);
    EXPECT_EQ(check.note.empty(), rests);
    if (!rests) {
      EXPECT_NE(check.note.find("4 samples of delay"), std::string::npos) << check.note;
      EXPECT_NE(check.note.find(control::method_name(method)), std::string::npos) << check.note;
    }
    config.scaling.force = 2.6e7;
    EXPECT_FALSE(check_scaling(config, device, slave, 4).safe);
    config.scaling.force = 3.9e6;
    EXPECT_TRUE(check_scaling(config, device, slave, 4).safe);
    EXPECT_EQ(check_scaling(config, device, slave, 4).note, "");
  }
}

TEST(CheckScaling, WithoutDampingOfTheDeviceNothingIsSafe) {
  StationConfig config;
  config.device_damping_n_s_m = 0;
  const ScalingCheck check = check_scaling(config, StationRig::device(), {40, 0, 500}, 1);
  EXPECT_FALSE(check.safe);
  EXPECT_NE(check.advice.find("no scaling is safe without damping"), std::string::npos) << check.advice;
  EXPECT_NE(check.advice.find("--allow-unsafe-scaling"), std::string::npos) << check.advice;
}

}  // namespace
}  // namespace telenano::station
