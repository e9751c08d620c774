#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/afm/afm_slave.h"
#include "telenano/nve_server/afm/motion_history.h"
#include "telenano/nve_server/afm/touch_model.h"
#include "telenano/nve_server/afm/work_account.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"

namespace telenano::afm {
namespace {

constexpr std::int64_t kMs = 1'000'000;

TEST(MotionHistory, WhatWasHeldInAWindow) {
  MotionHistory history;
  history.add(0, Vec3(0, 0, 5));
  history.add(10, Vec3(0, 0, 8));
  history.add(20, Vec3(3, 4, 8));
  history.add(30, Vec3(3, 4, 2));
  const auto all = history.between(0, 40);
  EXPECT_EQ(all.highest_nm, 8);
  EXPECT_EQ(all.lowest_nm, 2);
  EXPECT_EQ(all.path_across_nm, 5);
  EXPECT_EQ(all.path_nm, 3 + 5 + 6);
  EXPECT_NEAR(all.mean_w_nm.z(), (5 + 8 + 8 + 2) / 4.0, 1e-12);
  EXPECT_NEAR(all.mean_w_nm.x(), 1.5, 1e-12);
  const auto late = history.between(25, 40);
  EXPECT_EQ(late.highest_nm, 8) << "what was held at its beginning counts";
  EXPECT_EQ(late.path_across_nm, 0);
  EXPECT_NEAR(late.mean_w_nm.z(), (5 * 8 + 10 * 2) / 15.0, 1e-12);
  EXPECT_EQ(history.between(35, 40).highest_nm, 2);
}

TEST(WorkAccount, ASpringsWorkOnAnyPathWithinTheBound) {
  // F = 30 max(0, −z), read without noise at the ends of random moves: ∫ −F dz = ½·30·z².
  Random random(1);
  WorkAccount account(40);
  double z = 2;
  const auto force = [](double at) { return 30 * std::max(0.0, -at); };
  const auto energy = [&](double at) { return at < 0 ? 15 * at * at : 0.0; };
  account.add({Vec3(0, 0, z), Vec3(0, 0, force(z)), 0, 0}, 0, true, 0);
  for (int i = 0; i < 1000; ++i) {
    const double next = std::min(3.0, std::max(-8.0, z + random.uniform(-1, 1)));
    account.add({Vec3(0, 0, next), Vec3(0, 0, force(next)), std::fabs(next - z), 0}, 0, true, 0);
    z = next;
    ASSERT_LE(std::fabs(account.energy_in_aj() - account.energy_out_aj() - energy(z)),
              account.bound_aj() + 1e-9);
  }
  EXPECT_GT(account.energy_in_aj(), 100);
  const double in = account.energy_in_aj();
  account.interrupt();
  account.add({Vec3(0, 0, -100), Vec3(0, 0, 3000), 0, 0}, 0, true, 0);
  EXPECT_EQ(account.energy_in_aj(), in) << "what the controller did is not the port's";
}

TEST(WorkAccount, PressingInIsEnergyIn) {
  WorkAccount account(40);
  account.add({Vec3(0, 0, 0), Vec3(0, 0, 0), 0, 0}, 0, true, 0);
  account.add({Vec3(0, 0, -2), Vec3(0, 0, 60), 2, 0}, 0, true, 0);
  EXPECT_EQ(account.energy_in_aj(), 60);  // ½·60·2
  account.add({Vec3(0, 0, 0), Vec3(0, 0, 0), 2, 0}, 0, true, 0);
  EXPECT_EQ(account.energy_out_aj(), 60);
}

TEST(TouchModel, APlaneOfGivenSlopeAndStiffnessIsLearned) {
  // Ground z_s = 1 + 0.2 x − 0.1 y, F_z = 25 (z_s − z): readings with noise of 0.2 nN, the base wandering.
  Random random(2);
  TouchModel model(40, 0.2, 1, 2);
  const auto ground = [](double x, double y) { return 1 + 0.2 * x - 0.1 * y; };
  const auto force = [&](const Vec3& b) { return 25 * (ground(b.x(), b.y()) - b.z()); };
  Vec3 base;
  for (int i = 0; i < 400; ++i) {
    const double phase = 0.05 * i;
    const double x = 4 * std::sin(phase), y = 4 * std::cos(1.3 * phase);
    base = Vec3(x, y, ground(x, y) - 2 - std::sin(2.1 * phase));
    model.add(base, force(base) + 0.2 * random.normal(), i * 5 * kMs);
  }
  ASSERT_TRUE(model.touching());
  const auto& m = model.model();
  // Twelve or so readings per parameter with σ = 0.2 nN over excursions of 0.7 nm: K to 3 %, slopes to 0.01;
  // the prior holds K back by λ/(n var) = 0.2/(48 · 0.5) of what is missing.
  EXPECT_NEAR(model.stiffness_n_m(), 25, 1);
  EXPECT_NEAR(-m.normal_w.x() / m.normal_w.z(), 0.2, 0.02);
  EXPECT_NEAR(-m.normal_w.y() / m.normal_w.z(), -0.1, 0.02);
  for (int i = 0; i < 20; ++i) {
    const Vec3 near = base + Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-0.5, 0.5));
    EXPECT_NEAR(model.force_w_nn(near).z(), force(near), 3)
        << "3 nN: 1 nm away times the errors above, and noise";
  }
}

TEST(TouchModel, FreeWhereItHadGroundItLowersIt) {
  TouchModel model(40, 0.1, 1, 2);
  for (int i = 0; i < 10; ++i) model.add(Vec3(0, 0, -0.1 * i), 4.0 * i + 3, i * 5 * kMs);
  EXPECT_GT(model.force_w_nn(Vec3(0, 0, -1)).z(), 20);
  const auto version = model.model().version;
  model.add(Vec3(0, 0, -1), 0, 100 * kMs);
  EXPECT_FALSE(model.touching());
  EXPECT_EQ(model.force_w_nn(Vec3(0, 0, -1)).norm(), 0);
  EXPECT_NE(model.model().version, version);
}

TEST(TouchModel, AHoldInWhichTheForceDriftsTeachesNothing) {
  TouchModel model(40, 0.1, 1, 2);
  for (int i = 0; i < 12; ++i) model.add(Vec3(0, 0, -0.5 * i), 15.0 * i + 3, i * 50 * kMs);
  ASSERT_NEAR(model.stiffness_n_m(), 30, 0.5);
  Random random(9);
  double z = -5.5, force = 168;
  for (int i = 12; i < 400; ++i) {  // the base creeps up by 1 nm in 20 s, the force hardly changes
    z += 0.0025;
    force += 0.05 * random.normal();
    model.add(Vec3(0, 0, z), force, i * 50 * kMs);
  }
  EXPECT_NEAR(model.stiffness_n_m(), 30, 3);
}

TEST(TouchModel, StiffnessStaysWithinTheLevers) {
  TouchModel model(40, 0.1, 1, 2);
  for (int i = 0; i < 40; ++i) model.add(Vec3(0, 0, -0.01 * i), 100.0 * i + 5, i * 5 * kMs);
  EXPECT_LE(model.stiffness_n_m(), 40);
  for (int i = 0; i < 40; ++i) model.add(Vec3(0, 0, -0.1 * i), 500 - 10.0 * i, (i + 40) * 5 * kMs);
  EXPECT_GT(model.stiffness_n_m(), 0);
}

TEST(AfmSlave, AStepExchangesAndTakesNoMemory) {
  const auto exchange = std::make_shared<AfmExchange>();
  rt::VirtualClock clock;
  AfmSlave slave(AfmConfig{}, exchange, clock);
  PortState state;
  state.phase = Phase::kFollowing;
  state.force_known = true;
  state.touching = true;
  state.base_w_nm = Vec3(1, 2, -3);
  state.measured_ns = 0;
  state.model.version = 4;
  state.model.normal_w = Vec3::UnitZ();
  state.model.stiffness_n_m = 30;
  exchange->store_state(state);
  clock.advance_to(7 * kMs);
  slave::SlaveInput input;
  input.tip_target_pos_w_nm = Vec3(1, 2, -5);
  input.wants_model = true;
  slave::SlaveOutput output;
  const support::AllocGuard guard;
  for (int i = 0; i < 1000; ++i) slave.step(input, 1e-3, output);
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_EQ(output.force_w_nn, Vec3(0, 0, 90));
  EXPECT_EQ(output.measurement_age_ns, 7 * kMs);
  EXPECT_EQ(output.model.version, 4u);
  PortTarget wish;
  ASSERT_TRUE(exchange->load_wish(wish));
  EXPECT_EQ(wish.target_w_nm, input.tip_target_pos_w_nm);
  EXPECT_TRUE(wish.follow);
  EXPECT_EQ(wish.time_ns, 7 * kMs);
}

TEST(AfmSlave, WhoMayClearTheLatch) {
  const auto exchange = std::make_shared<AfmExchange>();
  rt::VirtualClock clock;
  slave::SlaveOutput output;
  slave::SlaveInput looks;
  looks.follow = false;
  slave::SlaveInput moves;
  slave::SlaveInput stop;
  stop.follow = false;
  stop.retract = stop.by_operator = true;
  slave::SlaveInput silence;
  silence.follow = false;
  silence.retract = true;
  AfmSlave first(AfmConfig{}, exchange, clock);
  first.step(looks, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 0u) << "to look is not to operate";
  first.step(moves, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 1u) << "a new session that follows";
  first.step(silence, 1e-3, output);
  first.step(moves, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 1u) << "a session that was silent resumes";
  first.step(stop, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 1u);
  first.step(moves, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 2u) << "a stop, released";
  moves.opening = 7;
  first.step(moves, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 3u) << "another session, on the same tip";
  first.step(silence, 1e-3, output);
  first.step(moves, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 3u) << "that resumes";
  AfmSlave second(AfmConfig{}, exchange, clock);
  second.step(silence, 1e-3, output);
  second.step(moves, 1e-3, output);
  EXPECT_EQ(exchange->clears(), 4u);
}

TEST(AfmConfigFile, TheOneInTheTreeIsTheDefault) {
  const AfmConfig read = load_afm_config(std::string(TELENANO_SOURCE_DIR) + "/deploy/afm.toml");
  const AfmConfig standard;
  EXPECT_EQ(read.deflection_signal, standard.deflection_signal);
  EXPECT_EQ(read.sensitivity_nm_v, standard.sensitivity_nm_v);
  EXPECT_EQ(read.force_max_nn, standard.force_max_nn);
  EXPECT_EQ(read.link_loss_ms, standard.link_loss_ms);
  EXPECT_EQ(read.stale_force_s(), 0.06);
  EXPECT_EQ(read.lift_nm, standard.lift_nm);
  EXPECT_EQ(read.withdraw_nm_s, standard.withdraw_nm_s);
  EXPECT_EQ(read.along_slope, standard.along_slope);
  EXPECT_EQ(read.along_part, standard.along_part);
}

// (1 - 0.45 m) 160 nN/m: 248 nN of 0.5, 35 of 1.5, where a touch takes 40.
TEST(AfmConfigFile, ASlopeThatLeavesLessThanATouchIsRefused) {
  std::ifstream standard(std::string(TELENANO_SOURCE_DIR) + "/deploy/afm.toml");
  const std::string text{std::istreambuf_iterator<char>(standard), {}};
  const std::string limits = "[limits]\n";
  const auto at = text.find(limits);
  ASSERT_NE(at, std::string::npos);
  const std::string path = ::testing::TempDir() + "along_slope.toml";
  for (const char* slope : {"0.5", "1.5"}) {
    std::string changed = text;
    std::ofstream(path) << changed.insert(at + limits.size(), std::string("along_slope = ") + slope + "\n");
    if (slope == std::string("0.5")) {
      EXPECT_EQ(load_afm_config(path).along_slope, 0.5);
    } else {
      EXPECT_THROW(load_afm_config(path), UserError);
    }
  }
  std::remove(path.c_str());
}

}  // namespace
}  // namespace telenano::afm
