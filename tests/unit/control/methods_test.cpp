#include "telenano/common/control/methods.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace telenano::control {
namespace {

constexpr double kT = 1e-3;

MethodConfig config_of(double damping_n_s_m = 2) {
  MethodConfig config;
  config.passivity.damping_certain_n_s_m = damping_n_s_m;
  return config;
}

PortInterval interval(const Vec3& force_n, const Vec3& moved_m) {
  PortInterval i;
  i.applied_force_h_n = force_n;
  i.displacement_h_m = moved_m;
  i.put_in_j = -force_n.dot(moved_m);
  i.dt_s = kT;
  return i;
}

TEST(TwoPort, SplitsByDirectionAndComparesWithWhatCame) {
  TwoPort port(config_of());
  SlaveOrder order;
  port.account_for(interval(Vec3(-3, 0, 0), Vec3(1e-3, 0, 0)));  // the hand puts in 3 mJ
  port.fill_command(order);
  EXPECT_NEAR(order.energy_sent_j, 3e-3, 1e-18);
  EXPECT_EQ(port.account_j(), 0);  // own input is no budget for own output
  SlaveNews news;
  news.energy_out_j = 2e-3;
  port.on_reply(news);
  port.account_for(interval(Vec3(-2.5, 0, 0), Vec3(-1e-3, 0, 0)));  // 2.5 mJ go out, 2 mJ had come
  EXPECT_NEAR(port.account_j(), -0.5e-3, 1e-15);
  EXPECT_NEAR(port.damper_n_s_m(), std::min(0.5e-3 * kT / 1e-6, 2.0), 1e-12);
  EXPECT_GT(port.damper_force_h_n().x(), 0);  // against the motion
  port.fill_command(order);
  EXPECT_NEAR(order.energy_sent_j, 3e-3, 1e-18);  // output is never sent
}

TEST(TwoPort, ANewSlaveOwesNothingOfTheOldOnesAndForgivesNothing) {
  TwoPort port(config_of());
  SlaveNews news;
  news.energy_out_j = 2e-3;
  port.on_reply(news);
  port.begin_session(false);  // the same slave: what it gave back is still there
  EXPECT_NEAR(port.account_j(), 2e-3, 1e-18);
  port.begin_session(true);
  EXPECT_EQ(port.account_j(), 0);
  port.account_for(interval(Vec3(3, 0, 0), Vec3(1e-3, 0, 0)));
  port.begin_session(true);
  EXPECT_NEAR(port.account_j(), -3e-3, 1e-18);
}

TEST(TwoPort, WhatTheDamperTakesRepaysAndIsNoInput) {
  TwoPort port(config_of());
  port.account_for(interval(Vec3(4, 0, 0), Vec3(1e-3, 0, 0)));  // 4 mJ out of nothing
  const Vec3 damper_n = port.damper_force_h_n();
  ASSERT_NEAR(damper_n.x(), -2, 1e-12);  // capped at b = 2 N·s/m, 1 m/s
  port.account_for(interval(damper_n, Vec3(1e-3, 0, 0)));
  SlaveOrder order;
  port.fill_command(order);
  EXPECT_EQ(order.energy_sent_j, 0);
  EXPECT_NEAR(port.account_j(), -4e-3 + 2e-3, 1e-15);
}

TEST(Tank, EnergyIsConserved) {
  TwoLayerTank tank(config_of(0));  // no damping: no credit
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  long double account_j = 0;
  SlaveOrder order;
  for (int k = 0; k < 20'000; ++k) {
    const PortInterval i = interval(3 * Vec3(normal(random), normal(random), normal(random)),
                                    1e-4 * Vec3(normal(random), normal(random), normal(random)));
    tank.account_for(i);
    account_j += static_cast<long double>(i.put_in_j);
    SlaveNews news;
    news.energy_sent_j = 1e-4 * std::fabs(normal(random));
    news.well_j = 1e9;  // whatever comes is believed here
    tank.on_reply(news);
    account_j += static_cast<long double>(news.energy_sent_j);
    tank.fill_command(order);
    // 4e4 additions of less than a millijoule: rounding below 1e-14.
    // The slave's first allowance, 8 mJ, is in what was sent and never was in the account.
    ASSERT_NEAR(tank.account_j() + order.energy_sent_j - 7e-3, static_cast<double>(account_j), 1e-13);
  }
}

// A server that lies: it gives energy that nobody has sent to it and that its sample cannot have. Believed is
// what was sent, the grant of 8 mJ besides, and the well, once.
TEST(Tank, NoMoreIsBelievedThanWasSentAndTheWellHolds) {
  for (const double well_j : {0.0, 3e-3}) {
    TwoLayerTank tank(config_of(0));
    SlaveNews news;
    news.well_j = well_j;
    tank.on_reply(news);  // the grant goes out
    news.energy_sent_j = 5e-3;
    for (int k = 0; k < 100; ++k) tank.on_reply(news);
    EXPECT_NEAR(tank.account_j(), 7e-3 + well_j, 1e-15);
    EXPECT_NEAR(tank.credited_j(), 7e-3 + well_j, 1e-15);
    tank.begin_session(true);  // another slave has no well of its own on top
    for (int k = 0; k < 100; ++k) tank.on_reply(news);
    EXPECT_NEAR(tank.account_j(), 7e-3 + well_j, 1e-15);
    tank.account_for(interval(Vec3(-2, 0, 0), Vec3(1e-3, 0, 0)));  // the hand puts in 2 mJ, which are sent
    EXPECT_NEAR(tank.account_j(), 7e-3 + well_j, 1e-15);
    for (int k = 0; k < 100; ++k) tank.on_reply(news);
    EXPECT_NEAR(tank.account_j(), 9e-3 + well_j, 1e-15) << "and may come back";
  }
}

// Snapped in the sample has given the hand 4 mJ: no leak of the link. Pulled off and snapped in again: once.
TEST(ModelMethod, TheSamplesOwnEnergyIsCreditedOnce) {
  ModelMethod model(config_of(0));
  SlaveNews news;
  news.well_j = 5e-3;
  news.given_j = 4e-3;
  model.on_reply(news);
  EXPECT_NEAR(model.account_j(), 4e-3, 1e-18);
  model.account_for(interval(Vec3(4, 0, 0), Vec3(1e-3, 0, 0)));
  EXPECT_NEAR(model.account_j(), 0, 1e-18);
  for (int k = 0; k < 10; ++k) {
    model.begin_session(true);
    model.on_reply(news);
  }
  EXPECT_NEAR(model.account_j(), 0, 1e-18);
  news.given_j = 1;  // more than it can have
  model.on_reply(news);
  EXPECT_NEAR(model.account_j(), 1e-3, 1e-15);
  news = {};
  model.on_reply(news);  // a slave that says nothing of a well
  EXPECT_NEAR(model.account_j(), 1e-3, 1e-15);
}

// Round all methods and back, with a lie after every change: the well is granted to one of them, once. What a
// change forfeits may come again, what was taken may not.
TEST(Methods, NoRoundOfChangesGrantsTheWellTwice) {
  const MethodConfig config = config_of(0);
  for (const bool taken : {false, true}) {
    Methods methods(Method::kModel, config);
    SlaveNews lie;
    lie.well_j = lie.given_j = 5e-3;
    lie.energy_sent_j = 1;
    double out_j = 0;
    for (int round = 0; round < 20; ++round) {
      for (const Method method : kAllMethods) {
        methods.change_to(method, config, Vec3::Zero());
        for (int k = 0; k < 3; ++k) methods.now().on_reply(lie);
        if (!taken || !claims_energy_bound(method)) continue;
        // A hand takes all that the clamp lets it have.
        const double may_j = config.passivity.allowance_j + methods.now().account_j();
        if (may_j > 0) methods.now().account_for(interval(Vec3(may_j / 1e-3, 0, 0), Vec3(1e-3, 0, 0)));
        out_j += std::max(0.0, may_j);
      }
    }
    // 10 mJ at the station, of which the tank grants the slave 8 mJ, which a lying one sends back; the well.
    EXPECT_LE(out_j, 10e-3 + 8e-3 + 5e-3 + 1e-12);
    if (taken) {
      EXPECT_GE(out_j, 15e-3 - 1e-12);
    }
    methods.change_to(Method::kModel, config, Vec3::Zero());
    methods.now().on_reply(lie);
    EXPECT_LE(methods.now().account_j(), 5e-3 + 1e-12);
    if (!taken) {
      EXPECT_GE(methods.now().account_j(), 5e-3 - 1e-12) << "forfeited, it may come again";
    }
  }
}

// The sums of waves are the tip's: what was sent at one scale stands there at another, to rounding.
TEST(Wave, AnotherScaleLeavesTheSumsAtTheTipWhatTheyAre) {
  MethodConfig config = config_of(2);
  config.scaling = {1e-6, 2e7};
  WavePort port(config);
  for (int k = 0; k < 10; ++k) port.account_for(interval(Vec3(-3, 1, 0), Vec3(1e-3, 0, 2e-4)));
  SlaveOrder before, after;
  port.fill_command(before);
  MethodConfig other = config;
  other.scaling = {2e-7, 1e8};
  port.take_over(port.account_j(), other, Vec3::Zero());
  port.fill_command(after);
  const double from = config.scaling.tip_energy_aj(1), to = other.scaling.tip_energy_aj(1);
  ASSERT_GT(before.wave_j, 1e-3);
  EXPECT_NEAR(after.wave_j * to, before.wave_j * from, 1e-12 * before.wave_j * from);
  EXPECT_LT((after.wave_sum_h * std::sqrt(to) - before.wave_sum_h * std::sqrt(from)).norm(),
            1e-12 * before.wave_sum_h.norm() * std::sqrt(from));
}

TEST(Tank, NothingIsSentThatItHasNotGot) {
  TwoLayerTank tank(config_of(0));
  tank.account_for(interval(Vec3(5, 0, 0), Vec3(1e-3, 0, 0)));   // −5 mJ
  tank.account_for(interval(Vec3(-3, 0, 0), Vec3(1e-3, 0, 0)));  // +3 mJ: still in debt
  SlaveOrder order;
  tank.fill_command(order);
  EXPECT_EQ(order.energy_sent_j, 0);
  tank.account_for(interval(Vec3(-3, 0, 0), Vec3(1e-3, 0, 0)));  // +3 mJ: 1 mJ there
  tank.fill_command(order);
  EXPECT_NEAR(order.energy_sent_j, 1e-3, 1e-15);
}

TEST(Wave, NoMoreLeavesThanWasPutInAndCame) {
  for (double damping : {0.0, 0.5, 2.0}) {
    WavePort port(config_of(damping));
    std::mt19937_64 random(7);
    std::normal_distribution<double> normal;
    long double in_j = 0;
    SlaveOrder order;
    Vec3 force_n = Vec3::Zero();
    for (int k = 0; k < 20'000; ++k) {
      SlaveNews news;
      const Vec3 wave(normal(random), normal(random), normal(random));
      if (k % 3 != 0) {  // every third is lost
        news.wave_h = wave * kT;
        news.wave_j = 0.5 * wave.squaredNorm() * kT;
      }
      const PortInterval i = interval(force_n, 1e-4 * Vec3(normal(random), normal(random), normal(random)));
      port.account_for(i);
      in_j += static_cast<long double>(i.put_in_j);
      port.fill_command(order);
      ASSERT_LE(order.wave_j + port.account_j(), static_cast<double>(in_j) + 1e-12);
      port.on_reply(news);
      in_j += static_cast<long double>(news.wave_j);
      force_n = port.force_h_n({Vec3::Zero(), 0, kT});
    }
  }
}

TEST(Wave, ALumpOfLostWavesIsPlayedWithNoMoreThanItsEnergy) {
  WavePort port(config_of());
  SlaveNews news;  // ten waves of 1 √W at once
  news.wave_h = Vec3(0, 0, 10 * kT);
  news.wave_j = 10 * 0.5 * kT;
  port.on_reply(news);
  const Vec3 force_n = port.force_h_n({Vec3::Zero(), 0, kT});
  // −√(2b) w with w = √10 instead of 10, b = 2.
  EXPECT_NEAR(force_n.z(), -2 * std::sqrt(10.0), 1e-12);
  EXPECT_EQ(port.force_h_n({Vec3::Zero(), 0, kT}), Vec3::Zero());  // a wave that does not come is none
}

TEST(Wave, AWallAtNoDistanceIsTheSpringThatItIs) {
  // Waves that are turned at once: f = K x behind zero delay is f = K x. Statically w = (f − bv)/√(2b) with
  // v = 0 is f/√(2b), so that the force shown is −√(2b)·f/√(2b).
  WavePort port(config_of());
  SlaveNews news;
  const double f = 3, w = f / 2;  // √(2b) = 2
  news.wave_h = Vec3(0, 0, w * kT);
  news.wave_j = 0.5 * w * w * kT;
  port.on_reply(news);
  EXPECT_NEAR(port.force_h_n({Vec3::Zero(), 0, kT}).z(), -f, 1e-12);
}

TEST(Methods, AChangeCarriesTheDebtAndGrantsNothing) {
  for (Method from : kAllMethods) {
    for (Method to : {Method::kKsClamp, Method::kTank, Method::kModel}) {
      if (from == to) continue;
      Methods owing(from, config_of(0));
      owing.now().account_for(interval(Vec3(6, 0, 0), Vec3(1e-3, 0, 0)));
      owing.change_to(to, config_of(0), Vec3::Zero());
      EXPECT_NEAR(owing.now().account_j(), -6e-3, 1e-15) << method_name(from) << " to " << method_name(to);
      EXPECT_NEAR(owing.now().force_bound_n(), 4e-3 / (0.5 * kT), 1e-9);
      Methods rich(from, config_of(0));
      rich.now().account_for(interval(Vec3(-6, 0, 0), Vec3(1e-3, 0, 0)));
      rich.change_to(to, config_of(0), Vec3::Zero());
      EXPECT_EQ(rich.now().account_j(), 0);
    }
  }
}

TEST(ModelMethod, GivesNoMoreThanTheAllowanceForAModelThatNobodyPaidFor) {
  // Ground comes up 5 mm under a resting hand, 1000 N/m: ½·1000·(5e-3)² = 12.5 mJ, and E₀ = 10 mJ.
  MethodConfig config = config_of();
  ModelMethod method(config);
  const Scaling s = config.scaling;
  SlaveNews news;
  news.model.version = 1;
  news.model.point_w_nm = Vec3(0, 0, 0);
  news.model.stiffness_n_m = 1000 / s.impedance();
  const Vec3 target_w_nm(0, 0, -s.tip_displacement_nm(Vec3(0, 0, 5e-3)).z());
  double force_n = 0;
  for (std::uint64_t k = 1; k < 5000; ++k) {
    method.on_reply(news);
    force_n = method.force_h_n({target_w_nm, k, kT}).z();
  }
  const double stored_j = 0.5 * force_n * force_n / 1000;  // if it is the model's stiffness, not its place
  EXPECT_LE(s.hand_energy_j(method.renderer().potential_aj(target_w_nm)), 10e-3 + 1e-12);
  EXPECT_GT(s.hand_energy_j(method.renderer().potential_aj(target_w_nm)), 9e-3);
  EXPECT_GT(stored_j, 5e-3);
}

TEST(ModelMethod, IsNeverStifferThanTheDeviceShowsPassively) {
  MethodConfig config = config_of(2);
  ModelMethod method(config);
  const Scaling s = config.scaling;
  SlaveNews news;
  news.model.version = 1;
  news.model.stiffness_n_m = 1e6 / s.impedance();
  method.on_reply(news);
  method.force_h_n({Vec3(0, 0, 100), 1, kT});
  const Vec3 target_w_nm(0, 0, -s.tip_displacement_nm(Vec3(0, 0, 1e-3)).z());
  double force_n = 0;
  for (std::uint64_t k = 2; k < 2000; ++k) force_n = method.force_h_n({target_w_nm, k, kT}).z();
  EXPECT_NEAR(force_n, 0.9 * 2 * 2 / kT * 1e-3, 1e-9);  // 0.9 · 2b/T · 1 mm
}

}  // namespace
}  // namespace telenano::control
