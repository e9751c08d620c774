// Control methods in the station: which one runs, what the slave is told, and changes without a bump.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

using control::Method;

const Vec3 kPush(0, 0, 50);  // nN at the tip: 1 N at the hand with the default α_F = 2e7

StationConfig config_of(Method method) {
  StationConfig config;
  config.method = method;
  config.store_max_j = 100;
  config.well_max_j = 10;  // replies made by hand give energy that nobody has sent
  return config;
}

struct FeatureRig : StationRig {
  explicit FeatureRig(Method method,
                      std::uint64_t features = link::kKnownFeatures & ~std::uint64_t{link::kFeatureSharing})
      : StationRig(config_of(method)) {
    welcome.feature_bits = features;
    welcome.epoch = 7;
    welcome.well_aj = 1e5;  // 2 J: what comes is believed, up to the station's own limit
    station.begin_session(welcome);
    input.command_sequence = 1;
  }
  void move_to(double z_m, int ticks) {
    const double from = input.hand_pos_h_m.z();
    for (int k = 1; k <= ticks; ++k) {
      input.hand_pos_h_m.z() = from + (z_m - from) * k / ticks;
      ++input.command_sequence;
      reply.command_sequence = input.command_sequence - 1;
      tick();
    }
  }
  double largest_step_n(int ticks) {
    double last_n = force_n(), largest_n = 0;
    for (int k = 0; k < ticks; ++k) {
      tick();
      largest_n = std::fmax(largest_n, std::fabs(force_n() - last_n));
      last_n = force_n();
    }
    return largest_n;
  }
};

TEST(UsableMethod, FallsBackToWhatTheSlaveOffers) {
  EXPECT_EQ(usable_method(Method::kModel, link::kKnownFeatures), Method::kModel);
  EXPECT_EQ(usable_method(Method::kModel, link::kFeaturePortControl), Method::kTank);
  EXPECT_EQ(usable_method(Method::kModel, link::kFeatureLocalModel), Method::kKsClamp);
  for (Method method : {Method::kModel, Method::kTank, Method::kWave, Method::kTdpa})
    EXPECT_EQ(usable_method(method, 0), Method::kKsClamp);
  for (Method method : {Method::kNone, Method::kKs, Method::kKsClamp})
    EXPECT_EQ(usable_method(method, 0), method);
}

TEST(StationMethods, TheSlaveIsToldOnlyWhatItHasAgreedTo) {
  for (Method method : control::kAllMethods) {
    FeatureRig rig(method);
    rig.ticks(3);
    const bool asks = method != Method::kNone && method != Method::kKs && method != Method::kKsClamp;
    const Method used = method == Method::kTwin ? Method::kModel : method;
    EXPECT_EQ(rig.output.command.control.method, asks ? static_cast<std::uint32_t>(used) : 0u);
    // Without a twin of the scene its method is `model`.
    if (method == Method::kTwin) {
      EXPECT_EQ(rig.output.trace.method, Method::kModel);
      continue;
    }
    EXPECT_EQ(rig.output.trace.method, method);
    FeatureRig deaf(method, 0);
    deaf.ticks(3);
    EXPECT_TRUE(deaf.output.command.control.empty());
    EXPECT_EQ(deaf.output.trace.method, usable_method(method, 0));
  }
}

TEST(StationMethods, AScaleStandsInTheOrder) {
  FeatureRig rig(Method::kWave);
  rig.ticks(3);
  const control::Scaling s = rig.station.config().scaling;
  EXPECT_NEAR(rig.output.command.control.energy_scale_aj_j, s.velocity / s.force * 1e18, 1e-6);
  EXPECT_NEAR(rig.output.command.control.wave_impedance_n_s_m, 2 / (s.velocity * s.force), 1e-12);
}

TEST(StationMethods, AChangeOfMethodIsNoStepOfForce) {
  for (Method from : control::kAllMethods) {
    for (Method to : control::kAllMethods) {
      if (from == to) continue;
      FeatureRig rig(from);
      rig.reply.contact_state = link::ContactState::kContact;
      rig.engage(kPush);
      const double before_n = rig.force_n();
      rig.station.change_method(to);
      EXPECT_EQ(rig.station.method(), to == Method::kTwin ? Method::kModel : to);
      rig.tick();
      // It may fall (a wave or a model that has not come yet shows nothing), but never leap.
      EXPECT_LE(rig.force_n(), before_n + 1.0 / 200 + 1e-12)  // the ramp's first tick
          << control::method_name(from) << " to " << control::method_name(to);
      EXPECT_LE(rig.largest_step_n(400), 1.0 / 200 + 1e-9);
    }
  }
}

TEST(StationMethods, AChangeGrantsNoAllowance) {
  FeatureRig rig(Method::kNone);
  rig.engage(kPush);
  rig.move_to(0.008, 100);  // pushed out by 1 N over 8 mm
  ASSERT_NEAR(rig.output.trace.energy_j, -8e-3, 1e-4);
  rig.station.change_method(Method::kKsClamp);
  rig.tick();
  EXPECT_NEAR(rig.output.trace.account_j, rig.output.trace.energy_j, 1e-5);
  EXPECT_NEAR(rig.output.trace.force_bound_n, (10e-3 + rig.output.trace.account_j) / (0.5 * 1e-3), 1e-9);
}

TEST(StationMethods, AChangeOfScaleMovesNeitherTipNorHand) {
  FeatureRig rig(Method::kKsClamp);
  rig.engage(kPush);
  rig.move_to(-0.002, 50);
  const Vec3 target = rig.output.command.tip_pos_w_nm;
  const double before_n = rig.force_n();
  ASSERT_TRUE(rig.station.change_scaling({2e-6, 3e7}));
  rig.tick();
  EXPECT_LT((rig.output.command.tip_pos_w_nm - target).norm(), 1e-12);
  EXPECT_LE(rig.force_n(), before_n + 1.5 / 200 + 1e-12);  // the ramp's first tick
  EXPECT_LE(rig.largest_step_n(400), 1.5 / 200 + 1e-9);
  EXPECT_NEAR(rig.force_n(), 1.5, 1e-9);  // 50 nN at α_F = 3e7
  rig.move_to(-0.003, 50);
  EXPECT_NEAR(rig.output.command.tip_pos_w_nm.z(), target.z() - 2, 1e-9);  // 1 mm at α_v = 2e-6
}

// The next reply may be a round trip away: the change must not wait for it, nor leap when it comes.
TEST(StationMethods, AChangeIsBumplessBetweenRepliesToo) {
  for (Method method : {Method::kKsClamp, Method::kTank, Method::kTdpa, Method::kModel}) {
    FeatureRig rig(method);
    rig.engage(kPush);
    ASSERT_TRUE(rig.station.change_scaling({1e-6, 4e7}));
    double last_n = 1, largest_n = 0;
    for (int k = 0; k < 300; ++k) {
      rig.tick(k >= 5);
      largest_n = std::fmax(largest_n, rig.force_n() - last_n);
      last_n = rig.force_n();
    }
    EXPECT_LE(largest_n, 2.0 / 200 + 1e-9) << control::method_name(method);
  }
}

TEST(StationMethods, AMethodThatComesBackDoesNotShowWhatItLastHeard) {
  for (Method method : {Method::kKsClamp, Method::kTank, Method::kTdpa, Method::kModel}) {
    FeatureRig rig(method);
    rig.engage(kPush);
    rig.station.change_method(Method::kNone);
    rig.engage(Vec3(0, 0, 5));  // the sample is hardly there any more
    rig.station.change_method(method);
    rig.tick(false);
    EXPECT_LE(rig.output.trace.rendered_force_h_n.norm(), 0.1 + 1e-12) << control::method_name(method);
  }
}

TEST(StationMethods, AnUnsafeOrSenselessScaleIsNotTaken) {
  FeatureRig rig(Method::kKsClamp);  // the slave shows 10 N/m: 2b/((1+1)² T k_c) = 100 at one sample
  rig.engage(kPush);
  EXPECT_FALSE(rig.station.change_scaling({1e-6, 1e9}));
  EXPECT_FALSE(rig.station.change_scaling({1e-6, -1}));
  EXPECT_FALSE(rig.station.change_scaling({std::nan(""), 1}));
  EXPECT_FALSE(rig.station.change_scaling({1e-300, 1e300})) << "nor one that no configuration may have";
  EXPECT_EQ(rig.station.config().scaling.force, 2e7);
}

link::LocalModel ground(double height_nm, double stiffness_n_m) {
  link::LocalModel model;
  model.version = 1;
  model.point_w_nm = Vec3(100, 200, height_nm);
  model.normal_w = Vec3::UnitZ();
  model.stiffness_n_m = stiffness_n_m;
  return model;
}

TEST(StationMethods, TheModelIsFeltWithoutTheLink) {
  FeatureRig rig(Method::kModel);
  rig.reply.model = ground(39, 10);  // 1 nm, 1 mm of the hand, below the start
  rig.engage(Vec3::Zero());
  rig.input.command_sequence = 500;
  for (int k = 1; k <= 30; ++k) {  // 3 mm down, no reply after the first: the station knows the ground
    rig.input.hand_pos_h_m.z() = -1e-4 * k;
    ++rig.input.command_sequence;
    rig.tick(k == 1);
    const double depth_nm = std::fmax(0.0, 0.1 * k - 1);
    if (k < 20) {
      EXPECT_NEAR(rig.output.trace.rendered_force_h_n.z(), 10 * depth_nm * 2e-2, 1e-9);
    }
  }
}

TEST(StationMethods, ANewSlavesGroundReplacesTheOldOne) {
  FeatureRig rig(Method::kModel);
  rig.reply.model = ground(39, 10);
  rig.engage(Vec3::Zero());
  rig.move_to(-0.003, 60);
  ASSERT_GT(rig.force_n(), 0.3);
  const double before_n = rig.force_n();
  rig.welcome.epoch = 8;
  rig.welcome.start_pos_w_nm = rig.output.command.tip_pos_w_nm;
  rig.station.begin_session(rig.welcome);
  rig.reply = {};
  rig.reply.model = ground(20, 10);  // far below
  double last_n = before_n;
  for (int k = 0; k < 400; ++k) {
    rig.tick();
    EXPECT_LE(rig.force_n(), last_n + 1e-9);  // the new ground is not reached: the old force only goes
    last_n = rig.force_n();
  }
  EXPECT_EQ(last_n, 0);
}

TEST(StationMethods, EnergyOfALostReplyComesWithTheNextOne) {
  for (bool lossy : {false, true}) {
    FeatureRig rig(Method::kTank);
    for (int k = 0; k < 100; ++k) {
      rig.reply.port.energy_sent_aj += 100;
      rig.tick(!lossy || k % 3 == 0 || k == 99);
    }
    const double scale = rig.station.config().scaling.hand_energy_j(1);
    EXPECT_NEAR(rig.output.trace.account_j, 100 * 100 * scale, 1e-12);
  }
}

// 100 aJ in each reply. The scale changes to 25 times the price, and back, with replies under way: each is
// worth what a joule at the tip was when the slave carried out its command.
TEST(StationMethods, WhatIsUnderWayCrossesAtItsOwnScale) {
  constexpr int kDelay = 50;  // ticks
  FeatureRig rig(Method::kTank);
  rig.input.command_sequence = 0;
  double expected_j = 0, by = 1, most_j = 0;
  std::vector<double> price_of(1, 0);
  const auto scaled = [](double b) { return control::Scaling{1e-6 / b, 2e7 * b}; };
  for (int k = 1; k <= 400; ++k) {
    if (k == 150 || k == 250) {
      by = k == 150 ? 5 : 1;
      ASSERT_TRUE(rig.station.change_scaling(scaled(by)));
      expected_j = 0;  // a surplus is forfeited by every change
    }
    ++rig.input.command_sequence;
    price_of.push_back(scaled(by).hand_energy_j(1));
    const bool lost = k % 7 < 2;
    if (k > kDelay) {
      rig.reply.command_sequence = rig.input.command_sequence - kDelay;
      rig.reply.port.energy_sent_aj += 1;
    }
    rig.tick(k > kDelay && !lost);
    // Where a reply was lost over the change, the next one is worth the least; else each its own.
    if (k > kDelay) expected_j += price_of[rig.reply.command_sequence];
    if (!lost) {
      EXPECT_LE(rig.output.trace.account_j, expected_j + 1e-12) << k;
    }
    most_j = std::max(most_j, rig.output.trace.account_j);
  }
  EXPECT_NEAR(rig.output.trace.account_j, expected_j, 3 * 25 * price_of[1]) << "and nearly all of it comes";
  EXPECT_GT(most_j, 25 * 40 * price_of[1]);
}

TEST(StationMethods, OfTheSamplesOwnEnergyNoMoreIsCreditedThanTheWellHolds) {
  for (const bool says : {true, false}) {
    FeatureRig rig(Method::kModel, says
                                       ? link::kKnownFeatures & ~std::uint64_t{link::kFeatureSharing}
                                       : std::uint64_t{link::kFeaturePortControl | link::kFeatureLocalModel});
    rig.welcome.well_aj = says ? 300 : 0;
    rig.station.begin_session(rig.welcome);
    const double scale = rig.station.config().scaling.hand_energy_j(1);
    rig.reply.energy_in_aj = 1000;
    rig.reply.energy_out_aj = 1200;
    rig.tick();
    EXPECT_NEAR(rig.output.trace.account_j, says ? 200 * scale : 0, 1e-15);
    rig.reply.energy_in_aj = 9000;  // what is put in is never debited
    rig.tick();
    EXPECT_NEAR(rig.output.trace.account_j, says ? 200 * scale : 0, 1e-15);
    rig.reply.energy_out_aj = 1e300;
    rig.tick();
    EXPECT_NEAR(rig.output.trace.account_j, says ? 300 * scale : 0, 1e-15);
    for (std::uint32_t epoch = 8; epoch < 12; ++epoch) {
      rig.welcome.epoch = epoch;
      rig.station.begin_session(rig.welcome);
      rig.reply = {};
      rig.reply.energy_out_aj = 1e9;
      rig.tick();
      EXPECT_NEAR(rig.output.trace.account_j, says ? 300 * scale : 0, 1e-15) << "once, of all epochs";
    }
  }
}

TEST(StationMethods, NoServerIsBelievedMoreThanTheStationsOwnLimit) {
  FeatureRig rig(Method::kModel);
  rig.welcome.well_aj = 1e300;
  rig.station.begin_session(rig.welcome);
  rig.reply.energy_out_aj = 1.7e308;
  rig.tick();
  EXPECT_NEAR(rig.output.trace.account_j, rig.station.config().well_max_j, 1e-15);
}

// 1000 aJ go in at one scale and come out at 25 times the price, and the other way round: credited is what
// was paid, or what it is worth now, whichever is less.
TEST(StationMethods, WhatComesOutAtAnotherScaleIsWorthTheLesserPrice) {
  for (const double by : {5.0, 0.2}) {
    FeatureRig rig(Method::kTdpa);
    rig.input.command_sequence = 1;
    const double paid_at = rig.station.config().scaling.hand_energy_j(1);
    rig.reply.command_sequence = 1;
    rig.reply.energy_in_aj = 1000;
    rig.tick();
    ASSERT_TRUE(rig.station.change_scaling({1e-6 / by, 2e7 * by}));
    const double now = rig.station.config().scaling.hand_energy_j(1);
    ++rig.input.command_sequence;
    rig.tick(false);
    rig.reply.command_sequence = 2;
    rig.reply.energy_out_aj = 1000;
    ++rig.input.command_sequence;
    rig.tick();
    EXPECT_NEAR(rig.output.trace.account_j, 1000 * std::min(paid_at, now), 1e-12) << by;
  }
}

TEST(StationMethods, ThatTheScaleIsKnownWhateverTheMethod) {
  for (Method method : control::kAllMethods) {
    FeatureRig rig(method);
    rig.ticks(3);
    const double scale = rig.station.config().scaling.tip_energy_aj(1);
    EXPECT_EQ(rig.output.command.control.energy_scale_aj_j, scale) << control::method_name(method);
  }
}

TEST(StationMethods, ANewEpochNeitherFreezesNorDoublesTheBudget) {
  FeatureRig rig(Method::kTank);
  rig.reply.port.energy_sent_aj = 5000;
  rig.tick();
  const double scale = rig.station.config().scaling.hand_energy_j(1);
  ASSERT_NEAR(rig.output.trace.account_j, 5000 * scale, 1e-12);
  rig.station.begin_session(rig.welcome);  // resumed, the same epoch: the sum goes on
  rig.reply.sequence = 0;
  rig.reply.port.energy_sent_aj = 6000;
  rig.tick();
  EXPECT_NEAR(rig.output.trace.account_j, 6000 * scale, 1e-12);
  rig.welcome.epoch = 8;  // another slave: its sum begins at 0
  rig.station.begin_session(rig.welcome);
  rig.reply.sequence = 0;
  rig.reply.port.energy_sent_aj = 300;
  rig.tick();
  EXPECT_NEAR(rig.output.trace.account_j, 6300 * scale, 1e-12);
}

}  // namespace
}  // namespace telenano::station
